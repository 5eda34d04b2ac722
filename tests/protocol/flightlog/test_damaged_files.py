"""Reading logs that are cut off, damaged or no logs at all."""

import contextlib
import itertools
import random
import struct
import tracemalloc
import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.records import (
    Attachment,
    DataEnd,
    Footer,
    McapRecord,
    Metadata,
)

from protocol.flightlog import (
    MAGIC,
    FlightLogError,
    LogReader,
    Record,
)
from protocol.flightlog.chunks import decompressed
from protocol.flightlog.file_bytes import FileBytes
from protocol.flightlog.mcap_format import message_record
from tests.protocol.flightlog.made_logs import (
    DEFINITION,
    chunk_ends,
    chunked,
    encoded,
    written,
)

A_SLICE = 40_000
"""Bytes that are enough for a compressed slice (16 KiB) and what frames a chunk."""


def test_cuts_lose_little_of_a_chunk_and_nothing_before_it(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    whole, reader = written(finished, path)
    assert reader.problem is None
    ends = chunk_ends(path)
    assert len(ends) >= 3
    assert ends[-1][1] == len(whole)
    generator = random.Random(10)
    cuts = [generator.randrange(len(finished)) for _ in range(25)]
    cuts += [0, 1, 8, 9, *(end + by for end, _ in ends for by in (-1, 0, 1)), len(finished) - 1]
    for cut in cuts:
        records, reader = written(finished[:cut], path)
        assert records == whole[: len(records)], cut
        assert len(records) >= max((messages for end, messages in ends if end <= cut), default=0), cut
        assert sum(31 + len(record.data) for record in records) >= min(cut, ends[-1][0]) - A_SLICE, cut
        assert not reader.complete
        assert reader.problem is not None


def test_flipped_bits_are_found(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    whole, _ = written(finished, path)
    contents = {(record.topic, record.sequence): record.data for record in whole}
    summary = struct.unpack_from("<Q", finished, len(finished) - 28)[0]
    generator = random.Random(11)
    bits = [generator.randrange(8 * len(finished)) for _ in range(20)]
    bits += [generator.randrange(8 * (summary - 13), 8 * len(finished)) for _ in range(30)]
    bits += [generator.randrange(64, 8 * 1000) for _ in range(20)]
    for bit in bits:
        damaged = bytearray(finished)
        damaged[bit // 8] ^= 1 << bit % 8
        try:
            records, reader = written(bytes(damaged), path)
        except FlightLogError:
            pytest.fail(f"not readable with bit {bit} flipped")
        assert reader.problem is not None, f"bit {bit} at byte {bit // 8} of {len(finished)}"
        assert all(contents[record.topic, record.sequence] == record.data for record in records)
        assert len(records) >= len(whole) * 0.4, f"bit {bit}"


def test_flip_in_an_unfinished_file_costs_its_chunk_alone(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    whole, _ = written(finished, path)
    ends = chunk_ends(path)
    (_, first), (second_end, second) = ends[:2]
    cut = ends[-1][0]
    for place in (second_end - 500, ends[0][0] + 3):  # within the second chunk, and in what frames it
        damaged = bytearray(finished[:cut])
        damaged[place] ^= 0x10
        records, reader = written(bytes(damaged), path)
        assert records in (whole[:first] + whole[second:], whole), place
        assert reader.problem is not None
        if place > ends[0][0] + 100:
            assert records != whole
            assert "damaged" in reader.problem


def test_a_message_longer_than_its_chunk_is_damage_and_those_before_it_are_kept(tmp_path: Path) -> None:
    first, last = (message_record(1, 0, 0, bytes(length)) for length in (8, 1000))
    content = DEFINITION + first + last[:-1]
    records, reader = written(chunked(content), tmp_path / "long.mcap")
    assert records == [Record("/x", 0, 0, bytes(8))]
    assert "something else than messages" in str(reader.problem)
    records, reader = written(chunked(content + b"\0"), tmp_path / "long.mcap")
    assert len(records) == 2
    assert str(reader.problem).endswith(f"cut off at byte {reader.path.stat().st_size}")


def test_what_unpacks_to_more_than_its_chunk_is_refused_before_it_does(tmp_path: Path) -> None:
    """With the frame's own size in it and without, whole and cut."""
    many = DEFINITION + bytes(1 << 26)
    stated, unstated = (zstandard.ZstdCompressor(write_content_size=states).compress(many) for states in (True, False))
    for packed in (stated, unstated):
        with pytest.raises(zstandard.ZstdError):
            decompressed(packed, 10)
        for cut in (0, 1000):
            path = tmp_path / "bomb.mcap"
            path.write_bytes(chunked(b"", packed=packed, size=100, cut=cut))
            tracemalloc.start()
            reader = LogReader(path)
            assert list(reader.records()) == []
            most = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert most < 30_000_000
            assert ("cut off at byte" if cut else "is damaged") in str(reader.problem)


@pytest.mark.parametrize("end", [DataEnd(1), Footer(1, 0, 1)])
def test_the_data_is_summed_once_however_many_ends_there_are(
    end: McapRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summed = []
    crc = FileBytes.crc

    def counted(data: FileBytes, start: int, stop: int) -> int:
        summed.append(stop - start)
        return crc(data, start, stop)

    monkeypatch.setattr(FileBytes, "crc", counted)
    _, reader = written(chunked(DEFINITION) + 1000 * encoded(end) + MAGIC, tmp_path / "ends.mcap")
    assert len(summed) <= 1
    assert reader.problem is not None


def test_no_content_of_a_chunk_raises_anything(tmp_path: Path) -> None:
    """Bytes changed below the checksums: the reader knows nothing of the damage, and stumbles over none of it."""
    messages = b"".join(message_record(1, number, number, bytes(8)) for number in range(3))
    attachment = encoded(Attachment(0, 0, "a", "b", b"c"))
    content = DEFINITION + messages + encoded(Metadata("m", {"k": "v"})) + attachment + messages
    lies = [bytes(8), b"\xff" * 8, b"\xff" * 7 + b"\x7f", b"\x01" + bytes(7)]
    lies += [b"\0", b"\1", *(b"\xff" * size for size in (1, 2, 4))]
    for place, lie in itertools.product(range(len(content)), lies):
        damaged = content[:place] + lie + content[place + len(lie) :]
        _, reader = written(chunked(damaged), tmp_path / "lie.mcap")
        for topic in reader.topics:
            with contextlib.suppress(FlightLogError):
                reader.array(topic)


def test_an_attachment_longer_than_any_file(tmp_path: Path) -> None:
    attachment = bytearray(encoded(Attachment(0, 0, "a", "b", b"c"))[:-4])
    attachment[-9:-1] = b"\xff" * 8
    attachment += struct.pack("<I", zlib.crc32(attachment[9:]))
    _, reader = written(chunked(DEFINITION) + attachment, tmp_path / "long.mcap")
    assert reader.attachments == {} and "cut off at byte" in str(reader.problem)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "no.mcap"
    with pytest.raises(FlightLogError, match="No such file"):
        LogReader(path)
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(FlightLogError, match="not an MCAP file"):
        LogReader(path)
