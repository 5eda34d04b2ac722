"""The buffer between the flying process and the recorder: both ends in one process, and then in two."""

import os
import random
import signal
from collections.abc import Callable

import pytest

from protocol.flightlog import (
    LogReader,
    read,
)
from protocol.flightlog.mcap_format import MESSAGE_HEADER, message_record
from protocol.flightlog.shared_buffer import (
    DROPPED,
    FAILED,
    HEAD,
    STATE,
    BufferReader,
    BufferWriter,
    Setup,
    allocate,
    decode_metadata,
    encode_metadata,
)
from tests.protocol.flightlog.made_logs import (
    COUNT,
    EPOCH_NS,
    Opener,
    count,
    numbers_of,
    until,
)


def ends(size: int, *, waits: bool = False, is_lost: Callable[[], bool] = bool) -> tuple[BufferWriter, BufferReader]:
    descriptor, memory = allocate(size)
    os.close(descriptor)
    return BufferWriter(memory, EPOCH_NS, waits=waits, is_lost=is_lost), BufferReader(memory)


@pytest.mark.parametrize("size", [256, 1024, 4096])
def test_all_that_is_put_comes_out_in_order_whatever_the_sizes(size: int) -> None:
    """Records as they are, unless they were dropped, which is counted and leaves a gap in the sequence."""
    generator = random.Random(size)
    writer, reader = ends(size)
    expected: list[tuple[int, int, int, bytes]] = []
    found: list[tuple[int, int, int, bytes]] = []
    for number in range(3000):
        data = generator.randbytes(generator.randrange(size))
        dropped = writer.words[DROPPED]
        writer.put(7, number, data)
        if writer.words[DROPPED] == dropped:
            expected.append((7, number, EPOCH_NS + number, message_record(7, number, EPOCH_NS + number, data)))
        if generator.random() < 0.5:
            found += reader.records(writer.words[HEAD])
            reader.release()
    found += reader.records(writer.words[HEAD])
    assert found == expected
    assert 500 < len(found) == 3000 - writer.words[DROPPED] < 3000


def test_room_is_free_again_only_after_it_is_released() -> None:
    writer, reader = ends(256)
    data = bytes(256 - MESSAGE_HEADER.size)
    writer.put(7, 0, data)
    assert len(list(reader.records(writer.words[HEAD]))) == 1
    writer.put(7, 1, data)
    assert writer.words[DROPPED] == 1
    reader.release()
    writer.put(7, 2, data)
    assert [sequence for _, sequence, _, _ in reader.records(writer.words[HEAD])] == [2]


def test_a_full_buffer_is_waited_for_until_it_is_lost() -> None:
    asked = iter([False, False, True])
    writer, _ = ends(256, waits=True, is_lost=lambda: next(asked))
    for number in range(2):
        writer.put(7, number, bytes(200))
    assert writer.words[DROPPED] == 1 and next(asked, None) is None


def test_a_fault_is_told_whole_or_cut_to_its_room() -> None:
    writer, reader = ends(256)
    reader.fail("no space left")
    assert writer.words[STATE] == FAILED and writer.fault_text == "no space left"
    reader.fail("x" * 5000)
    assert 500 < len(writer.fault_text) < 1000 and set(writer.fault_text) == {"x"}


def test_a_size_that_is_no_power_of_two_is_refused() -> None:
    with pytest.raises(ValueError, match="buffer_bytes: 300 is no power of two"):
        allocate(300)


def test_what_goes_to_the_recorder_is_decoded_as_it_was() -> None:
    types = [("/t", "x/X", "uint8 a\n")]
    setup = Setup(b"/tmp/x\xe9", 5, {"m": {"k": "ü"}}, {"a": b"\x00\xff"}, types, True, 7, False, True)
    assert Setup.decode(setup.encode()) == setup
    assert decode_metadata(encode_metadata("name", {"k": "v"})) == ("name", {"k": "v"})


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
