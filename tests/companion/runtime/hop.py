"""A hop of some seconds, flown by the runner in lockstep with the simulated vehicle at the end of a queue in memory."""

import signal
from collections.abc import Callable
from pathlib import Path

import msgspec

from companion.autopilot import Autopilot
from companion.config_avoidance import Avoidance
from companion.mission.plan import Mission
from companion.records import RECORD_TYPES
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.flight import AUTO
from companion.runtime.planning import InProcessPlanner, Planning
from companion.runtime.runner import Runner
from companion.state import Output
from protocol import toml_files
from protocol.flightlog import FlightLog
from protocol.transport import Memory
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

MISSION = """
name = "hop"
world = "empty"
takeoff_height = 0.6
return_home = false

[[waypoints]]
north = 0.3
east = 0.0
height = 0.6
"""
OVERRIDES = ("avoidance.map.cells=64", "avoidance.map.cell=0.25")


LOG = "log/flight.mcap"


class InMemory:
    """The companion's end of an in-memory transport; the vehicle at the other end goes on when it is listened to.

    `interrupt_ns`: this process gets a SIGINT then.
    """

    preserves_datagrams = True

    def __init__(self, vehicle: Vehicle, interrupt_ns: int | None = None) -> None:
        self._near, self._far = Memory.pair()
        self._vehicle = vehicle
        self._interrupt_ns = interrupt_ns
        self.peer = self._near.peer

    def receive(self, timeout_s: float) -> bytes | None:
        data = self._near.receive(0.0)
        if data is None:
            while (heard := self._far.receive(0.0)) is not None:
                self._vehicle.receive(heard)
            for datagram in self._vehicle.advance():
                self._far.send(datagram)
            if self._vehicle.time_ns == self._interrupt_ns:
                signal.raise_signal(signal.SIGINT)
            data = self._near.receive(0.0)
        return data

    def send(self, data: bytes) -> None:
        self._near.send(data)

    def lock(self) -> None: ...

    def close(self) -> None: ...


def hop_in(folder: Path) -> Mission:
    """The mission, which stands in `hop.toml` there."""
    file = folder / "hop.toml"
    file.write_text(MISSION)
    return load_mission(str(file))[0]


def fly(
    folder: Path,
    autopilot_class: type[Autopilot] = Autopilot,
    planner: Callable[[Avoidance], InProcessPlanner] = InProcessPlanner,
    interrupt_ns: int | None = None,
    output: Output | None = Output.RATES,
    *,
    console: bool = False,
) -> Autopilot:
    """The whole flight; its log is `LOG` in the folder. `output`: None for whichever suits the vehicle."""
    mission, table = hop_in(folder), load_settings(None, list(OVERRIDES))
    airframe = Airframe.load(toml_files.find("vehicles", mission.vehicle), ())
    vehicle = Vehicle(airframe, World.load(toml_files.find("worlds", mission.world), ()), seed=1, lockstep=True)
    autopilot = autopilot_class(table, load_body(mission.vehicle), mission, output)
    attachments = {
        "mission.toml": (folder / "hop.toml").read_bytes(),
        "vehicle.toml": toml_files.find("vehicles", mission.vehicle).read_bytes(),
        "world.toml": toml_files.find("worlds", mission.world).read_bytes(),
        "settings.json": msgspec.json.encode(table),
    }
    name = AUTO if output is None else output.value
    flight = {"mission": mission.name, "output": name, "pace": "lockstep", "overrides": "[]"}
    with FlightLog.open(
        folder / "log",
        metadata={"flight": {**flight, "whole_datagrams": "True"}},
        attachments=attachments,
        types=RECORD_TYPES,
        on_full="wait",
        console=False,
    ) as log:
        planning = Planning(planner(table.avoidance), table.avoidance.answer_delay)
        runner = Runner(autopilot, InMemory(vehicle, interrupt_ns), log, None, planning, console=console)
        runner.run()
        assert runner.failure is None
    return autopilot
