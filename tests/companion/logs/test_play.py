"""The vehicle's side of a log on the wire again."""

from pathlib import Path

import pytest

from companion.logs import play as player
from companion.logs.play import play
from protocol.flightlog import Direction, FlightLogError, datagrams
from protocol.flightlog.tlog import Entry, TlogReader, from_vehicle, write
from protocol.framing import Framer
from protocol.messages import dialect, layout
from protocol.transport import Udp
from tests.companion.logs.changed_logs import Flyer, heartbeat, stream_log, telemetry_log
from tests.flights.processes import Process, run

DATA = Path(__file__).resolve().parents[2] / "data"


class Clock:
    """A clock that moves only while somebody waits, `factor` times as fast as the wall."""

    now_s = 0.0

    def __init__(self, factor: float) -> None:
        self.factor = factor
        self.start_s = Clock.now_s

    def wall_seconds_until(self, time_ns: int) -> float:
        return time_ns * 1e-9 / self.factor - (Clock.now_s - self.start_s)


class Wire:
    """Notes when each datagram left."""

    preserves_datagrams = True
    peer = "nobody"

    def __init__(self, most: int | None = None) -> None:
        self.sent: list[tuple[float, bytes]] = []
        self.most = most

    def receive(self, timeout_s: float) -> bytes | None:
        Clock.now_s += timeout_s + 1e-9  # what is left of a wait may be too little to move the clock
        return None

    def send(self, data: bytes) -> None:
        self.sent.append((Clock.now_s, data))
        if self.most is not None and len(self.sent) >= self.most:
            raise KeyboardInterrupt

    def lock(self) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    monkeypatch.setattr(player, "RealClock", Clock)
    Clock.now_s = 0.0
    return Wire()


@pytest.mark.parametrize(("speed", "start_s"), [(1.0, 0.0), (4.0, 0.0), (0.5, 3.0)])
def test_what_the_vehicle_sent_when_it_sent_it(fly: Flyer, wire: Wire, speed: float, start_s: float) -> None:
    every = list(datagrams(fly()))
    expected = [
        (time_ns, data)
        for time_ns, direction, _, data in every
        if direction is Direction.IN and time_ns - every[0][0] >= start_s * 1e9
    ]
    result = play(fly(), wire, speed=speed, start_s=start_s)
    assert [data for _, data in wire.sent] == [data for _, data in expected]
    for (left_s, _), (time_ns, _) in zip(wire.sent, expected, strict=True):
        assert left_s == pytest.approx((time_ns - expected[0][0]) * 1e-9 / speed, abs=1e-6)
    assert (result.datagrams, result.bytes) == (len(expected), sum(len(data) for _, data in expected))
    assert result.played_s == pytest.approx((expected[-1][0] - expected[0][0]) * 1e-9)


def test_other_systems_and_again_and_again(wire: Wire) -> None:
    source = DATA / "ardupilot_guided.tlog"
    vehicle = [entry.data for entry in TlogReader(source).entries() if from_vehicle(Framer().datagram(entry.data)[0])]
    wire.most = 2 * len(vehicle)
    with pytest.raises(KeyboardInterrupt):
        play(source, wire, loop=True)
    assert [data for _, data in wire.sent] == vehicle * 2
    assert 0 < len(vehicle) < 6210


def test_nothing_left(fly: Flyer, wire: Wire) -> None:
    with pytest.raises(FlightLogError, match="nothing from 1000 s on"):
        play(fly(), wire, start_s=1000.0)


def test_a_ground_station_sees_the_flight(fly: Flyer) -> None:
    station = Udp("127.0.0.1", 0, bind=True)
    url = f"udpout:127.0.0.1:{station.port}"
    with Process("companion", ("play", str(fly().parent), "--to", url, "--speed", "8", "--from", "4")) as process:
        framer, seen = Framer(), set()
        while "OBSTACLE_DISTANCE" not in seen or "HEARTBEAT" not in seen:
            data = station.receive(30.0)
            assert data is not None
            seen |= {layout(frame.message_id).name for frame in framer.datagram(data)}
        assert framer.bad_bytes == 0
        station.close()
        assert process.end() == 0
    assert "datagrams" in process.lines[-1]


def test_an_address_or_a_speed_that_can_not_be_used(fly: Flyer) -> None:
    for options in (
        ("--to", "nowhere"),
        ("--speed", "0"),
        ("--speed", "nan"),
        ("--speed", "1e308"),
        ("--from", "inf"),
        ("--from", "1e6"),
    ):
        done = run("companion", "play", str(fly()), *options)
        assert done.returncode == 2 and done.stderr.strip()


def attitude(number: int) -> bytes:
    return bytes(dialect.MAVLink_attitude_message(number, 0.1, 0, 0, 0, 0, 0).pack(dialect.MAVLink(None, 1, 1)))


def test_what_is_stamped_before_the_first_is_sent_too(tmp_path: Path, wire: Wire) -> None:
    stamps = [10_000_000, 2_000_000, 3_000_000, 11_000_000]
    write(tmp_path / "a.tlog", (Entry(stamp, attitude(number)) for number, stamp in enumerate(stamps)))
    assert play(tmp_path / "a.tlog", wire).datagrams == 4
    assert [data for _, data in wire.sent] == [attitude(number) for number in range(4)]
    assert play(tmp_path / "a.tlog", wire, start_s=0.5).datagrams == 1


@pytest.mark.parametrize("speed", [1.0, 8.0])
def test_a_log_of_no_length_is_no_flood(tmp_path: Path, wire: Wire, speed: float) -> None:
    wire.most = 5
    with pytest.raises(KeyboardInterrupt):
        play(telemetry_log(tmp_path / "a.tlog", attitude(1)), wire, loop=True, speed=speed)
    assert [left_s for left_s, _ in wire.sent] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0], abs=0.01)


def test_a_long_wait_is_said(tmp_path: Path, wire: Wire) -> None:
    stamps = [0, 4_000_000, 1_000_000_000, 1_001_000_000]
    write(tmp_path / "a.tlog", (Entry(stamp, attitude(number)) for number, stamp in enumerate(stamps)))
    said: list[float] = []
    play(tmp_path / "a.tlog", wire, speed=2.0, pausing=said.append)
    assert said == pytest.approx([498.0], abs=0.01)


@pytest.mark.parametrize("by_s", [-3600, -20, 3600, 3 * 365 * 86_400])
def test_a_clock_that_is_set_changes_no_timing(tmp_path: Path, wire: Wire, by_s: int) -> None:
    """As that of a ground station's machine, which hears of the time in the flight."""
    first_us = 1_700_000_000_000_000
    stamps = [first_us + 500_000 * number + (by_s * 1_000_000 if number > 9 else 0) for number in range(20)]
    write(tmp_path / "a.tlog", (Entry(stamp, attitude(number)) for number, stamp in enumerate(stamps)))
    played = play(tmp_path / "a.tlog", wire)
    asked = [0.5 * number for number in (*range(10), *range(9, 19))]
    assert [left_s for left_s, _ in wire.sent] == pytest.approx(asked, abs=0.01)
    assert played.played_s == pytest.approx(9.0)
    assert play(tmp_path / "a.tlog", wire, start_s=7.0).datagrams == 5


def test_of_a_serial_line_whole_frames_are_sent(tmp_path: Path, wire: Wire) -> None:
    messages = [heartbeat(number) for number in range(1, 40)]
    played = play(stream_log(tmp_path / "a.mcap", messages, 50), wire)
    assert [frame.raw for _, data in wire.sent for frame in Framer().datagram(data)] == messages
    assert played.bytes == sum(map(len, messages))
