"""Ground stations by MAVLink's routing rules: who is sent what, and how little of it a flood can take."""

import math
from typing import Any

import pytest

from companion.link.telemetry import FLOWN_BY, Telemetry
from companion.runtime.files import load_settings
from companion.runtime.router import Router, Station, packed
from protocol.framing import Frame, Framer
from protocol.listeners import readable
from protocol.messages import Encoder, dialect
from protocol.routing import target_of
from protocol.transport import Memory, Tcp, TransportError

TICK = 4_000_000
VEHICLE, COMPANION, GCS, OTHER = Encoder(1, 1), Encoder(1, 191), Encoder(255, 190), Encoder(254, 190)
CAMERA = Encoder(1, 100)


def heartbeat(sender: Encoder) -> bytes:
    return sender.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, 0, 4, 3)


def command(sender: Encoder, system: int, component: int, number: int = 400) -> bytes:
    return sender.encode_fields(dialect.MAVLink_command_long_message, system, component, number, 0, *[0.0] * 7)


def ack(sender: Encoder, system: int, component: int) -> bytes:
    return sender.encode_fields(dialect.MAVLink_command_ack_message, 400, 0, 0, 0, system, component)


def timesync(sender: Encoder) -> bytes:
    return sender.encode_fields(dialect.MAVLink_timesync_message, 0, 5)


class Net:
    """A router with stations whose other ends are here."""

    def __init__(self, count: int = 2, bytes_per_s: float = 1e6) -> None:
        pairs = [Memory.pair() for _ in range(count)]
        self.ends = [far for _, far in pairs]
        self.router = Router([Station(f"s{k}", near) for k, (near, _) in enumerate(pairs)], bytes_per_s=bytes_per_s)
        self.now = 0
        self.router.heard(heartbeat(VEHICLE))
        self.router.said(heartbeat(COMPANION))
        self.pump()
        for end in self.ends:
            received(end)

    def pump(self) -> list[bytes]:
        """A tick; the frames that go to the vehicle."""
        self.now += TICK
        return [frame.raw for _, data in self.router.pump(self.now) for frame in Framer().datagram(data)]


def received(end: Memory) -> list[bytes]:
    """All frames that have come there."""
    frames: list[bytes] = []
    while (data := end.receive(0.0)) is not None:
        frames += [frame.raw for frame in Framer().datagram(data)]
    return frames


def frame_of(data: bytes) -> Frame:
    (frame,) = Framer().datagram(data)
    return frame


def test_whom_a_message_is_for() -> None:
    assert target_of(frame_of(command(GCS, 1, 1))) == (1, 1)
    assert target_of(frame_of(command(GCS, 7, 0))) == (7, 0)
    assert target_of(frame_of(heartbeat(GCS))) == (0, 0)
    assert target_of(frame_of(ack(VEHICLE, 255, 190))) == (255, 190)
    cut = VEHICLE.encode_fields(dialect.MAVLink_command_ack_message, 400, 0)
    assert target_of(frame_of(cut)) == (0, 0), "the bytes of the target are cut off as zeros"


def test_the_target_of_every_message_is_where_pymavlink_puts_it() -> None:
    for message in dialect.mavlink_map.values():
        if message.id == dialect.MAVLINK_MSG_ID_SETUP_SIGNING:
            continue
        fields: list[Any] = []
        for name, kind, length in zip(
            message.fieldnames, message.fieldtypes, [message.lengths[k] for k in message.orders], strict=True
        ):
            value: Any = {"target_system": 77, "target_component": 88}.get(name, 1)
            fields.append(b"x" if kind == "char" else [value] * length if length > 1 else value)
        packed_by_pymavlink = message(*fields).pack(dialect.MAVLink(None, 3, 4))
        frame = frame_of(bytes(packed_by_pymavlink))
        expected = 77 * ("target_system" in message.fieldnames), 88 * ("target_component" in message.fieldnames)
        assert target_of(frame) == expected, message.msgname


def test_telemetry_goes_to_all_stations_and_an_answer_to_the_one_that_asked() -> None:
    net = Net()
    for end, sender in zip(net.ends, (GCS, OTHER), strict=True):
        end.send(heartbeat(sender))
    net.pump()
    for end in net.ends:
        received(end)
    telemetry, answer, stranger = heartbeat(VEHICLE), ack(VEHICLE, 255, 190), ack(VEHICLE, 9, 9)
    net.router.heard(telemetry + answer + stranger)
    net.pump()
    assert received(net.ends[0]) == [telemetry, answer]
    assert received(net.ends[1]) == [telemetry]


def test_what_the_companion_says_to_all_goes_to_the_stations_and_its_setpoints_do_not() -> None:
    net = Net()
    beat, text = heartbeat(COMPANION), COMPANION.encode_fields(dialect.MAVLink_statustext_message, 6, b"armed")
    net.router.said(command(COMPANION, 1, 1) + beat + timesync(COMPANION) + text)
    net.pump()
    assert received(net.ends[0]) == received(net.ends[1]) == [beat, text]


def test_a_stations_commands_reach_the_vehicle_and_whoever_was_heard_there() -> None:
    net = Net()
    wanted = command(GCS, 1, 1), command(GCS, 1, 0), command(GCS, 0, 0), heartbeat(GCS)
    for data in (*wanted, command(GCS, 1, 100), command(GCS, 2, 1), command(GCS, 1, 191), timesync(GCS)):
        net.ends[0].send(data)
        net.ends[0].send(b"\xfd" * 3)
    sent = [frame for _ in range(8) for frame in net.pump()]
    assert sent == [*wanted], "no camera, no other system, not the companion's own, and no clock"
    net.router.heard(heartbeat(CAMERA))
    net.pump()
    camera = command(GCS, 1, 100)
    net.ends[0].send(camera)
    assert net.pump() == [camera]
    stations = received(net.ends[1])
    assert stations[:2] == [wanted[2], wanted[3]] and heartbeat(CAMERA)[10:12] in stations[2], "broadcasts alone"


def test_nothing_comes_back_to_where_it_came_from() -> None:
    net = Net()
    own = heartbeat(GCS)
    net.ends[0].send(own)
    assert net.pump() == [own]
    assert received(net.ends[0]) == []
    net.router.heard(heartbeat(GCS))  # a vehicle that hands on what it hears
    net.pump()
    assert received(net.ends[0]) == [] and len(received(net.ends[1])) == 2
    for echo in (heartbeat(VEHICLE), heartbeat(COMPANION)):
        net.ends[1].send(echo)
        assert net.pump() == [] and received(net.ends[0]) == [], "nobody plays the vehicle or the companion"


def test_two_stations_with_the_same_ids_are_both_served() -> None:
    net = Net()
    for end in net.ends:
        end.send(heartbeat(GCS))
    net.pump()
    answer = ack(VEHICLE, 255, 190)
    net.router.heard(answer)
    net.pump()
    assert answer in received(net.ends[0]) and answer in received(net.ends[1])


def test_a_companion_that_spoke_before_this_one_did_hears_it_all_the_same() -> None:
    """Two with the same ids: the second one, behind a station, must hear that the first one flies."""
    near, far = Memory.pair()
    router = Router([Station("hub", near)], bytes_per_s=1e6)
    router.heard(heartbeat(VEHICLE))
    router.pump(TICK)
    received(far)
    far.send(heartbeat(COMPANION))
    assert router.pump(2 * TICK), "nobody else has that name yet"
    ours = heartbeat(COMPANION)
    router.said(ours)
    router.pump(3 * TICK)
    assert received(far) == [ours]
    far.send(command(COMPANION, 1, 1))
    assert router.pump(4 * TICK) == [], "and can't command"


def test_keys_are_nobodys_business() -> None:
    net = Net()
    key = GCS.encode_fields(dialect.MAVLink_setup_signing_message, 1, 1, [7] * 32, 9)
    net.ends[0].send(key)
    assert net.pump() == [] and received(net.ends[1]) == []


def test_messages_that_the_dialect_lacks_are_carried_whole() -> None:
    net = Net()
    unknown = bytes((0xFD, 3, 0, 0, 9, 1, 1, 0x9A, 0x01, 0)) + b"abc" + b"\x12\x34"
    net.router.heard(heartbeat(VEHICLE) + unknown)
    net.pump()
    assert received(net.ends[0])[1] == unknown


def test_a_flood_takes_no_more_than_its_share() -> None:
    """Ten thousand datagrams a second for two seconds; the other station's commands come through."""
    net = Net(bytes_per_s=20_000.0)
    flood, wanted, forwarded, commands = heartbeat(GCS), command(OTHER, 1, 1), 0, 0
    for tick in range(500):
        for _ in range(40):
            net.ends[0].send(flood)
        if tick % 50 == 0:
            net.ends[1].send(wanted)
        sent = net.pump()
        assert len(sent) <= 5
        commands += sent.count(wanted)
        forwarded += len(sent) * len(flood)
        received(net.ends[1])
    assert commands == 10
    assert forwarded < 20_000 * 2.5 + 2000, "two seconds' share and the burst"


def test_a_command_is_not_late_behind_more_than_a_slow_link_carries() -> None:
    """RTK corrections with 1.9 kB/s over a link on which the station has 1.2: a command comes within a second of being
    sent, or not at all. The station is told so once."""
    net = Net(1, bytes_per_s=1152.0)
    corrections = GCS.encode_fields(dialect.MAVLink_gps_rtcm_data_message, 0, 180, bytes(range(1, 181)))
    asked, came = dict[bytes, int](), dict[bytes, int]()
    for tick in range(60 * 250):
        if tick % 25 == 0:
            net.ends[0].send(corrections)
        if tick % 250 == 0:
            wanted = command(GCS, 1, 1, tick)
            net.ends[0].send(wanted)
            asked[wanted] = tick
        came |= {frame: tick for frame in net.pump() if frame in asked}
    assert len(came) > 0.4 * len(asked)
    assert max(came[each] - asked[each] for each in came) <= 251
    (told,) = net.router.troubles()
    assert "more than the 1152 bytes a second" in told


def test_what_came_before_a_caller_left_is_sent_on() -> None:
    near, far = Memory.pair()
    near.__class__ = Leaving
    router = Router([Station("s0", near)])
    router.heard(heartbeat(VEHICLE))
    router.pump(TICK)
    wanted = command(GCS, 1, 1)
    far.send(wanted)
    assert [data for _, data in router.pump(2 * TICK)] == [wanted]
    assert router.troubles() == ["ground station s0 is gone: closed"]


def test_a_flood_of_senders_and_of_telemetry_is_bounded() -> None:
    net = Net(1)
    for system in range(2, 250):
        net.ends[0].send(heartbeat(Encoder(system, 1)))
        net.pump()
    assert len(net.router.stations[0].seen) <= 64
    for _ in range(10_000):
        net.router.heard(heartbeat(VEHICLE))
    net.pump()
    assert net.router.left_out > 0 and len(received(net.ends[0])) < 4000


def test_what_was_commanded_while_the_loop_stood_still_is_old() -> None:
    net = Net()
    old, new = command(GCS, 1, 1, 176), command(GCS, 1, 1, 400)
    net.ends[0].send(old)
    net.now += 2_000_000_000
    assert net.pump() == []
    net.ends[0].send(new)
    assert net.pump() == [new]


def test_what_a_stream_brought_before_the_flight_or_in_a_gap_of_it_is_old() -> None:
    listener = Tcp("127.0.0.1", 0, listen=True)
    router = Router([Station("tcpin", listener)], bytes_per_s=1e6)
    caller = Tcp("127.0.0.1", listener.port, listen=False)
    old, held, new = (command(GCS, 1, 1, number) for number in (176, 400, 512))

    def sent_on(now: int) -> list[bytes]:
        router.heard(heartbeat(VEHICLE))
        return [data for tick in range(3) for _, data in router.pump(now + tick * TICK)]

    caller.send(old)
    assert readable([listener.fileno()], 10.0)
    router.begin()
    assert sent_on(TICK) == []
    caller.send(held)
    assert readable([listener.fileno()], 10.0) and sent_on(2_000_000_000) == []
    caller.send(new)
    assert readable([listener.fileno()], 10.0) and sent_on(2_100_000_000) == [new]
    router.close()
    caller.close()


class Leaving(Memory):
    """Its caller leaves after what it has sent; a tick without anything is none."""

    heard = False

    def receive(self, timeout_s: float) -> bytes | None:
        data = super().receive(timeout_s)
        if data is None and self.heard:
            raise TransportError("closed")
        self.heard = self.heard or data is not None
        return data


class Broken(Memory):
    """A link that is gone."""

    def receive(self, timeout_s: float) -> bytes | None:
        raise TransportError("unplugged")


def test_a_station_that_fails_is_told_once_and_the_others_go_on() -> None:
    near, far = Memory.pair()
    broken, _ = Memory.pair()
    broken.__class__ = Broken
    router = Router([Station("bad", broken), Station("good", near)])
    for tick in range(1, 4):
        router.heard(heartbeat(VEHICLE))
        router.pump(tick * TICK)
    assert len(received(far)) == 3
    assert router.troubles() == ["ground station bad is gone: unplugged"] and router.troubles() == []


def test_a_station_that_calls_by_tcp_may_leave_and_call_again() -> None:
    listener = Tcp("127.0.0.1", 0, listen=True)
    port = listener.port
    router = Router([Station("tcpin", listener, lambda: Tcp("127.0.0.1", port, listen=True))], bytes_per_s=1e6)
    now = 0
    for _ in range(2):
        caller = Tcp("127.0.0.1", port, listen=False)
        beat = heartbeat(GCS)
        caller.send(beat)
        router.heard(heartbeat(VEHICLE))
        sent: list[tuple[str, bytes]] = []
        while not sent:
            now += TICK
            sent = router.pump(now)
        assert [data for _, data in sent] == [beat]
        router.heard(heartbeat(VEHICLE))
        router.pump(now)
        assert caller.receive(10.0)
        caller.close()
        while not router.troubles():
            now += TICK
            router.pump(now)
        now += 1_000_000_000
        router.pump(now)  # it listens again
    router.close()


def test_frames_are_packed_in_their_order_and_never_cut() -> None:
    frames = [bytes([k]) * 280 for k in range(10)]
    datagrams = packed(frames)
    assert b"".join(datagrams) == b"".join(frames) and all(len(each) <= 1200 for each in datagrams)
    assert packed([]) == []


def interval(kind: type[Any], message_id: float, interval_us: float) -> bytes:
    """SET_MESSAGE_INTERVAL as either command."""
    number = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    if kind is dialect.MAVLink_command_int_message:
        return GCS.encode_fields(kind, 1, 1, 0, number, 0, 0, message_id, interval_us, 0.0, 0.0, 0, 0, 0.0)
    return GCS.encode_fields(kind, 1, 1, number, 0, message_id, interval_us, *[0.0] * 5)


@pytest.mark.parametrize("kind", [dialect.MAVLink_command_long_message, dialect.MAVLink_command_int_message])
def test_no_station_changes_the_rates_of_what_is_flown_by(kind: type[Any]) -> None:
    """The flight was lost within half a second of such a request."""
    net = Net()
    for message_id in FLOWN_BY:
        net.ends[0].send(interval(kind, float(message_id), -1.0))
        assert net.pump() == []
    (told,) = net.router.troubles()
    assert "s0 asks for another rate of" in told
    for other in (float(dialect.MAVLINK_MSG_ID_GPS_RAW_INT), math.nan, math.inf):
        net.ends[0].send(asked := interval(kind, other, -1.0))
        assert net.pump() == [asked]
    assert net.router.troubles() == []


def test_no_station_asks_for_a_stream_of_what_is_flown_by() -> None:
    """ArduPilot takes the rate of a stream for all of its messages."""
    net = Net()

    def stream(number: int) -> bytes:
        return GCS.encode_fields(dialect.MAVLink_request_data_stream_message, 1, 1, number, 2, 1)

    for number in (dialect.MAV_DATA_STREAM_ALL, dialect.MAV_DATA_STREAM_POSITION, dialect.MAV_DATA_STREAM_EXTRA3):
        net.ends[0].send(stream(number))
        assert net.pump() == []
    (told,) = net.router.troubles()
    assert "s0 asks for another rate of LOCAL_POSITION_NED" in told
    net.ends[0].send(asked := stream(dialect.MAV_DATA_STREAM_EXTENDED_STATUS))
    assert net.pump() == [asked] and net.router.troubles() == []


def test_all_that_a_flight_needs_is_flown_by() -> None:
    settings = load_settings(None, ["avoidance.ground_slope=0.1"])
    assert Telemetry(settings).rates.wanted.keys() <= FLOWN_BY
