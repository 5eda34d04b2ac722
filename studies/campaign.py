"""Campaigns of many flights: each flight of a set-up, a method, a speed and a seed is flown in memory and is one row of
a table.

A flight is a success if the vehicle came within `GOAL_M` of the goal, in time, and touched nothing until it stood
there. Its time runs from the first step of the route until it is within `GOAL_M`. The companion knows only the
waypoints.
"""

import dataclasses
import math
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from companion.config_avoidance import Avoidance
from companion.mission.plan import Mission, Phase
from companion.runtime import flight as whole_flight
from companion.runtime.feasibility import within_reach
from companion.runtime.files import load_body, load_mission, load_settings
from companion.state import Output
from protocol import toml_files
from protocol.toml_files import TomlFileError
from protocol.transport import TransportError
from studies import escape, packages, worlds
from studies.escape import Abilities, avoidable
from studies.faults import flights
from studies.faults.catalogue import FAULTS
from studies.faults.injector import Injector
from studies.joined import Joined
from studies.worlds import HULL, Site, shortest
from vehicle_sim.airframe import PERFECT, Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

GOAL_M = 2.0
DEFAULT = Avoidance().method
REACHED = "reached"

_LONGEST_NAME = 80
_ON_ROUTE = (Phase.ROUTE, Phase.RELEASE)


@dataclass(frozen=True, slots=True)
class Setup:
    """A kind of place and how it is flown."""

    name: str
    title: str
    site: Callable[[int], Site]
    """A function of a module, or a partial of one: it goes to other processes."""
    speeds: tuple[float, ...]
    limit_s: float = 60.0
    """s of simulated time on the route."""
    seeds: int = 100
    """Number of seeds that its floor is meant for."""
    has_way: bool = False
    """Whether the shortest way is computed: nothing moves there."""
    overrides: tuple[str, ...] = ()
    """Overrides of the companion's settings."""
    vehicle_overrides: tuple[str, ...] = ()
    mission: str | None = None
    """Flown there in place of the site's own way."""
    vehicle: str | None = None
    """In place of the mission's."""
    fault: str | None = None
    """Key of a fault of the catalogue, which begins soon after the take-off."""


Key = tuple[str, str, float, int]
"""Set-up, method, speed, seed."""
CaseKey = tuple[str, str, float]
"""The same without the seed."""


@dataclass(frozen=True, slots=True)
class Job:
    setup: Setup
    method: str
    speed: float
    seed: int
    folder: Path
    """Folder for worlds and failures."""
    overrides: tuple[str, ...] = ()
    """Overrides in addition to those of the set-up."""

    @property
    def case(self) -> str:
        """Name of the flights that share a row of the report, of a folder's length and letters."""
        words = re.sub(r"[^A-Za-z0-9_.,+-]+", "_", self.setup.name)
        if len(words) > _LONGEST_NAME or words.replace("_", " ") != self.setup.name:  # others may have the same words
            words = words[:_LONGEST_NAME] + sha256(self.setup.name.encode()).hexdigest()[:8]
        return f"{words}_{self.method}_{self.speed:.9g}"

    @property
    def key(self) -> Key:
        return self.setup.name, self.method, self.speed, self.seed

    @property
    def code(self) -> str:
        """A digest of what flies and of how it is set up, but for the seed."""
        setup = self.setup
        what = (_described(setup.site), self.settings, self.speed, setup.limit_s, setup.has_way,
                setup.vehicle_overrides, setup.mission, setup.vehicle, setup.fault, _contents(setup),
                packages.digest(self.settings))  # fmt: skip
        return sha256(f"{_sources()} {what}".encode()).hexdigest()[:16]

    def mission_overrides(self, world: Path) -> list[str]:
        """What the mission's file does not say of this flight."""
        changes = [f'world="{world}"', f"speed={self.speed!r}"]
        return changes if self.setup.vehicle is None else [*changes, f'vehicle="{self.setup.vehicle}"']

    @property
    def settings(self) -> tuple[str, ...]:
        return (*self.setup.overrides, f'avoidance.method="{self.method}"', *self.overrides)


def chooses_method(overrides: Sequence[str]) -> bool:
    """Whether overrides of the settings choose the method of avoidance, which is the job's. Raises TomlFileError."""
    avoidance = toml_files.convert({}, dict, "settings", overrides).get("avoidance")
    return isinstance(avoidance, dict) and "method" in avoidance


@cache
def _sources() -> str:
    return flights.code(__file__, escape.__file__, worlds.__file__)


@lru_cache
def _contents(setup: Setup) -> str:
    """A digest of the files that a set-up names, which may be the user's own. Raises TomlFileError."""
    return sha256(b"".join(sha256(path.read_bytes()).digest() for path in _named(setup))).hexdigest()[:16]


def _named(setup: Setup) -> Iterator[Path]:
    vehicle = "paper_quad"
    if setup.mission is not None:
        mission, path = load_mission(setup.mission)
        vehicle = mission.vehicle
        yield path
        with suppress(TomlFileError):  # in a place made by seed it plays no part
            yield toml_files.find("worlds", mission.world)
    path = toml_files.find("vehicles", setup.vehicle or vehicle)
    yield path
    sensors = Airframe.load(path, setup.vehicle_overrides).estimator.sensors
    if sensors not in (None, PERFECT):
        yield toml_files.find("vehicles/sensors", sensors)


def _described(function: Any) -> str:
    """A module's function, or a partial of one, by its names and arguments."""
    if isinstance(function, partial):
        inner = ", ".join(map(_described, function.args))
        return f"{_described(function.func)}({inner}, {sorted(function.keywords.items())})"
    return f"{function.__module__}.{function.__qualname__}" if callable(function) else repr(function)


@dataclass(frozen=True, slots=True)
class Row:
    """One flight. Times in s, lengths in m; values that a flight did not get to are None."""

    setup: str
    method: str
    speed: float
    """Commanded."""
    seed: int
    outcome: str
    """"reached", "contact", "gave up" (landed or went back), "out of time", or what went wrong."""
    met: str | None
    """Name of the obstacle that was touched."""
    avoidable: bool | None
    """Whether the contact could have been avoided (studies.escape); None without a contact with an obstacle that moves
    or appears."""
    contact_speed: float | None
    route_s: float
    """Time on the route, to within GOAL_M of the goal or to the end."""
    path_m: float
    straight_m: float
    shortest_m: float | None
    """Shortest way of the hull with the map known; None where it was not computed."""
    goal_speed: float
    """Mean speed towards the goal: straight_m / route_s; 0 if it was not reached."""
    top_speed: float
    least_clearance: float | None
    """Least true distance from hull to obstacle on the whole flight."""
    blocked_share: float | None
    """Share of the control steps on the route at which the way was blocked."""
    guarded_share: float | None
    """Share of the control steps on the route at which the guard changed the command; None without any steps."""
    simulated_s: float
    wall_s: float
    log: str | None
    """Log of a failure."""
    map_us: float | None = None
    """Wall time of tracks and map, median of the flight's scans; None where there is no map."""
    way_us: float | None = None
    """Wall time of the method's way over the map."""
    space_us: float | None = None
    """Wall time of the free space for the guard."""
    step_us: float | None = None
    """Wall time of a control step from message to message, guard included; median of the flight."""
    code: str = ""
    """Digest of what flew: see Job.code."""

    @property
    def key(self) -> Key:
        return self.setup, self.method, self.speed, self.seed

    @property
    def path_speed(self) -> float:
        return self.path_m / self.route_s if self.route_s else 0.0

    @property
    def way_over_shortest(self) -> float:
        """The flown way and its rest over the shortest way, or over the straight one where that was not computed.
        NaN, which is shown as a dash, where the goal is the start."""
        return (self.path_m + GOAL_M) / (self.shortest_m or self.straight_m or math.nan)

    @property
    def succeeded(self) -> bool:
        return self.outcome == REACHED


# --- one flight ---


def fly(job: Job) -> Row:
    """Fly one flight; log, world and picture of a failure are written to the job's folder."""
    began = time.perf_counter()
    site, mission_file, joined = _prepared(job)
    watch, stages = _Watch(job, site), _Stages(joined)
    joined.fly(limit_s=job.setup.limit_s + 30.0, until=watch.over)
    row = watch.row(joined)
    if not row.succeeded:
        folder = keep(job, site, mission_file, joined)
        row = dataclasses.replace(row, log=str(folder.relative_to(job.folder)))
    return dataclasses.replace(row, wall_s=time.perf_counter() - began, code=job.code, **stages.medians())


def end_of_flight(job: Job) -> tuple[Site, Joined]:
    """Fly one flight; both sides as they are at its end."""
    site, _, joined = _prepared(job)
    return site, joined.fly(limit_s=job.setup.limit_s + 30.0, until=_Watch(job, site).over)


def _prepared(job: Job) -> tuple[Site, Path, Joined]:
    """The place, the file of its mission, and both sides before the flight."""
    site = job.setup.site(job.seed)
    world, own = site.save(job.folder / "worlds" / job.case, job.speed)
    mission, mission_file = load_mission(job.setup.mission or str(own), job.mission_overrides(world.absolute()))
    vehicle = job.setup.vehicle_overrides
    joined = Joined(mission, overrides=job.settings, seed=job.seed, vehicle_overrides=vehicle, injector=_injector(job),
                    remembers=False)  # fmt: skip
    return site, mission_file, joined


def _injector(job: Job) -> Injector:
    """The fault begins between 3 and 10 s after the arming."""
    if job.setup.fault is None:
        return Injector()
    after_s = float(np.random.default_rng(job.seed).uniform(3.0, 10.0))
    return flights.injector(FAULTS[job.setup.fault], after_s, job.seed)


class _Stages:
    """Wall times (ns) of the companion's stages during a flight."""

    def __init__(self, joined: Joined) -> None:
        pipeline = joined.planner.pipeline
        local_map, planner = pipeline.local_map, pipeline.planner
        self._map = [_timed(local_map, "add"), _timed(local_map, "look")]
        self._way = [] if planner is None else [_timed(planner, "path"), _timed(planner, "blocked")]
        self._space = [_timed(local_map, "free_space")]
        self._steps = [_timed(joined.autopilot, "handle", lambda reaction: reaction.trace is not None)]

    def medians(self) -> dict[str, Any]:
        """The medians (us) as fields of a Row."""
        parts = {"map_us": self._map, "way_us": self._way, "space_us": self._space, "step_us": self._steps}
        return {
            name: sum(1e-3 * float(np.median(times)) for times in stage if times) if any(stage) else None
            for name, stage in parts.items()
        }


def _timed(owner: object, name: str, counts: Callable[[Any], bool] = lambda result: True) -> list[int]:
    """A list to which the wall time (ns) of each call of a method is added from now on, if its result counts."""
    method = getattr(owner, name)
    times: list[int] = []

    def watched(*arguments: Any, **options: Any) -> Any:
        start = time.perf_counter_ns()
        result = method(*arguments, **options)
        if counts(result):
            times.append(time.perf_counter_ns() - start)
        return result

    setattr(owner, name, watched)
    return times


class _Watch:
    """Watches a flight tick by tick."""

    def __init__(self, job: Job, site: Site) -> None:
        self._job = job
        self._site = site
        self._began: int | None = None
        self._last_step = 0
        self._arrived: int | None = None

    def over(self, joined: Joined) -> bool:
        vehicle, phase = joined.vehicle, joined.autopilot.navigator.phase
        if self._began is None:
            if phase in _ON_ROUTE:
                self._began = vehicle.tick
                steps = enumerate(joined.autopilot.navigator.steps)
                self._last_step = max(number for number, step in steps if step.phase is Phase.ROUTE)
            return vehicle.finished
        position = vehicle.motion.position_ned
        if self._arrived is None and self._heads_for_goal(joined):
            north, east = self._site.goal
            if math.hypot(position[0] - north, position[1] - east) <= GOAL_M:
                self._arrived = vehicle.tick
        late = (vehicle.tick - self._began) * 0.004 > self._job.setup.limit_s
        return vehicle.finished or late or phase not in _ON_ROUTE

    def _heads_for_goal(self, joined: Joined) -> bool:
        """The vehicle is on the last leg: a way over many waypoints may pass near the goal earlier."""
        return joined.autopilot.navigator.step_index >= self._last_step

    def row(self, joined: Joined) -> Row:
        vehicle, site, job = joined.vehicle, self._site, self._job
        summary = vehicle.summary()
        began = self._began if self._began is not None else vehicle.tick
        end = self._arrived if self._arrived is not None else vehicle.tick
        truth = np.array([*joined.truths, vehicle.state])[began : end + 1]
        path = float(np.linalg.norm(np.diff(truth[:, :3], axis=0), axis=1).sum())
        speeds = np.linalg.norm(truth[:, 3:6], axis=1)
        route_s = max((end - began) * 0.004, 1e-9)
        places = [(0.0, 0.0), *site.waypoints]
        straight = sum(math.dist(a, b) for a, b in pairwise(places))
        reached = self._arrived is not None and summary.contacts == 0
        trace = joined.trace()
        trace = trace[trace["phase"] == Phase.ROUTE.value]
        return Row(
            setup=job.setup.name,
            method=job.method,
            speed=job.speed,
            seed=job.seed,
            outcome=self._outcome(joined),
            met=summary.contact_with,
            avoidable=self._avoidable(joined),
            contact_speed=float(np.linalg.norm(joined.truths[-1][3:6])) if summary.contacts else None,
            route_s=route_s,
            path_m=path,
            straight_m=straight,
            shortest_m=shortest(site, HULL) if job.setup.has_way else None,
            goal_speed=(straight - GOAL_M) / route_s if reached else 0.0,
            top_speed=float(speeds.max()),
            least_clearance=summary.least_clearance_m,
            blocked_share=_share(trace, "blocked"),
            guarded_share=_share(trace, "guard_reason"),
            simulated_s=summary.simulated_s,
            wall_s=0.0,
            log=None,
        )

    def _avoidable(self, joined: Joined) -> bool | None:
        met, world = joined.vehicle.flight.crash, self._site.world()
        if met not in {world.names[len(world.boxes) + each.row] for each in world.dynamic}:
            return None
        airframe = joined.vehicle.airframe
        abilities = Abilities.of(airframe, joined.autopilot.settings.limits.tilt)
        truth = np.array([*joined.truths, joined.vehicle.state])
        return avoidable(world, truth, met, abilities, airframe.lidar.max_range_m)

    def _outcome(self, joined: Joined) -> str:
        if joined.vehicle.flight.crash is not None:
            return "contact"
        if self._arrived is not None:
            return REACHED
        fault = joined.autopilot.supervisor.fault
        if fault is not None:
            return fault
        if self._began is None:
            return "it never set off"
        return "out of time" if joined.autopilot.navigator.phase in _ON_ROUTE else "gave up"


def _share(trace: "np.ndarray[tuple[int], np.dtype[np.void]]", field: str) -> float | None:
    """Share of the control steps at which `field` is not 0; None without any steps."""
    return float((trace[field] != 0).mean()) if len(trace) else None


# --- failures ---


class _Vehicle:
    """The transport of a companion whose vehicle runs in the same thread: receiving advances it by a tick."""

    preserves_datagrams = True
    peer = "memory:vehicle"

    def __init__(self, vehicle: Vehicle, end_ns: int) -> None:
        self._vehicle = vehicle
        self._waiting: list[bytes] = []
        self._end_ns = end_ns

    def receive(self, timeout_s: float) -> bytes | None:
        if not self._waiting:
            if self._vehicle.time_ns >= self._end_ns:
                raise TransportError("the campaign ends the flight here")
            self._waiting = self._vehicle.advance()
        return self._waiting.pop(0)

    def send(self, data: bytes) -> None:
        self._vehicle.receive(data)

    def lock(self) -> None:
        """There is only one peer."""

    def close(self) -> None:
        """Nothing to release."""


def record(
    mission_file: Path, mission: Mission, overrides: Sequence[str], vehicle_overrides: Sequence[str], seed: int,
    logs: Path, end_ns: int = 2**62,
) -> Path:  # fmt: skip
    """Fly a mission in memory by the companion's own loop, and return its log, which is in a new folder of `logs`. The
    flight is the same as that of `Joined` with the same seed, to the byte."""
    files = {
        "mission": mission_file,
        "vehicle": toml_files.find("vehicles", mission.vehicle),
        "world": toml_files.find("worlds", mission.world),
    }
    body = load_body(mission.vehicle)
    settings, _ = within_reach(load_settings(None, list(overrides)), body)
    given = (*overrides, *(f"vehicle.{each}" for each in vehicle_overrides))
    plan = whole_flight.Plan(settings, body, mission, Output.RATES, "lockstep", files, seed, given)
    airframe = Airframe.load(files["vehicle"], vehicle_overrides)
    vehicle = Vehicle(airframe, World.load(files["world"]), seed=seed, lockstep=True)
    return whole_flight.fly(plan, _Vehicle(vehicle, end_ns), logs, console=False).log


def keep(job: Job, site: Site, mission_file: Path, joined: Joined) -> Path:
    """Repeat the flight with a log, up to the same moment; return the log's folder, with a picture beside the log."""
    from studies import style
    from studies.campaigns.picture import of_the_end

    folder = job.folder / "failed" / f"{job.case}_{job.seed}"
    shutil.rmtree(folder, ignore_errors=True)
    if job.setup.fault is None:
        log = record(mission_file, joined.mission, job.settings, job.setup.vehicle_overrides, job.seed,
                     folder.parent, joined.vehicle.time_ns)  # fmt: skip
        log.parent.rename(folder)
    else:  # the companion's own loop has no place for what a fault changes on the way
        folder.mkdir(parents=True)
        (folder / "said.txt").write_text("\n".join(joined.said) + "\n", encoding="utf-8")
    style.save(of_the_end(job, site, joined), folder / "end", " ".join(command(job, site)))
    return folder


def command(job: Job, site: Site) -> list[str]:
    """The command for the same flight in two processes, without a fault, from the campaign's folder."""
    changes = (*job.settings, *(f"vehicle.{each}" for each in job.setup.vehicle_overrides))
    flown_in = f"worlds/{job.case}/{site.name}"
    if job.setup.mission is not None or job.setup.vehicle is not None:
        changes += tuple(f"mission.{each}" for each in job.mission_overrides(Path(f"{flown_in}.toml")))
    mission = job.setup.mission or f"{flown_in}_mission.toml"
    options = "--sensors", PERFECT, "--seed", str(job.seed)
    return ["companion", "demo", mission, *options, *(f"--set '{each}'" for each in changes)]


# --- many ---


def jobs(
    setups: Iterable[Setup], methods: Sequence[str], seeds: int, folder: Path, overrides: Sequence[str] = ()
) -> list[Job]:
    """All jobs, those of one case together, with at most as many seeds as a set-up has."""
    return [
        Job(setup, method, speed, seed, folder, tuple(overrides))
        for setup in setups
        for method in methods
        for speed in setup.speeds
        for seed in range(1, min(seeds, setup.seeds) + 1)
    ]
