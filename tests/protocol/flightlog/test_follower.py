"""Following a log while it is written: at any length of the file, what is new and whole comes, once."""

import random
from pathlib import Path

import pytest

from protocol.flightlog import FlightLogError, LogFollower, LogReader, Record
from protocol.flightlog.mcap_format import message_record
from tests.protocol.flightlog.made_logs import COUNT, DEFINITION, Opener, chunk_ends, chunked, count, until


def new(follower: LogFollower) -> list[Record]:
    return [record for records in follower.poll() for record in records]


def test_a_file_that_grows_by_any_steps_gives_each_record_once(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "grows.mcap"
    path.write_bytes(finished)
    whole = LogReader(path)
    expected = list(whole.records())
    ends = chunk_ends(path)
    path.write_bytes(b"")
    follower = LogFollower(path)
    generator = random.Random(1)
    found: list[Record] = []
    length = 0
    with path.open("ab", buffering=0) as file:
        while length < len(finished):
            assert not follower.ended
            step = generator.choice((1, 100, 20_000, 200_000))
            file.write(finished[length : length + step])
            length = min(length + step, len(finished))
            found += new(follower)
            assert len(found) == max((messages for end, messages in ends if end <= length), default=0)
    assert follower.ended and found == expected and new(follower) == []
    assert follower.attachments == whole.attachments
    assert {topic: kind.definition for topic, kind in follower.topics.items()} == {
        topic: kind.definition for topic, kind in whole.topics.items()
    }


def test_a_flight_is_followed_into_the_file_that_another_takes_the_place_of(start: Opener) -> None:
    log = start()
    follower = LogFollower(log.path, lambda topic: topic == COUNT.topic)
    count(log, range(100))
    log.text(0, 20, "name", "left out")
    until(lambda: log.written == 101)
    found = new(follower)
    assert len(found) == 100 and not follower.ended
    count(log, range(100, 200))
    log.close()
    found += new(follower)
    assert follower.ended and found == list(LogReader(log.path).records((COUNT.topic,)))


def test_damage_ends_it_with_the_place_and_gives_nothing_twice(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "damaged.mcap"
    path.write_bytes(finished)
    (_, messages), (second, _), *_ = chunk_ends(path)
    damaged = bytearray(finished)
    damaged[second - 500] ^= 1
    path.write_bytes(damaged)
    follower = LogFollower(path)
    found: list[Record] = []
    for _ in range(2):
        with pytest.raises(FlightLogError, match=r"damaged\.mcap: damaged at byte \d+"):
            for records in follower.poll():
                found += records
        assert len(found) == messages


def test_a_channel_that_nothing_defines_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "undefined.mcap"
    path.write_bytes(chunked(DEFINITION + message_record(1, 0, 7, bytes(8)) + message_record(2, 1, 7, bytes(8))))
    with pytest.raises(FlightLogError, match="damaged at byte"):
        new(LogFollower(path))


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FlightLogError, match="No such file"):
        new(LogFollower(tmp_path / "none.mcap"))
