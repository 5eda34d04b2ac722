"""Recordings of real flight controllers (tests/data): PX4's and ArduPilot's streams become the same VehicleState."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from companion.autopilot import Autopilot
from companion.events import Datagram, Tick
from companion.runtime.files import load_body, load_mission, load_settings
from companion.state import FlightMode, Output, VehicleState
from companion.supervision.states import State

DATA = Path(__file__).resolve().parents[2] / "data"


def frames(name: str) -> Iterator[tuple[int, bytes]]:
    """Time (ns) and frame of each record."""
    data = (DATA / name).read_bytes()
    position = 0
    while position < len(data):
        (time_us,) = struct.unpack_from(">Q", data, position)
        size = data[position + 9] + (12 if data[position + 8] == 0xFD else 8)
        if data[position + 8] == 0xFD and data[position + 10] & 1:
            size += 13
        yield time_us * 1000, data[position + 8 : position + 8 + size]
        position += 8 + size


@pytest.mark.parametrize(
    ("name", "make", "highest"), [("px4_offboard.tlog", "PX4", 4.0), ("ardupilot_guided.tlog", "ArduPilot", 5.0)]
)
def test_a_real_flight_is_read(name: str, make: str, highest: float) -> None:
    """The same code reads both: a climb, level attitudes of unit length, armed under external control, down again."""
    autopilot = Autopilot(load_settings(None, []), load_body("paper_quad"), load_mission("hover")[0], Output.RATES)
    states: list[VehicleState] = []
    modes: set[tuple[FlightMode, bool]] = set()
    for time_ns, frame in frames(name):
        reaction = autopilot.handle(Datagram(time_ns, frame))
        assert reaction.trace is None  # it listens and flies nothing
        if autopilot.sensing.state is not None and (not states or autopilot.sensing.state is not states[-1]):
            states.append(autopilot.sensing.state)
        modes.add((autopilot.link.said.status.mode, autopilot.link.said.status.armed))
    assert autopilot.link.firmware is not None and autopilot.link.firmware.name == make
    assert autopilot.link.traffic.messages_refused == 0
    assert len(states) > 300
    heights = np.array([-state.position_ned[2] for state in states])
    assert heights.max() - heights[0] == pytest.approx(highest, abs=1.5)
    assert heights[-1] - heights[0] < 1.0
    for state in states:
        assert np.linalg.norm(state.attitude_ned_frd) == pytest.approx(1.0)
        assert np.isfinite(state.velocity_ned).all() and np.isfinite(state.rates_frd).all()
    assert (FlightMode.EXTERNAL, True) in modes and (FlightMode.LAND, True) in modes
    climb = np.array([-state.velocity_ned[2] for state in states])
    times = np.array([state.time_ns for state in states]) * 1e-9
    gained = float((climb[:-1] * np.diff(times)).sum())
    assert gained == pytest.approx(heights[-1] - heights[0], abs=1.0)  # velocity and position have the same sign


def test_a_vehicle_that_is_armed_already_is_left_alone() -> None:
    """The recording of PX4 from the middle of its flight: the companion ends, and sends nothing that commands."""
    autopilot = Autopilot(load_settings(None, []), load_body("paper_quad"), load_mission("hover")[0], Output.RATES)
    records = list(frames("px4_offboard.tlog"))
    for time_ns, frame in records[len(records) // 2 :]:
        autopilot.handle(Datagram(time_ns, frame))
        autopilot.handle(Tick(time_ns))
        if autopilot.ended:
            break
    assert autopilot.supervisor.state is State.ENDED
    assert "armed already" in (autopilot.supervisor.fault or "")
