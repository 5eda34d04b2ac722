"""Logs cut and damaged anywhere: nothing escapes, everything whole is kept, the rest is said."""

import random
import resource
import shutil
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

from companion.logs.info import info
from companion.logs.repair import repair
from companion.logs.writer import Writer
from protocol.flightlog import Direction, FlightLogError, LogReader
from protocol.flightlog.tlog import Entry, TlogReader, write
from protocol.messages import dialect
from tests.companion.logs.changed_logs import Flyer, telemetry_log
from tests.flights.processes import run

DATA = Path(__file__).resolve().parents[2] / "data"
DESCRIPTORS = Path("/proc/self/fd")
DAMAGES = 80
A_CHUNK = 50


def read_by_mcap(path: Path) -> int:
    """Messages, by the mcap package with all CRCs checked."""
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))


def test_a_log_cut_anywhere_becomes_whole(many_chunks: Path, tmp_path: Path) -> None:
    content = many_chunks.read_bytes()
    whole = list(LogReader(many_chunks).records())
    generator = random.Random(2)
    kept = []
    for number in range(DAMAGES):
        cut = generator.randrange(8, len(content))
        source, target = tmp_path / "cut.mcap", tmp_path / f"{number}.mcap"
        source.write_bytes(content[:cut])
        assert info(source).problem is not None
        result = repair(source, target)
        assert result.target == target and result.lost
        again = LogReader(target)
        records = list(again.records())
        assert again.complete and again.problem is None
        assert records == whole[: len(records)] and len(records) == result.kept
        assert len(records) >= len(whole) * cut / len(content) - 2 * A_CHUNK
        assert read_by_mcap(target) == len(records)
        assert again.attachments == LogReader(source).attachments
        assert again.metadata["repair"]["source"] == "cut.mcap"
        kept.append(len(records))
        target.unlink()
    assert len(Counter(kept)) > 20


def test_a_cut_flight_is_kept_to_just_before_the_cut(fly: Flyer, tmp_path: Path) -> None:
    """To within 0.2 s of the flight, and what the time at the cut is not known better (evenly spread over a chunk)."""
    content = fly().read_bytes()
    with fly().open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    generator = random.Random(6)
    source, target = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    for _ in range(DAMAGES // 8):
        cut = generator.randrange(chunks[0].chunk_start_offset + 1000, len(content))
        source.write_bytes(content[:cut])
        chunk = [each for each in chunks if each.chunk_start_offset <= cut][-1]
        part = min((cut - chunk.chunk_start_offset) / chunk.chunk_length, 1.0)
        at_ns = chunk.message_start_time + part * (chunk.message_end_time - chunk.message_start_time)
        assert repair(source, target).last_s > (at_ns - chunks[0].message_start_time) * 1e-9 - 0.3
        assert info(target, check=True).problem is None
        target.unlink()


def test_a_flipped_bit_anywhere_is_found_and_costs_its_chunk(many_chunks: Path, tmp_path: Path) -> None:
    content = many_chunks.read_bytes()
    whole = {record.sequence: record for record in LogReader(many_chunks).records()}
    generator = random.Random(3)
    for number in range(DAMAGES):
        damaged = bytearray(content)
        damaged[generator.randrange(8, len(content))] ^= 1 << generator.randrange(8)
        source, target = tmp_path / "flipped.mcap", tmp_path / f"{number}.mcap"
        source.write_bytes(damaged)
        info(source)
        assert info(source, check=True).problem is not None
        result = repair(source, target)
        assert result.target is not None and result.lost
        again = LogReader(target)
        records = [record.sequence for record in again.records()]
        assert again.complete and again.problem is None
        assert set(records) <= set(whole) and len(records) >= len(whole) - 2 * A_CHUNK
        assert all(record.data == whole[record.sequence].data for record in again.records())
        if len(records) < len(whole) - A_CHUNK // 2 and 0 in records and 1999 in records:
            assert any("records between" in line for line in result.lost)
        target.unlink()


def test_many_bytes_of_noise(many_chunks: Path, tmp_path: Path) -> None:
    """Whole stretches overwritten: what is read is from the flight, or the file is refused in one sentence."""
    content = many_chunks.read_bytes()
    whole = {record.data for record in LogReader(many_chunks).records()}
    generator = random.Random(4)
    for number in range(40):
        damaged = bytearray(content)
        for _ in range(generator.randrange(1, 6)):
            place = generator.randrange(len(content))
            damaged[place : place + 400] = generator.randbytes(len(damaged[place : place + 400]))
        source, target = tmp_path / "noise.mcap", tmp_path / f"{number}.mcap"
        source.write_bytes(damaged)
        try:
            repair(source, target)
        except FlightLogError:
            continue
        assert {record.data for record in LogReader(target).records()} <= whole
        assert LogReader(target).problem is None


def test_nothing_to_repair(many_chunks: Path, tmp_path: Path) -> None:
    source = tmp_path / "flight.mcap"
    shutil.copy(many_chunks, source)
    result = repair(source)
    assert result.target is None and result.lost == [] and result.kept == 2000
    assert list(tmp_path.iterdir()) == [source]


def test_never_in_place(many_chunks: Path, tmp_path: Path) -> None:
    source = tmp_path / "flight.mcap"
    cut = many_chunks.read_bytes()[:20_000]
    source.write_bytes(cut)
    with pytest.raises(FlightLogError, match="exists"):
        repair(source, source)
    assert source.read_bytes() == cut
    done = run("companion", "repair", str(source))
    assert done.returncode == 0 and "lost: " in done.stdout and "cut off" in done.stdout
    assert source.read_bytes() == cut and LogReader(tmp_path / "flight_repaired.mcap").complete
    again = run("companion", "repair", str(source))
    assert again.returncode == 2 and len(again.stderr.splitlines()) == 1


def test_telemetry_logs_too(tmp_path: Path) -> None:
    content = bytearray((DATA / "px4_offboard.tlog").read_bytes())
    content[40_000] ^= 0x40
    source = tmp_path / "a.tlog"
    source.write_bytes(content[:-5])
    result = repair(source)
    assert result.target == tmp_path / "a_repaired.tlog" and result.lost
    good = {entry.data for entry in TlogReader(DATA / "px4_offboard.tlog").entries()}
    entries = list(TlogReader(result.target).entries())
    assert {entry.data for entry in entries} <= good and len(entries) == 8760 == result.kept
    assert repair(result.target).target is None


def attitude(number: int) -> bytes:
    return bytes(dialect.MAVLink_attitude_message(number, 0.1, 0, 0, 0, 0, 0).pack(dialect.MAVLink(None, 1, 1)))


def test_every_sound_frame_of_an_entry_is_kept(tmp_path: Path) -> None:
    """Where a stamp is missing, the frame behind it has that of the one before."""
    source = telemetry_log(tmp_path / "a.tlog", *(attitude(n) + attitude(n + 1) for n in range(0, 10, 2)))
    result = repair(source)
    assert result.target == tmp_path / "a_repaired.tlog" and result.kept == 10
    assert not any("no sound frame" in line for line in result.lost)
    entries = list(TlogReader(result.target).entries())
    assert [entry.data for entry in entries] == [attitude(number) for number in range(10)]
    assert [entry.time_us for entry in entries] == [entries[2 * (n // 2)].time_us for n in range(10)]
    assert repair(result.target).target is None


def test_a_whole_telemetry_log_needs_no_room(tmp_path: Path) -> None:
    source = telemetry_log(tmp_path / "a.tlog", attitude(1), attitude(2))
    (tmp_path / "a_repaired.tlog").write_text("mine")
    assert repair(source).target is None
    assert (tmp_path / "a_repaired.tlog").read_text() == "mine"


def test_the_greatest_time_is_told_and_not_the_last(tmp_path: Path) -> None:
    stamps = [9_000_000, 10_000_000, 14_500_000, 900_000]
    write(tmp_path / "a.tlog", (Entry(stamp, attitude(number)) for number, stamp in enumerate(stamps)))
    assert repair(tmp_path / "a.tlog").last_s == pytest.approx(13.6)


def test_what_is_empty_or_named_as_another_kind(many_chunks: Path, tmp_path: Path) -> None:
    cut, empty = tmp_path / "cut.mcap", tmp_path / "empty.tlog"
    cut.write_bytes(many_chunks.read_bytes()[:20_000])
    empty.touch()
    with pytest.raises(FlightLogError, match="an empty file"):
        repair(empty)
    with pytest.raises(FlightLogError, match=r"a\.tlog: .*cut\.mcap is repaired as what it is, a \.mcap"):
        repair(cut, tmp_path / "a.tlog")
    misnamed = cut.rename(tmp_path / "misnamed.tlog")
    assert repair(misnamed).target == tmp_path / "misnamed_repaired.mcap"
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".mcap", ".tlog", ".tlog"]


def test_a_disk_that_is_full_at_any_byte_leaves_no_file_and_no_descriptor(tmp_path: Path) -> None:
    """Also where the writer is not used as a context yet, as with a trace that is written again."""
    target, open_before = tmp_path / "full.mcap", len(list(DESCRIPTORS.iterdir()))
    noise = random.Random(7).randbytes(2000)
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)

    def write() -> None:
        writer = Writer(target, 0, {"m": {"a": "b" * 100}})
        writer.attach("x", noise)
        for number in range(300):  # more than a chunk
            writer.datagram(number, number, Direction.IN, "a", noise)
        with writer:
            writer.attach("y", noise)

    write()
    size = target.stat().st_size
    target.unlink()
    for limit in (10, 40, 70, 120, 1000, 4000, size - 10_000, size - 3000, size - 1):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, unlimited[1]))
        try:
            with pytest.raises(FlightLogError, match=f"^{target}: File too large$"):
                write()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        assert list(tmp_path.iterdir()) == []
    target.write_bytes(b"precious")
    with pytest.raises(FlightLogError, match="exists"):
        write()
    assert target.read_bytes() == b"precious"
    assert len(list(DESCRIPTORS.iterdir())) == open_before
