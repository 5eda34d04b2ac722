"""Encoders and decoders against pymavlink's own, for every message of its dialect."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from protocol.framing import Frame, Framer
from protocol.messages import Encoder, Field, decode, dialect, layout

SYSTEM, COMPONENT = 7, 42
LIMITS = {
    "int8_t": (-(2**7), 2**7 - 1),
    "uint8_t": (0, 2**8 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
    "uint64_t": (0, 2**64 - 1),
}
LARGEST_FLOAT = 3.4028234663852886e38
FLOATS = (LARGEST_FLOAT, -LARGEST_FLOAT, math.inf, -math.inf, math.nan, -0.0, 1e-45, 0.1)


def every_message(test: Callable[[int], None]) -> Callable[[], None]:
    """One test of all messages: a test of each would take longer to count than to run."""

    def all_of_them() -> None:
        for message_id in sorted(dialect.mavlink_map):
            try:
                test(message_id)
            except Exception as error:
                error.add_note(f"the message is {layout(message_id).name}")
                raise

    return all_of_them


def is_array(field: Field) -> bool:
    return field.array_length > 0 and field.type != "char"


def one_value(field: Field, kind: str, generator: random.Random) -> Any:
    if field.type in ("float", "double"):
        return {"zero": 0.0, "low": -math.inf, "high": math.nan}.get(kind, generator.choice(FLOATS))
    low, high = LIMITS[field.type]
    return {"zero": 0, "low": low, "high": high}.get(kind, generator.randint(low, high))


def value_of(field: Field, kind: str, generator: random.Random) -> Any:
    if field.type == "char":
        if kind in ("zero", "low"):
            return b""
        if kind == "high":
            return b"\xff" * field.array_length
        text = generator.randbytes(generator.randint(0, field.array_length))
        return text.replace(b"\x80", b"\x00")
    if not is_array(field):
        return one_value(field, kind, generator)
    values = [one_value(field, kind, generator) for _ in range(field.array_length)]
    if kind == "random":
        end = generator.randint(0, len(values))
        values[end:] = [0] * (len(values) - end)
    return values


def samples(message_id: int) -> list[list[Any]]:
    """Values in the constructor's order: all zero, the extremes, and some at random with zero tails."""
    generator = random.Random(message_id)
    fields = {field.name: field for field in layout(message_id).fields}
    names = dialect.mavlink_map[message_id].fieldnames
    kinds = ["zero", "low", "high", *["random"] * 4]
    return [[value_of(fields[name], kind, generator) for name in names] for kind in kinds]


def pymavlink() -> Any:
    return dialect.MAVLink(None, SYSTEM, COMPONENT)


def frame_of(data: bytes) -> Frame:
    (frame,) = Framer().datagram(data)
    assert frame.raw == data
    return frame


def received(data: bytes) -> Any:
    message = decode(frame_of(data))
    assert message is not None
    return message


def assert_same_message(ours: Any, theirs: Any) -> None:
    assert type(ours) is type(theirs)
    for name, value in vars(theirs._header).items():
        assert getattr(ours.get_header(), name) == value, name
    assert bytes(ours.get_msgbuf()) == bytes(theirs.get_msgbuf())
    not_values = {"_header", "_msgbuf", "_payload"}  # pymavlink's _payload of a received v2 frame begins in the header
    assert vars(ours).keys() == vars(theirs).keys()
    for name in vars(theirs).keys() - not_values:
        mine, reference = getattr(ours, name), getattr(theirs, name)
        assert (type(mine), repr(mine)) == (type(reference), repr(reference)), name  # repr: NaN and -0.0 count too
    assert repr(ours.to_dict()) == repr(theirs.to_dict())
    assert str(ours) == str(theirs)


@every_message
def test_encodes_as_pymavlink_does(message_id: int) -> None:
    message_class = dialect.mavlink_map[message_id]
    ours, fields_only, theirs = Encoder(SYSTEM, COMPONENT), Encoder(SYSTEM, COMPONENT), pymavlink()
    for values in samples(message_id):
        message = message_class(*values)
        expected = message.pack(theirs)
        theirs.seq = (theirs.seq + 1) % 256
        assert ours.encode(message) == expected
        assert fields_only.encode_fields(message_class, *values) == expected


@every_message
def test_decodes_as_pymavlink_does(message_id: int) -> None:
    message_class = dialect.mavlink_map[message_id]
    theirs = pymavlink()
    for values in samples(message_id):
        message = message_class(*values)
        datagrams = [message.pack(theirs)]
        if message_id < 256:
            datagrams.append(message.pack(theirs, force_mavlink1=True))
        for data in datagrams:
            assert_same_message(received(data), theirs.parse_char(data))
        theirs.seq = (theirs.seq + 3) % 256


@every_message
def test_decodes_payloads_of_any_length(message_id: int) -> None:
    """Cut anywhere (an older sender, or zeros) and longer than the dialect knows (a newer one)."""
    shape = layout(message_id)
    full = random.Random(message_id).randbytes(255)
    theirs = pymavlink()
    for length in sorted({0, 1, shape.size // 2, shape.size - 1, shape.size, min(255, shape.size + 5)}):
        body = bytes((length, 0, 0, 200, SYSTEM, COMPONENT)) + message_id.to_bytes(3, "little") + full[:length]
        checksum = dialect.x25crc(body + bytes((shape.crc_extra,))).crc
        data = b"\xfd" + body + checksum.to_bytes(2, "little")
        message = received(data)
        assert_same_message(message, theirs.parse_char(data))
        assert message.get_payload() == full[:length]


@every_message
def test_what_is_decoded_encodes_to_the_same_bytes(message_id: int) -> None:
    encoder, again = Encoder(SYSTEM, COMPONENT), Encoder(SYSTEM, COMPONENT)
    for values in samples(message_id):
        data = encoder.encode_fields(dialect.mavlink_map[message_id], *values)
        assert again.encode(received(data)) == data


@every_message
def test_extensions_may_be_left_out(message_id: int) -> None:
    message_class = dialect.mavlink_map[message_id]
    values = samples(message_id)[-1]
    given = values[: len(values) - len(message_class.__init__.__defaults__ or ())]
    expected = message_class(*given).pack(pymavlink())
    assert Encoder(SYSTEM, COMPONENT).encode_fields(message_class, *given) == expected


@every_message
def test_the_layout_reads_a_full_payload(message_id: int) -> None:
    shape = layout(message_id)
    assert shape.size == dialect.mavlink_map[message_id].unpacker.size
    values = samples(message_id)[-1]
    frame = frame_of(Encoder(SYSTEM, COMPONENT).encode_fields(dialect.mavlink_map[message_id], *values))
    message = decode(frame)
    payload = frame.payload.ljust(shape.size, b"\0")
    letters = dict(zip(LIMITS, "bBhHiIqQ", strict=True)) | {"float": "f", "double": "d", "char": "s"}
    for field in shape.fields:
        form = f"<{field.array_length or ''}{letters[field.type]}"
        read = struct.unpack_from(form, payload)
        payload = payload[struct.calcsize(form) :]
        if field.type == "char":
            assert read[0].rstrip(b"\0") == getattr(message, f"_{field.name}_raw")
        else:
            assert repr(list(read) if is_array(field) else read[0]) == repr(getattr(message, field.name))
    assert payload == b""


def test_layout_has_extensions_after_the_base_in_wire_order() -> None:
    shape = layout(dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR)
    assert (shape.message_id, shape.name, shape.size, shape.crc_extra) == (132, "DISTANCE_SENSOR", 39, 85)
    assert shape.fields[0] == Field("time_boot_ms", "uint32_t", 0)
    assert shape.fields[1] == Field("min_distance", "uint16_t", 0)
    assert shape.fields[-2:] == (Field("quaternion", "float", 4), Field("signal_quality", "uint8_t", 0))
    with pytest.raises(KeyError):
        layout(54321)


def test_sender_and_sequence_are_the_encoders() -> None:
    encoder = Encoder(SYSTEM, COMPONENT)
    frames = [frame_of(encoder.encode_fields(dialect.MAVLink_timesync_message, 0, i)) for i in range(600)]
    assert [frame.sequence for frame in frames] == [i % 256 for i in range(600)]
    message = received(frames[-1].raw)
    assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (SYSTEM, COMPONENT, 599 % 256)
    assert (message.get_type(), message.get_msgId(), message.ts1) == ("TIMESYNC", 111, 599)


def test_encoding_leaves_the_message_alone() -> None:
    message = dialect.MAVLink_timesync_message(1, 2)
    before = dict(vars(message))
    Encoder(SYSTEM, COMPONENT).encode(message)
    assert vars(message) == before


def test_arrays_may_be_numpys() -> None:
    ranges = np.arange(20, 92, dtype=np.uint16)
    fields = (1, 0, ranges, 5, 20, 1500, np.float64(5.0), 0.0, 12)
    expected = dialect.MAVLink_obstacle_distance_message(1, 0, ranges.tolist(), 5, 20, 1500, 5.0, 0.0, 12)
    data = Encoder(SYSTEM, COMPONENT).encode_fields(dialect.MAVLink_obstacle_distance_message, *fields)
    assert data == expected.pack(pymavlink())


@pytest.mark.parametrize(
    ("message_class", "fields", "named"),
    [
        (dialect.MAVLink_heartbeat_message, (2, 256, 0, 0, 4, 3), r"HEARTBEAT\.autopilot: 256 .* uint8_t"),
        (dialect.MAVLink_heartbeat_message, (2, 12, 0, -1, 4, 3), r"HEARTBEAT\.custom_mode: -1 .* uint32_t"),
        (dialect.MAVLink_heartbeat_message, (2, 12, 0, 1.5, 4, 3), r"HEARTBEAT\.custom_mode: 1\.5 "),
        (dialect.MAVLink_attitude_message, (0, 0, 1e39, 0, 0, 0, 0), r"ATTITUDE\.pitch: 1e\+39 .* float"),
        (dialect.MAVLink_attitude_message, (0, 0, None, 0, 0, 0, 0), r"ATTITUDE\.pitch: None "),
        (dialect.MAVLink_statustext_message, (6, "text"), r"STATUSTEXT\.text: 'text' .* char\[50\]"),
        (
            dialect.MAVLink_set_attitude_target_message,
            (0, 1, 1, 7, (1.0, 0.0, 0.0), 0, 0, 0, 0.5),
            r"SET_ATTITUDE_TARGET\.q: .* float\[4\]",
        ),
        (
            dialect.MAVLink_set_attitude_target_message,
            (0, 1, 1, 7, None, 0, 0, 0, 0.5),
            r"SET_ATTITUDE_TARGET\.q: None ",
        ),
        (
            dialect.MAVLink_battery_status_message,  # two arrays whose wrong lengths make up for each other
            (0, 0, 0, 0, [1] * 9, 0, 0, 0, 0, 0, 0, [1] * 5, 0, 0),
            r"BATTERY_STATUS\.voltages: .* uint16_t\[10\]",
        ),
    ],
)
def test_a_value_that_does_not_fit_is_named(message_class: Any, fields: tuple[Any, ...], named: str) -> None:
    encoder = Encoder(SYSTEM, COMPONENT)
    with pytest.raises(ValueError, match=named):
        encoder.encode_fields(message_class, *fields)
    assert encoder.sequence == 0


def test_a_message_with_a_value_that_does_not_fit_is_named() -> None:
    message = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 300, 3)
    with pytest.raises(ValueError, match=r"HEARTBEAT\.system_status: 300"):
        Encoder(SYSTEM, COMPONENT).encode(message)


def test_a_wrong_number_of_fields_is_a_type_error() -> None:
    with pytest.raises(TypeError, match="HEARTBEAT"):
        Encoder(SYSTEM, COMPONENT).encode_fields(dialect.MAVLink_heartbeat_message, 2, 12)


def test_texts_are_cut_as_pymavlink_does() -> None:
    message = dialect.MAVLink_statustext_message(6, b"x" * 60)
    assert Encoder(SYSTEM, COMPONENT).encode(message) == message.pack(pymavlink())


def test_what_is_no_message_is_refused() -> None:
    encoder = Encoder(SYSTEM, COMPONENT)
    with pytest.raises(ValueError, match="no message of the dialect"):
        encoder.encode(dialect.MAVLink_unknown(54321, b""))
    with pytest.raises(ValueError, match="no message of the dialect"):
        encoder.encode_fields(int, 3)


@pytest.mark.parametrize("ids", [(0, 1), (1, 0), (256, 1), (1, -1)])
def test_impossible_senders_are_refused(ids: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=f"{ids[0]}/{ids[1]}"):
        Encoder(*ids)


def test_an_unknown_message_decodes_to_none() -> None:
    body = bytes((1, 0, 0, 0, SYSTEM, COMPONENT)) + (54321).to_bytes(3, "little") + b"x"
    frame = frame_of(b"\xfd" + body + b"\x00\x00")
    assert not frame.known
    assert decode(frame) is None


@pytest.mark.parametrize("flags", [(0, 0), (0, 3), (1, 0), (1, 255)])
def test_the_header_is_pymavlinks(flags: tuple[int, int]) -> None:
    body = bytes((2, *flags, 9, SYSTEM, COMPONENT)) + (111).to_bytes(3, "little") + b"xy"
    checksum = dialect.x25crc(body + bytes((dialect.MAVLink_timesync_message.crc_extra,))).crc
    data = b"\xfd" + body + checksum.to_bytes(2, "little") + b"s" * 13 * flags[0]
    assert_same_message(received(data), pymavlink().parse_char(data))


def test_a_message_can_be_sent_on_by_pymavlink() -> None:
    """Its header is the frame, which must do for pymavlink's own packing."""
    theirs = pymavlink()
    theirs.seq = 5
    data = dialect.MAVLink_timesync_message(1, 2).pack(theirs)
    assert received(data).pack(theirs) == data


def test_pymavlink_uses_fastcrc_here_too() -> None:
    assert dialect.mcrf4xx is not None
