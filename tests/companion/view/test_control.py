"""What a page asks of a vehicle, against the simulated vehicle's own autopilot, over the wire."""

import numpy as np
import pytest

from companion.view.control import Control, _place, go_to_words, on_ground
from companion.view.history import History
from companion.view.sources import Link
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from protocol.toml_files import find
from protocol.transport import Memory
from vehicle_sim.airframe import Airframe
from vehicle_sim.services.identity import FIRST, Identity
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World


class Flight:
    """A vehicle, a ground station that watches it and asks it for things, and their clock."""

    def __init__(self) -> None:
        self.vehicle = self.another(FIRST)
        self.vehicles = [self.vehicle]
        ours, self._theirs = Memory.pair()
        self._link = Link("memory", ours, b"")
        self.control = Control(ours.send, lambda: self.vehicle.time_ns)
        self.history = History()
        self.hears = True

    @staticmethod
    def another(identity: Identity) -> Vehicle:
        airframe, world = Airframe.load(find("vehicles", "paper_quad")), World.load(find("worlds", "empty"))
        return Vehicle(airframe, world, identity=identity)

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            while (data := self._theirs.receive(0.0)) is not None:
                for vehicle in self.vehicles if self.hears else ():
                    vehicle.receive(data)
            for vehicle in self.vehicles:
                for datagram in vehicle.advance():
                    self._theirs.send(datagram)
            for batch in self._link.poll():
                self.history.take(batch)
                self.control.take(batch)
            self.control.step()

    def stream(self, seconds: float) -> None:
        """Fly while a companion sends setpoints: level, at the thrust that hovers."""
        companion, body = Encoder(1, 191), self.vehicle.airframe.body
        thrust = self.vehicle.flight.mass_kg * 9.81 / body.max_thrust_n
        for _ in range(round(seconds * 50)):
            level = (0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, thrust)
            self.vehicle.receive(companion.encode_fields(dialect.MAVLink_set_attitude_target_message, *level))
            self.fly(0.02)

    def say(self, result: int) -> None:
        """An answer of the vehicle's that it does not give by itself."""
        ack = (dialect.MAV_CMD_DO_SET_MODE, result, 0, 0, 255, 190)
        self._theirs.send(Encoder(1, 1).encode_fields(dialect.MAVLink_command_ack_message, *ack))

    def take_off(self, system: int = 1) -> None:
        """By another ground station, with two commands."""
        other = Encoder(254, 190)
        for command, first in ((dialect.MAV_CMD_NAV_TAKEOFF, 0.0), (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)):
            nan = float("nan")
            fields = (system, 1, command, 0, first, 0.0, 0.0, nan, nan, nan, nan)
            for vehicle in self.vehicles:
                vehicle.receive(other.encode_fields(dialect.MAVLink_command_long_message, *fields))
        self.fly(6.0)

    @property
    def mode(self) -> str:
        return self.history.at(self.history.end).mode


@pytest.fixture
def flight() -> Flight:
    return Flight()


def test_a_vehicle_in_the_air_holds_and_lands_when_it_is_asked_to(flight: Flight) -> None:
    flight.fly(2.0)
    flight.take_off()
    assert flight.vehicle.flight.armed and not flight.vehicle.flight.landed
    height = -flight.vehicle.motion.position_ned[2]
    assert height > 2.0
    flight.control.ask("land")
    flight.fly(1.5)
    assert flight.control.answer == "land: accepted"
    assert flight.mode == "land"
    flight.control.ask("hold")
    flight.fly(2.5)
    assert (flight.control.answer, flight.mode) == ("hold: accepted", "hold")
    assert -flight.vehicle.motion.position_ned[2] > 0.5
    assert abs(flight.vehicle.motion.velocity_ned[2]) < 0.1
    flight.control.ask("land")
    flight.fly(12.0)
    assert flight.vehicle.finished
    assert flight.vehicle.flight.crash is None


@pytest.mark.parametrize("wish", ["hold", "land", "return"])
def test_every_button_reaches_the_vehicle(flight: Flight, wish: str) -> None:
    flight.fly(1.5)
    flight.control.ask(wish)
    flight.fly(1.5)
    assert flight.control.answer == f"{wish}: accepted"
    assert flight.mode == wish


def test_resume_gives_the_vehicle_to_a_companion_if_there_is_one(flight: Flight) -> None:
    flight.fly(2.0)
    flight.take_off()
    flight.control.ask("resume")
    flight.fly(1.0)
    assert (flight.control.answer, flight.mode) == ("resume: rejected for now", "hold")
    flight.stream(1.2)
    flight.control.ask("resume")
    flight.stream(0.5)
    assert (flight.control.answer, flight.mode) == ("resume: accepted", "external control")


def test_a_vehicle_without_a_fix_is_at_no_place_on_earth() -> None:
    """It tells the place at 0, 0."""
    nowhere = dialect.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 0, 0, 0, 0)
    assert _place(np.zeros(3), vars(nowhere), "lat", "lon", "alt") is None
    for latitude, longitude in ((1, 0), (0, 1)):
        nowhere.lat, nowhere.lon = latitude, longitude
        assert _place(np.zeros(3), vars(nowhere), "lat", "lon", "alt") is not None, "on the equator, or on the meridian"


@pytest.mark.parametrize("tells_home", [True, False])
def test_a_vehicle_flies_to_the_place_that_it_is_sent_to(flight: Flight, tells_home: bool) -> None:
    if not tells_home:
        flight.vehicle.telemetry.set_interval(dialect.MAVLINK_MSG_ID_HOME_POSITION, -1)
    flight.fly(2.0)
    flight.take_off()
    flight.control.send_to(np.array([12.0, -7.0, -4.0]))
    flight.fly(1.0)
    assert flight.control.answer == "go to north 12.0, east -7.0, 4.0 m high: accepted"
    assert flight.mode == "hold"
    flight.fly(14.0)
    assert flight.vehicle.motion.position_ned == pytest.approx((12.0, -7.0, -4.0), abs=0.1)
    assert flight.vehicle.motion.speed < 0.05


@pytest.mark.parametrize("height", [-3.0, 0.4, 120.5, 200.0])
def test_nobody_is_sent_too_high_or_into_the_ground(flight: Flight, height: float) -> None:
    """Whatever was typed; the question says it, too."""
    flight.fly(2.0)
    flight.take_off()
    target = np.array([5.0, 0.0, -height])
    flight.control.send_to(target)
    assert flight.control.answer == f"go to: {height:.1f} m is not between 0.5 and 120.0 m"
    assert f"Not sent: {height:.1f} m" in go_to_words(np.zeros(3), target, b"")
    before = flight.vehicle.motion.position_ned
    flight.fly(3.0)
    assert flight.vehicle.motion.position_ned == pytest.approx(before, abs=0.1)


def test_nobody_is_sent_anywhere_before_it_is_known_where_that_is() -> None:
    control = Control(lambda data: None, lambda: 0)
    control.send_to(np.zeros(3))
    assert control.answer == "go to: the vehicle has not said where on earth it is"


def test_of_two_answers_the_last_one_counts(flight: Flight) -> None:
    """As PX4 gives them to DO_SET_MODE: accepted first, and then what it comes to."""
    flight.fly(2.0)
    flight.control.ask("land")
    flight.fly(0.1)
    assert flight.control.answer == "land: accepted"
    flight.say(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
    flight.fly(0.1)
    assert flight.control.answer == "land: rejected for now"
    flight.fly(2.0)
    assert flight.control.answer == "land: rejected for now"


def test_a_click_is_a_place_on_the_ground_unless_it_is_in_the_sky() -> None:
    """Rays of the page are east, north, up."""
    assert on_ground((1.0, 2.0, 5.0), (0.6, 0.0, -0.8)) == pytest.approx([2.0, 4.75, 0.0])
    assert on_ground((1.0, 2.0, 5.0), (0.6, 0.0, 0.8)) is None
    assert on_ground((1.0, 2.0, -5.0), (0.6, 0.0, -0.8)) is None


def test_the_question_names_place_height_and_what_is_in_the_way() -> None:
    world = b'[[box]]\nname = "shed"\ncenter = [10.0, 0.0]\nsize = [2.0, 4.0]\nheight = 3.0\n'
    text = go_to_words(np.array([0.0, 0.0, -2.0]), np.array([20.0, 0.0, -2.5]), world)
    assert "north 20.0, east 0.0, 2.5 m high" in text and "20 m, straight" in text and "In the way: shed" in text
    assert "In the way" not in go_to_words(np.array([0.0, 0.0, -5.0]), np.array([20.0, 0.0, -5.0]), world)


def test_a_command_that_is_lost_is_sent_again_and_given_up_in_the_end(flight: Flight) -> None:
    flight.fly(1.5)
    flight.hears = False
    flight.control.ask("return")
    flight.fly(1.2)
    assert flight.control.answer == "return: sent"
    flight.hears = True
    flight.fly(0.6)
    assert flight.control.answer == "return: accepted"
    flight.hears = False
    flight.control.ask("land")
    flight.fly(4.0)
    assert flight.control.answer == "land: no answer"


def test_nothing_is_asked_before_a_vehicle_was_heard() -> None:
    sent: list[bytes] = []
    control = Control(sent.append, lambda: 0)
    control.ask("land")
    control.step()
    assert control.answer == "land: no vehicle was heard yet"
    assert len(sent) == 1, "its own heartbeat alone"


def test_of_two_vehicles_the_chosen_one_is_shown_and_commanded() -> None:
    flight = Flight()
    flight.fly(1.5)
    flight.vehicles.append(flight.another(Identity(2)))
    flight.take_off()
    history, control = flight.history, flight.control
    assert history.vehicles == ("1/1", "2/1")

    def height(sender: str) -> float:
        history.shown = sender
        position = history.at(history.end).position_ned
        assert position is not None
        return -float(position[2])

    assert height("1/1") > 2.0 and height("2/1") < 0.3
    flight.take_off(2)
    assert height("2/1") > 2.0
    control.ask("land")
    control.choose("2/1")
    flight.fly(1.0)
    assert flight.mode == "hold" and control.answer == "land: accepted"
    history.shown = None
    assert flight.mode == "land", "who was asked, before the other one was chosen"
    history.shown = "2/1"
    control.ask("land")
    flight.fly(1.0)
    assert flight.mode == "land"


@pytest.mark.parametrize("period_us", [1_000_000, 100_000])
def test_position_and_attitude_are_asked_for_where_they_come_seldom(period_us: int) -> None:
    """And a stream that others have set up is left as it is."""
    flight, other = Flight(), Encoder(254, 190)
    for number in (31, 32):
        fields = (1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, period_us, 0.0, 0.0, 0.0, 0.0, 0.0)
        flight.vehicle.receive(other.encode_fields(dialect.MAVLink_command_long_message, *fields))
    flight.fly(8.0)
    before = flight.history.end
    flight.fly(4.0)
    wanted = 4 * 30 if period_us == 1_000_000 else 4 * 10
    rows = flight.history._vehicle
    for track in (rows.positions, rows.attitudes):
        assert len(track.rows()) and np.sum(track.rows()[:, 0] > before) == pytest.approx(wanted, rel=0.15)


def test_a_place_on_earth_is_known_once_both_of_its_kinds_are() -> None:
    """The page was opened in flight, and hears the vehicle's latitude before its place in its own frame."""
    vehicle, told = Encoder(1, 1), list[bytes]()
    ours, theirs = Memory.pair()
    link, control = Link("memory", ours, b""), Control(told.append, lambda: 0)

    def hear(*parts: bytes) -> None:
        theirs.send(b"".join(parts))
        for batch in link.poll():
            control.take(batch)

    on_earth = dialect.MAVLink_global_position_int_message, 0, 473977418, 85455939, 0, 0, 0, 0, 0, 0
    local = dialect.MAVLink_local_position_ned_message, 0, 300.0, 0.0, -10.0, 0, 0, 0
    hear(vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, 0, 4, 3), vehicle.encode_fields(*on_earth))
    control.send_to(np.array([300.0, 0.0, -10.0]))
    assert control.answer == "go to: the vehicle has not said where on earth it is"
    hear(vehicle.encode_fields(*local))
    hear(vehicle.encode_fields(*on_earth))
    control.send_to(np.array([300.0, 0.0, -10.0]))
    control.step()
    sent = decode(Framer().datagram(told[-1])[0])
    assert sent is not None and (sent.x, sent.y) == (473977418, 85455939)
