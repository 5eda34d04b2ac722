"""The recorder against kills, signals and full disks."""

import errno
import os
import resource
import signal
import subprocess
import sys
from collections import deque
from pathlib import Path
from threading import Event

import pytest
from mcap.reader import make_reader

from protocol.flightlog import (
    DATAGRAM,
    LogReader,
    writer,
)
from protocol.flightlog.shared_buffer import METADATA_CHANNEL, encode_metadata
from protocol.flightlog.syncing import Syncing
from tests.protocol.flightlog.made_logs import (
    COUNT,
    DEADLINE_S,
    EPOCH_NS,
    TRACE,
    Opener,
    count,
    noise,
    numbers_of,
    until,
    written,
)

PRODUCER = """
import os, sys
from pathlib import Path
from protocol.flightlog import FlightLog, record_type
COUNT = record_type("/courier/count", "courier/Count", [("number", "int64"), ("filling", "uint8[]")])
log = FlightLog.open(Path(sys.argv[1]), metadata={}, attachments={}, types=[COUNT], on_full="wait", console=True,
                     minimum_free_bytes=0, buffer_bytes=1 << 20)
number = 0
while True:
    log.record(COUNT, number, COUNT.pack(number, bytes(number % 300)))
    number += 1
    if number % 50 == 0:
        os.write(1, number.to_bytes(8, "little"))
"""


@pytest.mark.parametrize("moment", [50, 3_000, 61_000])
def test_kill_of_the_flying_process_loses_nothing(tmp_path: Path, moment: int) -> None:
    folder = tmp_path / "log"
    with subprocess.Popen(
        [sys.executable, "-c", PRODUCER, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        handed_over = 0
        while handed_over < moment:
            message = process.stdout.read(8)
            assert message, process.stderr.read().decode()
            handed_over = int.from_bytes(message, "little")
        process.kill()
        handed_over = max(handed_over, int.from_bytes(process.stdout.read()[-8:], "little"))
        assert process.stderr.read() == b""  # until the recorder, which has it too, has ended
    reader = LogReader(folder / "flight.mcap")
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert reader.complete
    assert reader.problem is None
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= handed_over
    assert "without closing" in reader.metadata["flightlog end"]["reason"]


def test_a_record_is_safe_soon_without_more_to_follow(start: Opener) -> None:
    log = start()
    count(log, range(1))
    until(lambda: log.written == 1)
    reader = LogReader(log.path)  # while it is being written
    assert [COUNT.unpack(record.data)["number"] for record in reader.records()] == [0]
    assert not reader.complete
    assert reader.problem is not None
    assert "cut off" in reader.problem
    assert reader.metadata["flightlog"]["epoch_ns"] == str(EPOCH_NS)


def test_kill_of_the_recorder_is_said_and_stops_nothing(start: Opener) -> None:
    log = start()
    count(log, range(3000), noise(6))
    until(lambda: log.written >= 2000)
    assert log.fault is None
    safe = log.written
    os.kill(log.recorder_pid, signal.SIGKILL)
    count(log, range(3000, 6000), noise(7))  # more than the buffer holds: it must not wait for a dead recorder
    until(lambda: log.fault is not None)
    assert log.fault is not None
    assert str(log.path) in log.fault
    assert log.dropped > 0
    log.close()
    assert log.fault is not None
    reader = LogReader(log.path)
    assert [path.name for path in log.folder.iterdir()] == ["flight.mcap"]
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert len(numbers) >= safe
    assert numbers == list(range(len(numbers)))
    assert not reader.complete
    assert list(reader.topics) == [DATAGRAM.topic, "/log", COUNT.topic, TRACE.topic]


@pytest.mark.parametrize("on_full, after_s", [("drop", 1.0), ("wait", 2.0)])
def test_recorder_that_stands_still_is_said(
    start: Opener, on_full: str, after_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In lockstep, where nothing is lost meanwhile, not before it is given up."""
    monkeypatch.setattr(writer, "_GIVE_UP_NS", 2_000_000_000)
    log = start(on_full=on_full)
    os.kill(log.recorder_pid, signal.SIGSTOP)
    try:
        until(lambda: log.fault is not None)
        assert log.fault is not None
        assert "not moved" in log.fault and log._buffer.silent_ns > after_s * 1e9
    finally:
        os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.fault is None)


def test_signals_for_the_flight_do_not_end_the_log(start: Opener) -> None:
    log = start()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(log.recorder_pid, number)
    count(log, range(10))
    log.close()
    assert numbers_of(log.path) == list(range(10))


def test_what_is_flown_in_real_time_is_taken_to_the_disk(start: Opener) -> None:
    """By a thread beside the recorder's own; in lockstep no battery is torn off."""
    threads = [Path(f"/proc/{start(how, on_full=how).recorder_pid}/task") for how in ("drop", "wait")]
    until(lambda: [len(list(each.iterdir())) for each in threads] == [2, 1])


def test_each_second_of_a_log_is_taken_to_the_disk_and_a_disk_that_fails_is_told() -> None:
    answers: deque[OSError | None] = deque((None, OSError(errno.EIO, "Input/output error"), None))
    seen: list[OSError | None] = []
    begun = Event()

    def sync() -> None:
        assert begun.wait(DEADLINE_S)
        seen.append(syncing.error)
        if (answer := answers.popleft() if answers else None) is not None:
            raise answer

    syncing = Syncing(sync, every_s=0.001)
    begun.set()
    until(lambda: len(seen) >= 4)
    syncing.stop()
    calls = len(seen)
    assert [error and error.errno for error in seen[:4]] == [None, None, errno.EIO, None]
    assert syncing.error is None and len(seen) == calls


def test_a_file_system_without_such_a_call_is_left_alone() -> None:
    calls: list[int] = []

    def sync() -> None:
        calls.append(1)
        raise OSError(errno.EINVAL, "Invalid argument")

    syncing = Syncing(sync, every_s=0.001)
    until(lambda: not syncing._thread.is_alive())
    assert calls == [1] and syncing.error is None
    syncing.stop()


def test_a_log_that_is_deleted_while_it_is_written_is_said(start: Opener) -> None:
    log = start()
    log.path.unlink()
    log.folder.rmdir()
    count(log, range(10))
    until(lambda: log.fault is not None)
    log.close()
    assert log.fault == f"{log.folder}: the flight log can't be written: its file was deleted"


def test_full_disk_in_flight_is_said_and_what_is_written_stays_readable(start: Opener) -> None:
    log = start()
    limit = 1_000_000
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    count(log, range(2000), noise(8))
    until(lambda: log.fault is not None)
    assert log.fault is not None
    assert str(log.folder) in log.fault
    assert "File too large" in log.fault
    reader = LogReader(log.path)
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert 0 < len(numbers) < 2000
    assert numbers == sorted(set(numbers))
    assert numbers[:100] == list(range(100))
    assert log.path.stat().st_size <= limit
    copy = log.folder / "copy.mcap"

    def ends_whole() -> bool:  # what was half written is cut off again
        content = log.path.read_bytes()
        return f"cut off at byte {len(content)}" in str(written(content, copy)[1].problem)

    until(ends_whole)
    # Room again: the log goes on behind the gap, the fault is over, and what was lost is counted.
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    lost, number = log.lost, 2000
    assert lost > 0 and log.dropped == 0

    def writes_again() -> bool:
        nonlocal number
        count(log, range(number, number + 1))
        number += 1
        return log.fault is None

    until(writes_again)
    log.close()
    assert log.fault is None and log.lost >= lost
    reader = LogReader(log.path)
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert numbers[-1] == number - 1 and numbers == sorted(set(numbers))
    assert reader.complete
    assert reader.problem is None
    assert int(reader.metadata["flightlog end"]["lost"]) == number - len(numbers) == log.lost
    with log.path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(numbers)


def test_what_a_full_disk_takes_is_counted_where_metadata_ends_the_chunk(start: Opener) -> None:
    log = start()
    limit = log.path.stat().st_size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    os.kill(log.recorder_pid, signal.SIGSTOP)
    count(log, range(10))
    log._buffer.put(METADATA_CHANNEL, 0, encode_metadata("landed", {"at": "home"}))
    os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.fault is not None and log.lost == 11)
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    count(log, range(10, 13))
    until(lambda: log.written == 3)
    log.close()
    assert numbers_of(log.path) == [10, 11, 12]
    end = LogReader(log.path).metadata["flightlog end"]
    assert (end["records"], end["lost"]) == ("3", "11")


def test_first_chunk_that_fails_does_not_take_the_channels_with_it(start: Opener) -> None:
    log = start()
    size = log.path.stat().st_size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    count(log, range(1))
    until(lambda: log.fault is not None)
    assert log.path.stat().st_size == size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    count(log, range(1, 3))
    until(lambda: log.written == 2)
    assert numbers_of(log.path) == [1, 2]  # without the summary, which has them again
    log.close()
    assert numbers_of(log.path) == [1, 2]
