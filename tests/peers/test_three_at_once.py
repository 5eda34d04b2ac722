"""Companion, MAVProxy and MAVSDK fly one vehicle at once, in real time."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.flights.processes import PATIENT, Process
from tests.peers.test_mavproxy import Console
from tests.vehicle_sim.served import HOST, PATIENCE_S, served

pytest.importorskip("mavsdk")
from mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry
from mavsdk.plugins.telemetry.telemetry import FlightMode

MISSION = """
name = "wait"
world = "empty"
takeoff_height = 2.0

[[waypoints]]
north = 0.0
east = 0.0
height = 2.0
hold_s = 25.0
"""
PROGRAM = 77, 25
"""System and component of MAVSDK: no ground station, since MAVProxy does not say when it sees one."""
COMPANION = 1, 191


@contextmanager
def started(port: int, folder: Path, *others: tuple[int, int]) -> Iterator[Console]:
    """A MAVProxy that has the parameters, and heartbeats of others."""
    with Console(port, folder) as console:
        sees(console, r"Received \d+ parameters", *others)
        yield console


def sees(console: Console, also: str, *others: tuple[int, int]) -> None:
    """Says this, and of which others heartbeats came, in any order."""
    said = [f"Detected vehicle {system}:{component} " for system, component in others]
    console.wait_for("(?s)^" + "".join(f"(?=.*{each})" for each in [also, *said]))


def set_by(console: Console, parameter: str, value: float) -> None:
    console.type(f"param set {parameter} {value:g}", "")
    assert any(console.shown(parameter) == value for _ in range(1000)), parameter


def test_each_is_obeyed_and_sees_the_others_and_one_that_is_killed_comes_back(tmp_path: Path) -> None:
    mission = tmp_path / "wait.toml"
    mission.write_text(MISSION)
    with ExitStack() as ends:
        vehicle = ends.enter_context(served(1.0, patient=1.0))  # the companion refuses a vehicle that waits long
        place = f"udpout:{HOST}:{vehicle.port}"
        options = ("--avoid", "none", "--log", str(tmp_path / "logs"), "--json", "--no-report", *PATIENT)
        mavsdk = Mavsdk(Configuration.create_manual(*PROGRAM, True))
        ends.callback(mavsdk.destroy)
        mavsdk.add_any_connection(f"udpout://{HOST}:{vehicle.port}")
        system = mavsdk.first_autopilot(PATIENCE_S)
        telemetry, param, action = Telemetry(system), Param(system), Action(system)
        first = ends.enter_context(started(vehicle.port, tmp_path, PROGRAM))
        with Process("companion", ("fly", str(mission), "--connect", place, *options)) as flight:
            flight.wait_for("in control")
            sees(first, "Mode OFFBOARD", COMPANION)
            set_by(first, "MPC_XY_CRUISE", 4.0)
            assert param.get_param_float("MPC_XY_CRUISE") == 4.0
            first.process.kill()
            first.process.wait()
            second = ends.enter_context(started(vehicle.port, tmp_path, COMPANION, PROGRAM))
            param.set_param_float("MPC_XY_CRUISE", 3.0)
            assert any(second.shown("MPC_XY_CRUISE") == 3.0 for _ in range(1000))
            assert telemetry.flight_mode() == FlightMode.OFFBOARD, "the companion flies on"
            assert {1, 255} <= {each.get_system_id() for each in mavsdk.get_systems()}
            assert 191 in components(mavsdk)
            assert flight.end() == 0, flight.lines[-10:]
            report = flight.report()
        assert report["outcome"] == "flown" and report["landed"]
        assert {PROGRAM[0], 255} <= heard_by_companion(tmp_path / "logs"), "it, too, sees the others"
        second.wait_for("DISARMED")
        action.arm()
        action.takeoff()
        second.wait_for("Takeoff detected")
        second.type("long MAV_CMD_DO_SET_MODE 1 4 6", "DO_SET_MODE: ACCEPTED")
        second.wait_for("Disarmed by landing")


def heard_by_companion(logs: Path) -> set[int]:
    """The systems whose heartbeats are in its log."""
    (log,) = logs.glob("*/flight.mcap")
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = [channel.topic.split("/") for channel in summary.channels.values()]
    return {int(topic[2]) for topic in topics if topic[1] == "mavlink" and topic[-1] == "HEARTBEAT"}


def components(mavsdk: Any) -> set[int]:
    """The components of the vehicle's system, as MAVSDK sees them."""
    (own,) = [each for each in mavsdk.get_systems() if each.get_system_id() == 1]
    return set(own.component_ids())
