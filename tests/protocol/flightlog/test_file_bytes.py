"""A log's file that changes or fails while it is read: it is read as far as it goes, and nothing ends the process."""

import errno
import os
import random
from pathlib import Path

import pytest

from protocol.flightlog import FlightLogError, LogFollower, LogReader
from protocol.flightlog.file_bytes import FileBytes

SIZE = 300_000
"""More than is read ahead, and than a page of memory."""


@pytest.fixture
def content() -> bytes:
    return random.Random(1).randbytes(SIZE)


@pytest.fixture
def file(content: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "bytes"
    path.write_bytes(content)
    return path


def test_they_are_those_of_the_file_in_any_order(file: Path, content: bytes) -> None:
    data, generator = FileBytes(file), random.Random(2)
    assert len(data) == SIZE and data[:] == content
    for _ in range(500):
        start = generator.randrange(SIZE + 10)
        stop = start + generator.choice((-5, 0, 1, 9, 70_000, SIZE))
        assert data[start:stop] == content[start:stop]
        mark = content[start : start + 12]
        assert not mark or data.find(mark, generator.randrange(start + 1)) == content.find(mark)
    assert data.find(b"nowhere in it", 0) == data.find(content[:12], 1) == -1


def test_a_mark_across_two_blocks_is_found(file: Path, content: bytes) -> None:
    for place in (65_530, 131_060, SIZE - 12):
        assert FileBytes(file).find(content[place : place + 12], 0) == place


def test_a_file_that_becomes_shorter_ends_there(file: Path, content: bytes) -> None:
    """A mapped one ends the process where it is read beyond its end."""
    data = FileBytes(file)
    os.truncate(file, 100_000)
    assert data[90_000:200_000] == content[90_000:100_000] and len(data) == 100_000
    data.refresh()
    os.truncate(file, 50_000)
    assert data[80_000:80_010] == b"" and len(data) == 50_000
    assert data.find(content[60_000:60_012], 0) == -1


def test_a_disk_that_can_not_be_read_is_said(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*asked: int) -> bytes:
        raise OSError(errno.EIO, "Input/output error")

    data = FileBytes(file)
    monkeypatch.setattr(os, "pread", broken)
    with pytest.raises(FlightLogError, match=r"bytes: Input/output error"):
        data[:10]


def test_a_log_that_is_cut_off_while_it_is_read_is_read_up_to_there(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "shrinks.mcap"
    path.write_bytes(finished)
    whole = list(LogReader(path).records())
    reader, follower = LogReader(path), LogFollower(path)
    records, chunks = reader.records(), follower.poll()
    found, followed = [next(records)], next(chunks)
    os.truncate(path, len(finished) // 2)
    found += records
    followed += [record for chunk in chunks for record in chunk]
    for some in (found, followed):
        assert 0 < len(some) < len(whole) and some == whole[: len(some)]
    assert "damaged" in str(reader.problem) and not follower.ended
