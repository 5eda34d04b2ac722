"""Telemetry logs: those of real flights, those that pymavlink writes, and damaged ones."""

import random
import struct
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import FlightLogError, tlog
from protocol.flightlog.tlog import Entry, TlogReader, from_vehicle, is_tlog, write
from protocol.framing import Framer

DATA = Path(__file__).resolve().parents[2] / "data"
RECORDINGS = {"px4_offboard": 8762, "ardupilot_guided": 6210}
NOW_US = 1_790_000_000_000_000


def by_pymavlink(path: Path) -> list[Entry]:
    """A log as pymavlink's own link writes it: MAVLink 1 and 2, signed and not, times that step back."""
    sender = dialect.MAVLink(None, 1, 1)
    expected = []
    with path.open("wb") as file:
        for number in range(200):
            signs = number % 3 == 0
            sender.signing.sign_outgoing = signs
            sender.signing.secret_key = bytes(32) if signs else None
            message = dialect.MAVLink_attitude_message(number, 0.1, -0.2, 0.3, 1.0, 2.0, 253.0 + number)
            frame = bytes(message.pack(sender, force_mavlink1=number % 3 == 1))
            time_us = NOW_US + number * 4000 - (9000 if number % 50 == 0 else 0)
            file.write(struct.pack(">Q", time_us) + frame)
            expected.append(Entry(time_us, frame))
    return expected


@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings_come_out_as_pymavlink_reads_them(name: str) -> None:
    reader = TlogReader(DATA / f"{name}.tlog")
    entries = list(reader.entries())
    assert len(entries) == RECORDINGS[name] and reader.problem is None
    theirs = mavutil.mavlogfile(str(DATA / f"{name}.tlog"))
    for entry in entries:
        message = theirs.recv_msg()
        assert bytes(message.get_msgbuf()) == entry.data
        assert message._timestamp == pytest.approx(entry.time_us * 1e-6, abs=1e-6)
    assert theirs.recv_msg() is None


def test_what_pymavlink_writes(tmp_path: Path) -> None:
    expected = by_pymavlink(tmp_path / "a.tlog")
    reader = TlogReader(tmp_path / "a.tlog")
    assert list(reader.entries()) == expected and reader.problem is None
    assert write(tmp_path / "b.tlog", expected) == len(expected)
    assert (tmp_path / "b.tlog").read_bytes() == (tmp_path / "a.tlog").read_bytes()
    with pytest.raises(FlightLogError, match=r"b\.tlog"):
        write(tmp_path / "b.tlog", expected)


def test_damage_costs_what_it_hits_and_no_byte_goes_astray(tmp_path: Path) -> None:
    """Cut anywhere and with any byte changed: it is said, and the entries put together are still the file."""
    expected = by_pymavlink(tmp_path / "a.tlog")
    content = (tmp_path / "a.tlog").read_bytes()
    path = tmp_path / "damaged.tlog"
    generator = random.Random(1)
    for number in range(200):
        damaged = bytearray(content)
        place = generator.randrange(300, len(content))
        if number % 2:
            del damaged[place:]
        else:
            damaged[place] ^= 1 << generator.randrange(8)
        path.write_bytes(damaged)
        reader = TlogReader(path)
        entries = list(reader.entries())
        assert b"".join(struct.pack(">Q", time_us) + data for time_us, data in entries) == damaged
        whole = [entry for entry in entries if entry in expected]
        hit = place // (len(content) // len(expected)) + 1 if number % 2 else len(expected)
        assert len(whole) >= hit * 0.9 - 8, number
        known = Framer(carry_unknown=False)  # the checksum of an unknown message can not be checked
        sound = all(known.datagram(entry.data) for entry in entries)
        unseen = [bare(data) for _, data in entries] == [bare(data) for _, data in expected[: len(entries)]]
        assert reader.problem is not None or not sound or unseen, number


def bare(frame: bytes) -> bytes:
    """Without a signature: that and the times have no checksum."""
    return frame[: 12 + frame[1]]


def test_noise_before_the_first_frame_is_said(tmp_path: Path) -> None:
    expected = by_pymavlink(tmp_path / "a.tlog")
    (tmp_path / "b.tlog").write_bytes(b"\x00" * 11 + (tmp_path / "a.tlog").read_bytes())
    reader = TlogReader(tmp_path / "b.tlog")
    assert list(reader.entries()) == expected
    assert reader.problem is not None and "11 bytes before" in reader.problem


@pytest.mark.parametrize("content", [b"", b"\x00" * 1000, b"\xfd" * 1000, b"\x89MCAP0\r\n" + bytes(200)])
def test_what_is_none_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "no.tlog"
    path.write_bytes(content)
    assert not is_tlog(path)
    with pytest.raises(FlightLogError, match=r"no\.tlog: neither"):
        TlogReader(path)


def test_unknown_messages_at_the_start_are_entries(tmp_path: Path) -> None:
    """They have no checksum to go by, but entry follows on entry."""
    known = bytes(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3).pack(dialect.MAVLink(None, 1, 1)))
    unknown = known[:7] + b"\x9a\x01" + known[9:]
    for frames in ([unknown, unknown, known], [unknown] * 3, [unknown] * 5000):
        path = tmp_path / f"{len(frames)}{len(set(frames))}.tlog"
        expected = [Entry(NOW_US + number, frame) for number, frame in enumerate(frames)]
        write(path, expected)
        reader = TlogReader(path)
        assert list(reader.entries()) == expected and reader.problem is None


def test_no_more_is_searched_than_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A large file is full of what could be frames."""
    checked = 0

    def count(data: bytes) -> bool:
        nonlocal checked
        checked += 1
        return False

    monkeypatch.setattr(tlog, "_is_valid_frame", count)
    candidate = b"\0" * 8 + b"\xfe\0"
    (tmp_path / "a.tlog").write_bytes(b"#" + candidate * 100_000)
    assert not is_tlog(tmp_path / "a.tlog")
    assert 0 < checked <= (1 << 16) // len(candidate) + 1


def test_who_is_the_vehicle() -> None:
    def frame(system: int, component: int) -> bytes:
        return bytes(
            dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3).pack(dialect.MAVLink(None, system, component))
        )

    senders = [(1, 1), (1, 100), (1, 191), (255, 190), (255, 0), (254, 1), (7, 1)]
    (*found,) = (from_vehicle(Framer().datagram(frame(*sender))[0]) for sender in senders)
    assert found == [True, True, False, False, False, False, True]
