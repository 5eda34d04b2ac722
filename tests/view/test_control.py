"""What a page asks of a vehicle, against the simulated vehicle's own autopilot, over the wire."""

import pytest

from companion.view.control import ASKED, Control
from companion.view.history import History
from companion.view.sources import Link
from protocol.datafile import find
from protocol.messages import Encoder, dialect
from protocol.transport import Memory
from vehicle_sim.airframe import Airframe
from vehicle_sim.integrate import TICK_NS
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World


class Flight:
    """A vehicle, a ground station that watches it and asks it for things, and their clock."""

    def __init__(self) -> None:
        self.vehicle = Vehicle(Airframe.load(find("vehicles", "paper_quad")), World.load(find("worlds", "empty")))
        ours, self._theirs = Memory.pair()
        self._link = Link("memory", ours, b"")
        self.control = Control(ours.send, lambda: self.vehicle.time_ns)
        self.history = History()
        self.hears = True

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            while (data := self._theirs.receive(0.0)) is not None:
                if self.hears:
                    self.vehicle.receive(data)
            for datagram in self.vehicle.advance():
                self._theirs.send(datagram)
            for batch in self._link.poll():
                self.history.take(batch)
                self.control.take(batch)
            self.control.step()

    def take_off(self) -> None:
        """By another ground station, with two commands."""
        other = Encoder(254, 190)
        for command, first in ((dialect.MAV_CMD_NAV_TAKEOFF, 0.0), (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)):
            nan = float("nan")
            fields = (1, 1, command, 0, first, 0.0, 0.0, nan, nan, nan, nan)
            self.vehicle.receive(other.encode_fields(dialect.MAVLink_command_long_message, *fields))
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


@pytest.mark.parametrize("wish", ASKED)
def test_every_button_reaches_the_vehicle(flight: Flight, wish: str) -> None:
    flight.fly(1.5)
    flight.control.ask(wish)
    flight.fly(1.5)
    assert flight.control.answer == f"{wish}: accepted"
    assert flight.mode == wish


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
