"""Campaigns of many flights: each flight of a set-up, a method, a speed and a seed is flown in memory and is one row of
a table.

A flight is a success if the vehicle came within `GOAL_M` of the goal, in time, and touched nothing until it stood
there. Its time runs from the first step of the route until it is within `GOAL_M`. The companion knows only the
waypoints.
"""

import dataclasses
import math
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from companion.config_avoidance import Avoidance
from companion.mission.plan import Mission, Phase
from companion.runtime import flight as whole_flight
from companion.runtime.files import load_body, load_settings
from companion.state import Output
from protocol import toml_files as toml_files
from protocol.arrays import Array
from protocol.frames import rotate
from protocol.transport import TransportError
from studies.escape import Abilities, avoidable
from studies.joined import Joined
from studies.tracks import on_all_cores
from studies.worlds import HULL, Site, shortest
from vehicle_sim.airframe import Airframe
from vehicle_sim.sensors.lidar import beam_azimuths, sector_ranges
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

GOAL_M = 2.0
DEFAULT = Avoidance().method
REACHED = "reached"

_ON_ROUTE = (Phase.ROUTE,)


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
        """Name of the flights that share a row of the report."""
        return f"{self.setup.name}_{self.method}_{self.speed:.3g}"

    @property
    def settings(self) -> tuple[str, ...]:
        return (*self.setup.overrides, f'avoidance.method="{self.method}"', *self.overrides)


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
    path_speed: float
    """path_m / route_s"""
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

    @property
    def way_over_shortest(self) -> float:
        """The flown way and its rest over the shortest way, or over the straight one where that was not computed."""
        return (self.path_m + GOAL_M) / (self.shortest_m or self.straight_m)

    @property
    def succeeded(self) -> bool:
        return self.outcome == REACHED


class Interval(NamedTuple):
    low: float
    high: float


def wilson(successes: int, total: int, z: float = 1.959964) -> Interval:
    """Wilson's score interval of a share (95 % by default); (0, 1) for no trials."""
    if total == 0:
        return Interval(0.0, 1.0)
    share = successes / total
    scale = 1.0 + z * z / total
    middle = (share + z * z / (2 * total)) / scale
    half = z / scale * math.sqrt(share * (1.0 - share) / total + z * z / (4.0 * total * total))
    return Interval(max(0.0, middle - half), min(1.0, middle + half))


# --- one flight ---


def fly(job: Job) -> Row:
    """Fly one flight; log, world and picture of a failure are written to the job's folder."""
    began = time.perf_counter()
    site = job.setup.site(job.seed)
    _, mission_file = site.save(job.folder / "worlds", job.speed)
    mission = site.mission(job.speed, job.folder / "worlds" / f"{site.name}.toml")
    vehicle = job.setup.vehicle_overrides
    joined = Joined(mission, overrides=job.settings, seed=job.seed, vehicle_overrides=vehicle, remembers=False)
    watch, stages = _Watch(job, site), _Stages(joined)
    joined.fly(limit_s=job.setup.limit_s + 30.0, until=watch.over)
    row = watch.row(joined)
    if not row.succeeded:
        folder = keep(job, site, mission_file, joined)
        row = dataclasses.replace(row, log=str(folder.relative_to(job.folder)))
    return dataclasses.replace(row, wall_s=time.perf_counter() - began, **stages.medians())


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
        self._arrived: int | None = None

    def over(self, joined: Joined) -> bool:
        vehicle, phase = joined.vehicle, joined.autopilot.navigator.phase
        if self._began is None:
            if phase in _ON_ROUTE:
                self._began = vehicle.tick
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
        return joined.autopilot.navigator.step_index >= len(self._site.waypoints)

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
            path_speed=path / route_s,
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
    settings = load_settings(None, list(overrides))
    given = (*overrides, *(f"vehicle.{each}" for each in vehicle_overrides))
    plan = whole_flight.Plan(
        settings, load_body(mission.vehicle), mission, Output.RATES, "lockstep", files, seed, given
    )
    airframe = Airframe.load(files["vehicle"], vehicle_overrides)
    vehicle = Vehicle(airframe, World.load(files["world"]), seed=seed, lockstep=True)
    return whole_flight.fly(plan, _Vehicle(vehicle, end_ns), logs, console=False).log


def keep(job: Job, site: Site, mission_file: Path, joined: Joined) -> Path:
    """Repeat the flight with a log, up to the same moment; return the log's folder, with a picture beside the log."""
    from studies import style

    mission = joined.mission
    end_ns = joined.vehicle.time_ns
    log = record(mission_file, mission, job.settings, job.setup.vehicle_overrides, job.seed, job.folder / "failed",
                 end_ns)  # fmt: skip
    folder = log.parent.with_name(f"{job.case}_{job.seed}")
    shutil.rmtree(folder, ignore_errors=True)
    log.parent.rename(folder)
    style.save(_contact_picture(job, site, joined), folder / "end", " ".join(command(job, site)))
    return folder


def command(job: Job, site: Site) -> list[str]:
    """The command for the same flight in two processes."""
    changes = (*job.settings, *(f"vehicle.{each}" for each in job.setup.vehicle_overrides))
    return ["companion", "demo", f"{site.name}_mission.toml", "--seed", str(job.seed),
            *(f"--set '{each}'" for each in changes)]  # fmt: skip


def _contact_picture(job: Job, site: Site, joined: Joined) -> Any:
    from studies import style
    from studies.route import draw_world

    path = np.array([*joined.truths, joined.vehicle.state])[:, :3]
    figure, (whole, near) = style.sheet(1, 2, height=4.6, width=8.4)
    for axes in (whole, near):
        draw_world(axes, joined.vehicle.world, site.height)
        axes.plot(path[:, 1], path[:, 0], color=style.PALETTE[0], label="flown")
        axes.plot([0.0, *(e for _, e in site.waypoints)], [0.0, *(n for n, _ in site.waypoints)],
                  color=style.GREY, ls=":", lw=0.8)  # fmt: skip
        axes.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    from matplotlib.patches import Circle

    north, east = path[-1, :2]
    near.add_patch(Circle((east, north), HULL, facecolor="none", ec=style.PALETTE[1], lw=1.4))
    seen = _seen(joined)
    near.plot(seen[:, 1], seen[:, 0], ".", color=style.PALETTE[1], ms=3, label="last scan")
    draw_map(near, joined)
    near.set(xlim=(east - 4.0, east + 4.0), ylim=(north - 4.0, north + 4.0))
    near.legend(loc="lower right")
    whole.plot(site.goal[1], site.goal[0], "*", color=style.PALETTE[1], ms=9)
    whole.set_title(f"{site.name}, {job.method}, {job.speed:.3g} m/s, seed {job.seed}")
    near.set_title(f"after {joined.vehicle.time_ns * 1e-9:.2f} s")
    return figure


def draw_map(axes: Any, joined: Joined) -> None:
    """Draw the companion's map at the end; grey is free."""
    view = joined.planner.pipeline.local_map.view
    if view is None:
        return
    from matplotlib.colors import ListedColormap

    from companion.perception.map_view import FREE, OCCUPIED
    from studies import style

    shades = np.where(view.states == OCCUPIED, 2, np.where(view.states == FREE, 1, 0))
    (south, west), size = view.cell * np.array(view.corner), view.cell * np.array(view.states.shape)
    axes.imshow(shades, cmap=ListedColormap(["#ffffff", "#e4e9ef", style.PALETTE[3]]), vmin=0, vmax=2, origin="lower",
                extent=(west, west + size[1], south, south + size[0]), interpolation="none", zorder=0.5)  # fmt: skip


def _seen(joined: Joined) -> Array:
    """(n, 2) north, east (m) of a scan's returns at the end, without noise."""
    vehicle, azimuths = joined.vehicle, beam_azimuths(1)
    cos, sin = np.cos(azimuths), np.sin(azimuths)
    ranges = sector_ranges(
        vehicle.world.boxes, vehicle.world.cylinders, vehicle.state[:3], vehicle.state[6:10], cos, sin,
        vehicle.airframe.lidar.max_range_m,
    )  # fmt: skip
    beams = [
        distance * rotate(vehicle.state[6:10], np.array([c, s, 0.0]))[:2]
        for distance, c, s in zip(ranges, cos, sin, strict=True)
        if math.isfinite(distance)
    ]
    points: Array = vehicle.state[:2] + np.array(beams).reshape(-1, 2)
    return points


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


def run(
    todo: Sequence[Job],
    track: Callable[[Iterable[Row], str], Iterator[Row]],
    on: Callable[..., Iterator[Row]] | None = None,
) -> list[Row]:
    """Fly the jobs on all cores; each case is written as CASE.parquet to its folder when it is complete."""
    fly_all = on or on_all_cores
    rows: list[Row] = []
    results = zip(todo, track(fly_all(fly, todo), f"{len(todo)} flights"), strict=True)
    for _, group in groupby(results, key=lambda pair: (pair[0].folder, pair[0].case)):
        case = list(group)
        write([row for _, row in case], case[0][0].folder / f"{case[0][0].case}.parquet")
        rows += [row for _, row in case]
    return rows


def write(rows: Sequence[Row], path: Path) -> None:
    """Write one row for each flight, as Parquet; most readers take all files of a folder as one table."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(field.name, kinds[_kind(field.type)]) for field in dataclasses.fields(Row)])
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.Table.from_pylist([dataclasses.asdict(row) for row in rows], schema=schema)
    parquet.write_table(table, path, compression="zstd")


def _kind(annotation: Any) -> type:
    """`float | None` -> float."""
    kind: type
    for kind in getattr(annotation, "__args__", (annotation,)):
        if kind is not type(None):
            return kind
    raise TypeError(f"{annotation} is no type of a column")


def read(folder: Path) -> list[Row]:
    """All rows in a folder, case by case."""
    from pyarrow import parquet

    return [Row(**row) for path in sorted(folder.glob("*.parquet")) for row in parquet.read_table(path).to_pylist()]
