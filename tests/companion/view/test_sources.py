"""A flight is followed to its end, where a tidier file takes the place of the one that was written."""

import os
import time
from pathlib import Path

from companion.outcomes import Outcome
from companion.records import RECORD_TYPES, TICK
from companion.view.sources import GrowingLog, open_log
from protocol.flightlog import FlightLog
from tests.companion.view.made_logs import make


def test_a_flight_is_followed_to_its_end(tmp_path: Path) -> None:
    log = FlightLog.open(
        tmp_path, metadata={}, attachments={}, types=RECORD_TYPES, on_full="wait", console=False, minimum_free_bytes=0
    )
    source = GrowingLog(log.path)
    found: list[int] = []

    def look() -> None:
        for _, _, _, table in source.poll():
            found.extend(table["late_ns"].tolist())

    for number in range(3000):
        log.record(TICK, number * 4_000_000, TICK.pack(number))
    patience = time.monotonic() + 20.0
    while len(found) < 100 and time.monotonic() < patience:
        look()
    assert 100 <= len(found) <= 3000
    assert not source.ended
    inode = log.path.stat().st_ino
    for number in range(3000, 4000):
        log.record(TICK, number * 4_000_000, TICK.pack(number))
    log.close()
    look()
    assert log.path.stat().st_ino != inode, "another file, which the source never opened"
    assert source.ended
    assert found == list(range(4000))


def test_a_log_that_nobody_writes_to_any_more_was_cut_off(tmp_path: Path) -> None:
    whole = make(tmp_path).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 3])
    source = open_log(cut)
    assert len(list(source.poll())) > 0 and not source.ended and source.verdict is None
    os.utime(cut, (1.0, 1.0))
    assert list(source.poll()) == []
    assert source.ended and source.problem == "cut off"
    assert source.verdict is not None and source.verdict.outcome is Outcome.UNFINISHED
    os.utime(cut)
    assert list(source.poll()) == [] and not source.ended and source.verdict is None
    cut.unlink()
    assert list(source.poll()) == [] and source.ended and source.problem == "cut off"
