"""The vehicle's estimator: whether it is as wrong as it says, with other errors of the sensors by each seed.

A flight is flown by the whole vehicle on its sensors. Its true path is then sensed and estimated again with each seed.

NEES: a component's squared error over its covariance; NIS: squared innovations over theirs. Y. Bar-Shalom, X. Li and
T. Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), 5.4.2: the average over independent
flights is chi-square distributed, of an expectation of 1 for each degree of freedom.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import chi2

from companion.curves import Shape
from companion.mission.plan import Mission, Phase, Waypoint
from protocol.arrays import Array
from protocol.toml_files import find
from studies.engine import on_all_cores
from studies.joined import Joined
from studies.report import Cell, Report
from vehicle_sim.airframe import Airframe
from vehicle_sim.estimation import kalman
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.faults import Failure
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.timing import TICK_NS, TICK_S

NAME = "consistency"
TITLE = "The estimator's consistency"

SEEDS = 50
LEVELS = ("rtk", "gnss", "vio")
HOVER, LEMNISCATE = "hover", "lemniscate"
SPEED_M_S, RADIUS_M, LAPS = 5.0, 8.0, 4.0
HEIGHT_M = 10.0
BEGIN_S, WATCHED_S, EVERY_S = 2.0, 30.0, 0.2
"""From so long after the shape's start, or that of the stop, for so long, so often."""
OUTAGE_S = (10.0, 15.0)
"""After the beginning of what is watched."""
PARTS = {
    "hover": (HOVER, 0.0, WATCHED_S),
    "lemniscate": (LEMNISCATE, 0.0, OUTAGE_S[0]),
    "outage, and after it": (LEMNISCATE, OUTAGE_S[0], WATCHED_S),
}
"""What is told of: a flight, from when on and until when."""
STATES = {"attitude": slice(0, 3), "velocity": slice(3, 6), "position": slice(6, 9)}
"""The filter's error."""
SENSORS = ("fix", "field", "height")
INTRODUCTION = f"""
Whether the simulated vehicle's filter ([vehicle-sim.md](vehicle-sim.md#sensors-and-the-estimator)) is as wrong as it
says. Each flight is flown on the sensors. Its true path is then sensed and estimated again with seeds 1 to {SEEDS},
each with errors of all sensors of its own; seed 1 repeats the flight's own estimate to the bit. The hover is a stop,
the lemniscate is flown at up to {SPEED_M_S:g} m/s; {WATCHED_S:g} s of each are looked at. In the lemniscate nothing
tells the position from {OUTAGE_S[0]:g} to {OUTAGE_S[1]:g} s.

Of each quantity the table has the average over seeds and time, 1 being as it should, and the share of the times at
which the average over the seeds is inside of its 95 % band.
"""
FLOORS_M = {"rtk": 0.05, "gnss": 0.5}
WITHIN = 0.95


@dataclass(frozen=True)
class Plan:
    """One flight on sensors, and the seeds of the sensors' errors on its path; those of `seeds[0]` fly it."""

    level: str
    flight: str
    seeds: tuple[int, ...]
    watched_s: float = WATCHED_S

    def silent(self, since: int) -> bool:
        """Whether nothing tells the position so many ticks after the beginning of what is watched."""
        return self.flight == LEMNISCATE and _ticks(OUTAGE_S[0]) <= since < _ticks(OUTAGE_S[1])


@dataclass(frozen=True)
class Flown:
    """A true path."""

    motions: list[Motion]
    """At the end of each tick, from the start on."""
    begin: int
    """Tick from which on it is watched."""
    fault: str | None
    position_ned: Array
    """Where the vehicle believed to be at the end."""


@dataclass(frozen=True)
class Watched:
    """What was seen of one estimator."""

    squares: dict[str, Array]
    """(n, 2): NEES of each of `STATES` at each time, NIS of each of `SENSORS` at each reading, after the time (s)."""
    level_m: Array
    """(n, 2): horizontal distance of the estimate from the truth, after the time (s)."""
    position_ned: Array
    """Estimated at the end."""


def freedom(level: str, name: str) -> int:
    """Components of an error or a reading."""
    return {"height": 1, "fix": 3 if level == "vio" else 6}.get(name, 3)


def band(degrees: int, seeds: int) -> tuple[float, float]:
    """Between which 95 % of the averages over so many flights are, each component's share being 1."""
    low, high = chi2.ppf((0.025, 0.975), degrees * seeds) / (degrees * seeds)
    return float(low), float(high)


def wrong(estimator: Estimator) -> Array:
    """From the estimate to the truth, in the order of the filter's errors (9,)."""
    error = estimator.error
    turned = 2.0 * math.copysign(1.0, error[6]) * error[7:10]
    return -np.concatenate((turned, error[3:6], error[:3]))


def squared(estimator: Estimator, part: slice) -> float:
    """Such errors measured by their covariance (NEES)."""
    error = wrong(estimator)[part]
    return float(error @ np.linalg.solve(estimator.covariance[part, part], error))


def mission_of(plan: Plan) -> Mission:
    """A lemniscate, or a stop of its duration."""
    if plan.flight == HOVER:
        stay = Waypoint(0.0, 0.0, HEIGHT_M, hold_s=BEGIN_S + plan.watched_s + 1.0)
        return Mission("stay", waypoints=[stay], takeoff_height=HEIGHT_M)
    shape = Shape("lemniscate", SPEED_M_S, radius=RADIUS_M, laps=LAPS)
    return Mission("track", trajectory=shape, takeoff_height=HEIGHT_M)


def fly(plan: Plan) -> Flown:
    """Fly on the sensors, as the whole vehicle does."""
    sensors, free = (f'estimator.sensors="{plan.level}"',), ('avoidance.method="none"',)
    joined = Joined(mission_of(plan), overrides=free, seed=plan.seeds[0], vehicle_overrides=sensors, remembers=False)
    estimator, motions, begin = joined.vehicle.estimator, [joined.vehicle.motion], 0
    assert isinstance(estimator, Estimator)

    def over(joined: Joined) -> bool:
        nonlocal begin
        tick = joined.vehicle.tick
        if tick:
            motions.append(joined.vehicle.motion)
        if not begin and joined.autopilot.navigator.phase in (Phase.TRACK, Phase.ROUTE):
            begin = tick + _ticks(BEGIN_S)
        _fail(estimator, bool(begin) and plan.silent(tick + 1 - begin))
        return bool(begin) and tick - begin >= _ticks(plan.watched_s)

    joined.fly(limit_s=200.0, until=over)
    fault = joined.autopilot.supervisor.fault or joined.vehicle.flight.crash
    return Flown(motions, begin, fault, estimator.nominal[kalman.POSITION].copy())


def _fail(estimator: Estimator, silent: bool) -> None:
    estimator.suite.positioning.failure = Failure.OFF if silent else Failure.OK


def watch(plan: Plan, flown: Flown, seed: int) -> Watched:
    """Estimate along a path, with the errors that the sensors of a vehicle of this seed have."""
    sensors = Airframe.load(find("vehicles", "paper_quad"), (f'estimator.sensors="{plan.level}"',)).sensors()
    assert sensors is not None
    start = flown.motions[0]
    sensing, alignment = np.random.default_rng(seed).spawn(4)[2:]
    estimator = Estimator(SensorSuite(sensors, start, sensing), 0.0, start, alignment)
    squares: dict[str, list[tuple[float, float]]] = {name: [] for name in (*STATES, *SENSORS)}
    level: list[tuple[float, float]] = []
    for tick, motion in enumerate(flown.motions[1:], 1):
        since = tick - flown.begin
        time_s = since * TICK_S
        _fail(estimator, plan.silent(since))
        before = estimator.fix_ratios, estimator.field_ratios, estimator.height_ratios
        estimator.update(motion)
        if since < 0:
            continue
        ratios = estimator.fix_ratios, estimator.field_ratios, estimator.height_ratios
        for name, new, old in zip(SENSORS, ratios, before, strict=True):
            if new is not old:
                squares[name].append((time_s, float(new.sum())))
        if since % _ticks(EVERY_S) == 0:
            for name, part in STATES.items():
                squares[name].append((time_s, squared(estimator, part)))
            level.append((time_s, math.hypot(*wrong(estimator)[6:8].tolist())))
    by_name = {name: np.array(found) for name, found in squares.items()}
    return Watched(by_name, np.array(level), estimator.nominal[kalman.POSITION].copy())


def fly_and_watch(plan: Plan) -> tuple[str | None, list[Watched]]:
    """The flight's fault, and what was seen with each seed."""
    flown = fly(plan)
    return flown.fault, [watch(plan, flown, seed) for seed in plan.seeds]


def _ticks(seconds: float) -> int:
    return round(seconds * 1e9) // TICK_NS


@dataclass(frozen=True)
class Averages:
    """A quantity averaged over flights, at each time or reading."""

    over_flights: Array
    """(n,), each component's share."""
    low: float
    high: float

    @property
    def mean(self) -> float:
        """Over all of the time."""
        return float(self.over_flights.mean())

    @property
    def inside(self) -> float:
        """Share of the times at which it is in the band."""
        return float(((self.low <= self.over_flights) & (self.over_flights <= self.high)).mean())

    @property
    def consistent(self) -> bool:
        return self.low <= self.mean <= self.high


def within(rows: Array, begin_s: float, end_s: float) -> Array:
    """The values of rows (n, 2) of times and values."""
    times: Array = rows[:, 0]
    found: Array = rows[(begin_s <= times) & (times < end_s), 1]
    return found


def averages(
    level: str, watched: Sequence[Watched], begin_s: float = 0.0, end_s: float = math.inf
) -> dict[str, Averages]:
    """By state and sensor, over what was watched."""
    found = {}
    for name in (*STATES, *SENSORS):
        rows = [within(each.squares[name], begin_s, end_s) for each in watched]
        shortest, degrees = min(len(row) for row in rows), freedom(level, name)
        over = np.mean([row[:shortest] for row in rows], axis=0) / degrees
        found[name] = Averages(over, *band(degrees, len(watched)))
    return found


def _caption() -> str:
    """The bands, by the components of what is averaged."""
    bands = ", ".join(
        f"{low:.2f} to {high:.2f} for {what}"
        for what, (low, high) in (
            ("errors, fields and poses of `vio`", band(3, SEEDS)),
            ("fixes of a receiver", band(6, SEEDS)),
            ("heights", band(1, SEEDS)),
        )
    )
    return f"NEES of each error and NIS of each reading, a component's share. Bands: {bands}"


def run(report: Report) -> None:
    report.text(INTRODUCTION)
    plans = [Plan(level, flight, tuple(range(1, SEEDS + 1))) for level in LEVELS for flight in (HOVER, LEMNISCATE)]
    flown = dict(
        report.progress(
            zip(((p.level, p.flight) for p in plans), on_all_cores(fly_and_watch, plans), strict=True), "consistency"
        )
    )
    rows: list[Sequence[Cell]] = []
    every: list[Averages] = []
    horizontal: dict[str, float] = {}
    for level, (part, (flight, begin_s, end_s)) in product(LEVELS, PARTS.items()):
        fault, watched = flown[level, flight]
        found = averages(level, watched, begin_s, end_s)
        level_m = np.array([within(each.level_m, begin_s, end_s) for each in watched])
        every += found.values()
        root = float(np.sqrt((level_m**2).mean()))
        horizontal[level] = max(horizontal.get(level, 0.0), root if fault is None else math.inf)
        shown = (f"{each.mean:.2f}, {100.0 * each.inside:.0f} %" for each in found.values())
        rows.append((level, part, *shown, root, float(level_m.max())))
    report.table(("sensors", "flight", *STATES, *SENSORS, "level, RMS / m", "level, most / m"), rows, _caption())
    inside = sum(each.consistent for each in every)
    report.check("averages that are inside the band", f">= {100.0 * WITHIN:g} %",
                 f"{inside} of {len(every)}", inside >= WITHIN * len(every))  # fmt: skip
    for level, floor in FLOORS_M.items():
        report.check(f"horizontal error, {level}, RMS of the worst row", f"<= {floor:g} m",
                     f"{horizontal[level]:.4f} m", horizontal[level] <= floor)  # fmt: skip
