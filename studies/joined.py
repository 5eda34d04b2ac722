"""Both sides in one thread, joined in memory: the same stages as in two processes, without sockets or sleeping."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.autopilot import Autopilot
from companion.events import Datagram, Event, Reaction
from companion.mission.plan import Mission
from companion.records import TRACE
from companion.runtime.driver import Driver, nobody
from companion.runtime.feasibility import within_reach
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.planning import InProcessPlanner, PlannerBackend, Planning
from companion.state import Output
from protocol import toml_files
from protocol.arrays import Array
from studies.faults.injector import Change, Injector
from vehicle_sim.airframe import Airframe
from vehicle_sim.services.identity import Identity
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World


@dataclass
class Joined:
    """A companion and a vehicle that have not met yet. `meddle` may change what the vehicle says, at a time (ns)."""

    mission: Mission
    output: Output | None = Output.RATES
    """None: the one that the companion chooses for this vehicle."""
    overrides: tuple[str, ...] = ()
    seed: int = 1
    airframe: Airframe | None = None
    """Another one than the mission's; the companion knows its body."""
    vehicle_overrides: tuple[str, ...] = ()
    """As "body.mass_kg=0.9", of the simulated vehicle alone: what the companion does not know."""
    world_overrides: tuple[str, ...] = ()
    """As "wind.mean_ned=[0.0, 5.0, 0.0]"."""
    meddle: Change = lambda time_ns, data: data
    injector: Injector = field(default_factory=Injector)
    """Between both. With one that does anything there is no lockstep."""
    remembers: bool = True
    """Whether `events` and `sent` are kept: half a megabyte an answer of the planner."""
    said: list[str] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)
    traces: list[bytes] = field(default_factory=list)
    trace_ticks: list[int] = field(default_factory=list)
    """At which of the vehicle's ticks each of `traces` was made."""
    truths: list[Array] = field(default_factory=list)
    """(17,) of rigid_body at each tick, from 0 on."""

    def __post_init__(self) -> None:
        body = load_body(self.mission.vehicle) if self.airframe is None else self.airframe.body
        settings, _ = within_reach(load_settings(None, list(self.overrides)), body)
        self.autopilot = Autopilot(settings, body, self.mission, self.output)
        frame = self.airframe or Airframe.load(
            toml_files.find("vehicles", self.mission.vehicle), self.vehicle_overrides
        )
        world = World.load(toml_files.find("worlds", self.mission.world), self.world_overrides)
        firmware = (1, 13) if self.output is Output.ACTUATORS else (1, 16)
        self.vehicle = Vehicle(
            frame, world, seed=self.seed, lockstep=self.injector.keeps_step, identity=Identity(firmware=firmware)
        )
        # as in `companion demo`: land when the companion has gone, and act on the battery after the companion has
        for name, value in (("NAV_DLL_ACT", 3), ("BAT_CRIT_THR", 0.05), ("BAT_EMERGEN_THR", 0.03)):
            self.vehicle.parameters.set(name, value)
        self.planner = InProcessPlanner(settings.avoidance)
        self.fly_with(self.planner)

    def fly_with(self, planner: PlannerBackend) -> None:
        """Let another planner answer from now on."""
        planning = Planning(planner, self.autopilot.settings.avoidance.answer_delay)
        said, traces, ticks, vehicle = self.said, self.traces, self.trace_ticks, self.vehicle

        def keep(event: Event, reaction: Reaction) -> None:  # without `self`, which would be a cycle of references
            said.extend(f"{event.time_ns * 1e-9:.2f} {each.text}" for each in reaction.announcements)
            if reaction.trace is not None:
                traces.append(reaction.trace)
                ticks.append(vehicle.tick)

        before = self.events.append if self.remembers else nobody
        self._driver = Driver(self.autopilot, planning, before, keep)

    def tick(self) -> None:
        """4 ms."""
        self.truths.append(self.vehicle.state.copy())
        datagrams, between = self.vehicle.advance(), self.injector
        now = self.vehicle.time_ns
        for whole in datagrams:
            between.to_companion(self.meddle(now, whole), now)
        answer = b"".join(self._driver.handle(Datagram(now, heard)) for heard in between.at_companion(now))
        answer += self._driver.tick(now)
        if answer:
            if self.remembers:
                self.sent.append(answer)
            between.to_vehicle(answer, now)
        for arrived in between.at_vehicle(now):
            self.vehicle.receive(arrived)

    def fly(self, limit_s: float = 400.0, until: Callable[["Joined"], bool] = lambda joined: False) -> "Joined":
        """Until the companion has ended, or `until` holds, at most `limit_s` of simulated time."""
        end_ns = self.vehicle.time_ns + round(limit_s * 1e9)
        while not self.autopilot.ended and self.vehicle.time_ns < end_ns and not until(self):
            self.tick()
        return self

    def freeze(self, seconds: float, backlog: int = 250) -> None:
        """The companion stands still for so long, as after SIGSTOP: what comes queues up, the first so many datagrams
        of it, and the loop's tick is late by all of that."""
        queued: list[bytes] = []
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.truths.append(self.vehicle.state.copy())
            queued += self.vehicle.advance()
        now = self.vehicle.time_ns
        answers = [self._driver.tick(now, round(seconds * 1e9))]
        answers += [self._driver.handle(Datagram(now, data)) for data in queued[:backlog]]
        for answer in filter(None, answers):
            if self.remembers:
                self.sent.append(answer)
            self.vehicle.receive(answer)

    def tracking_error(self) -> Array:
        """(n, 3) true position minus reference (m, NED), one row a trace but the last. A reference is meant for the
        middle of the tick that its command is held over."""
        truth = np.array([*self.truths, self.vehicle.state])[:, :3]
        now = np.array(self.trace_ticks[:-1], int)
        error: Array = 0.5 * (truth[now] + truth[now + 1]) - self.trace()["reference_position_ned"][:-1]
        return error

    def drift(self, seconds: float) -> None:
        """The vehicle alone: the companion is gone."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.vehicle.advance()

    def trace(self) -> "np.ndarray[tuple[int], np.dtype[np.void]]":
        """The trace as a structured array, as the log has it."""
        return np.frombuffer(b"".join(self.traces), TRACE.dtype)


def mission_of(name: str, *overrides: str) -> Mission:
    """One of the project's missions, as "trajectory.laps=1" changes it."""
    return load_mission(name, list(overrides))[0]
