import errno
import json
import os
from pathlib import Path

import pytest

from protocol.framing import Framer
from protocol.key_files import Keeper, KeyFileError, make_key, read_key
from protocol.messages import Encoder, dialect
from protocol.signing import SECOND, timestamp

START_NS = 1_790_000_000 * 10**9
PLAIN = Encoder(1, 1).encode_fields(dialect.MAVLink_timesync_message, 0, 1)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A new key."""
    make_key(tmp_path / "key")
    return tmp_path / "key"


def keeper(file: Path, unix_ns: int = START_NS, elapsed_ns: int = 0) -> Keeper:
    """Started at this time of the wall's clock, so long ago."""
    times = iter((0, *[elapsed_ns] * 1000))
    return Keeper(read_key(file), file.with_name("key.state"), lambda: unix_ns, lambda: next(times))


def test_a_key_is_random_and_its_owner_s_alone(file: Path, tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        make_key(tmp_path / "other")
    finally:
        os.umask(before)
    assert (tmp_path / "other").stat().st_mode & 0o777 == 0o600
    assert len({read_key(file), read_key(tmp_path / "other"), bytes(32)}) == 3
    with pytest.raises(KeyFileError, match=r"key: File exists"):
        make_key(file)


def test_a_key_that_can_t_be_written_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be in the way of the next one."""

    def full(handle: int, mode: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(KeyFileError, match=r"key: No space left on device"):
        patch.setattr(os, "fchmod", full)
        make_key(tmp_path / "key")
    make_key(tmp_path / "key")
    assert len(read_key(tmp_path / "key")) == 32


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o700, 0o400, 0o606])
def test_a_key_that_others_may_read_is_refused(file: Path, mode: int) -> None:
    file.chmod(mode)
    with pytest.raises(KeyFileError, match=f"{mode:04o}, not 0600"):
        read_key(file)


@pytest.mark.parametrize("size", [0, 31, 33, 5000])
def test_a_key_of_another_length_is_refused(file: Path, size: int) -> None:
    file.write_bytes(bytes(size))
    with pytest.raises(KeyFileError, match="32 bytes"):
        read_key(file)


def test_a_key_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="none: No such file"):
        read_key(tmp_path / "none")
    with pytest.raises(KeyFileError, match="Is a directory"):
        read_key(tmp_path)


def test_the_clock_never_goes_back(file: Path) -> None:
    first = keeper(file, START_NS)
    first.signing.sign(PLAIN, first.now())
    first.settle()
    back = keeper(file, START_NS - 3600 * 10**9, 2 * 10**9)
    assert back.now() >= first.now() + 2 * SECOND
    ahead = keeper(file, START_NS + 3600 * 10**9)
    assert ahead.now() == timestamp(START_NS + 3600 * 10**9)


def test_what_was_heard_is_known_after_a_restart_to_all_that_share_the_key(file: Path, tmp_path: Path) -> None:
    sender = Keeper(read_key(file), None, lambda: START_NS)
    (frame,) = Framer().datagram(sender.signing.sign(PLAIN, sender.now()))
    one, other = keeper(file), keeper(file)
    assert one.signing.accepts(frame, one.now())
    one.settle()
    other.signing.sign(PLAIN, other.now())
    other.settle()  # does not forget what the first has written
    assert not keeper(file).signing.accepts(frame, one.now())
    assert not list(tmp_path.glob("key.state.*"))
    assert (tmp_path / "key.state").stat().st_mode & 0o777 == 0o600


def test_it_is_written_once_a_second_at_the_most(file: Path) -> None:
    side, written = keeper(file), 0
    for index in range(1000):  # 10 s
        side.signing.sign(PLAIN, timestamp(START_NS) + index * SECOND // 100)
        written += side.signing.due
        side.settle()
    assert 8 <= written <= 11


DAMAGED = (
    "",
    "{",
    "[]",
    '{"sent": 1}',
    '{"sent": 1, "heard": {"1": 2}}',
    " " * 70_000,
    f'{{"sent": {2**48 - 1}, "heard": {{}}}}',
    '{"sent": Infinity, "heard": {}}',
    '{"sent": -1, "heard": {}}',
    '{"sent": 1, "heard": {"1/1/0": 1e400}}',
    "[" * 60_000,
)


@pytest.mark.parametrize("text", DAMAGED)
def test_a_damaged_memory_is_no_empty_one(file: Path, text: str) -> None:
    state = file.with_name("key.state")
    state.write_text(text)
    state.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"key\.state"):
        Keeper.of(file)


def test_a_memory_that_can_t_be_written_is_said_and_no_end(file: Path) -> None:
    side = Keeper.of(file)
    state = file.with_name("key.state")
    state.unlink()
    state.mkdir()
    side.signing.sign(PLAIN, side.now())
    side.settle()
    assert side.fault is not None and "key.state" in side.fault
    state.rmdir()
    side.signing.sign(PLAIN, side.now() + 2 * SECOND)
    side.settle()
    assert side.fault is None
    assert json.loads(state.read_text())["sent"] > 0
