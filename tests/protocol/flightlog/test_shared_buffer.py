"""The buffer between the flying process and the recorder."""

import os
import random
import signal

import pytest

from protocol.flightlog import (
    LogReader,
    read,
)
from tests.protocol.flightlog.made_logs import (
    COUNT,
    Opener,
    count,
    numbers_of,
    until,
)


def test_buffer_wraps_with_odd_sizes(start: Opener) -> None:
    log = start(buffer_bytes=1 << 16)
    generator = random.Random(5)
    fillings = [generator.randbytes(generator.choice([0, 1, 7, generator.randrange(6000)])) for _ in range(3000)]
    count(log, range(3000), fillings.__getitem__)
    log.close()
    records = [COUNT.unpack(record.data) for record in read(log.path)]
    assert [values["number"] for values in records] == list(range(3000))
    assert [values["filling"] for values in records] == fillings
    assert log.dropped == 0


def test_records_that_just_fit_the_buffer_and_that_never_do(start: Opener) -> None:
    log = start(buffer_bytes=1 << 16)
    overhead = 31 + len(COUNT.pack(0, b""))
    sizes = [(1 << 16) - overhead, (1 << 16) - overhead + 1, (1 << 16) - overhead, 0]
    count(log, range(4), lambda number: bytes(sizes[number]))
    log.close()
    assert numbers_of(log.path) == [0, 2, 3]
    assert log.dropped == 1
    assert LogReader(log.path).metadata["flightlog end"]["dropped"] == "1"


def test_drop_never_waits_and_leaves_gaps_in_the_sequence(start: Opener, capfd: pytest.CaptureFixture[str]) -> None:
    log = start(on_full="drop", buffer_bytes=1 << 16)
    os.kill(log.recorder_pid, signal.SIGSTOP)
    count(log, range(5000))  # would never return if it waited
    dropped = log.dropped
    os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.written == 5000 - dropped)
    count(log, range(5000, 5001))
    log.close()
    sequences = [record.sequence for record in read(log.path)]
    assert sequences == [*range(5000 - dropped), 5000]
    assert 0 < dropped == log.dropped < 5000
    assert f"{dropped} records not logged" in capfd.readouterr().err
