"""One flight with one fault, both sides joined in memory, as a row of the table."""

import hashlib
import math
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar
from zlib import crc32

import msgspec
import numpy as np

from companion.mission.plan import Mission, Phase
from companion.state import Output
from protocol import toml_files
from protocol.arrays import Array
from studies import joined as joining
from studies.faults import catalogue, changes
from studies.faults import injector as injecting
from studies.faults.catalogue import (
    ANSWERS,
    ASTRAY,
    CONTACT,
    DELIVERED,
    FAULTS,
    LANDED,
    NOT_ENDED,
    RAISED,
    REFUSED,
    WITHDREW,
    Fault,
    Promise,
)
from studies.faults.injector import Injector, Onset
from studies.joined import Joined, mission_of
from studies.report import Track
from vehicle_sim.vehicle import Summary

FLIGHT_S = {"courier": (3.0, 72.0), "square": (3.0, 39.0)}
"""From when to when after the arming a fault may begin: off the ground, and before the landing."""
_LIMIT_S = 400.0
_ROUNDED_S = 0.01
"""Rounding of the times of what is said."""
_ASTRAY_M = 1.0
_LANDING_S = 60.0
"""For a vehicle that its companion has left."""


@dataclass(frozen=True, slots=True)
class Job:
    fault: str
    """Its key."""
    mission: str
    seed: int
    code: str
    """Digest of the code that flies: see `code`."""


class Row(msgspec.Struct, frozen=True):
    """One flight. What it did not get to is None."""

    fault: str
    mission: str
    seed: int
    code: str
    outcome: str
    cause: str | None
    """The supervisor's first fault, what was touched, or the exception."""
    began_s: float | None
    """Simulated time at which the fault began."""
    answer: str | None
    """The first one after that: one of the values of ANSWERS."""
    answer_s: float | None
    """From the fault to it."""
    tilt_deg: float
    """Greatest one from the take-off to the end."""
    clearance_m: float | None
    """Least one."""
    wall_s: float

    @property
    def job(self) -> Job:
        return Job(self.fault, self.mission, self.seed, self.code)

    @property
    def promise(self) -> Promise:
        return FAULTS[self.fault].promise

    @property
    def in_time(self) -> bool | None:
        """Whether the promised answer came, and within its time; None where none is promised."""
        promise = self.promise
        if promise.answer is None or promise.within_s is None:
            return None
        return self.answer == promise.answer and self.answer_s is not None and self.answer_s <= promise.within_s

    @property
    def kept(self) -> bool:
        """The flight ended, and was answered, as promised, at whatever time."""
        return self.outcome in self.promise.ends and self.promise.answer in (None, self.answer)


def moment_s(job: Job) -> float:
    """When after the arming the fault begins."""
    key = crc32(f"{job.fault}, {job.mission}".encode())
    return float(np.random.default_rng([job.seed, key]).uniform(*FLIGHT_S[job.mission]))


def output(job: Job) -> Output | None:
    """What the companion commands: rates on one of the missions, its own choice (None) on the other; the other way
    round with the next seed."""
    own = (job.seed + list(FLIGHT_S).index(job.mission)) % 2 and not FAULTS[job.fault].on_rates
    return None if own else Output.RATES


def injector(fault: Fault, after_s: float, seed: int) -> Injector:
    """The injector of a flight with a fault."""
    change = None if fault.change is None else fault.change(seed)
    if fault.from_start:
        return Injector(fault.link or fault.before, change, seed=seed)
    return Injector(fault.before, onset=Onset(after_s, fault.link, change), seed=seed)


def fly(job: Job, said: Callable[[str], None] = lambda text: None) -> Row:
    """Fly until the vehicle stands, touches something, or time is over. `said`: gets the companion's sentences."""
    began = time.perf_counter()
    fault = FAULTS[job.fault]
    between = injector(fault, moment_s(job), job.seed)
    joined = Joined(mission_of(job.mission), output(job), seed=job.seed, injector=between, remembers=False)
    raised = None
    try:
        joined.fly(_LIMIT_S, until=lambda joined: joined.vehicle.finished)
    except Exception as error:  # whatever it is, it is a row of the table
        raised = repr(error)
    for _ in range(round(_LANDING_S)):
        if not joined.vehicle.finished and joined.vehicle.flight.armed:
            joined.drift(1.0)
    for text in joined.said:
        said(text)
    began_s = 0.0 if fault.from_start else None if between.began_ns is None else between.began_ns * 1e-9
    lines = [(float(at), text) for at, _, text in (line.partition(" ") for line in joined.said)]
    found = answers(lines, began_s)
    pilot, summary = joined.autopilot, joined.vehicle.summary()
    done = pilot.supervisor.fault is None and pilot.navigator.phase in (Phase.LAND, Phase.DONE)
    first = found[0] if found else (None, None)
    return Row(
        fault=job.fault,
        mission=job.mission,
        seed=job.seed,
        code=job.code,
        outcome=outcome(summary, joined.mission, done, found) if raised is None else RAISED,
        cause=raised or summary.contact_with or pilot.supervisor.fault,
        began_s=began_s,
        answer=first[0],
        answer_s=first[1],
        tilt_deg=steepest_deg(np.array(joined.truths)),
        clearance_m=summary.least_clearance_m,
        wall_s=time.perf_counter() - began,
    )


def steepest_deg(states: Array) -> float:
    """The greatest tilt of states (n, 17) of a rigid body."""
    x, y = states[:, 7], states[:, 8]
    return math.degrees(np.arccos(1.0 - 2.0 * (x**2 + y**2).max()))


Answer = tuple[str, float]
"""One of the values of ANSWERS, and how long after the fault (s)."""


def answers(said: Iterable[tuple[float, str]], began_s: float | None) -> list[Answer]:
    """What the companion answered after the fault, of all that it `said` at which time (s)."""
    return [
        (answer, max(at - began_s, 0.0))
        for at, text in said
        if began_s is not None and at >= began_s - _ROUNDED_S and "vehicle: " not in text
        for answer in [next((answer for words, answer in ANSWERS.items() if words in text), None)]
        if answer is not None
    ]


def outcome(summary: Summary, mission: Mission, done: bool, answered: Sequence[Answer]) -> str:
    """One of OUTCOMES. `done`: the mission is, as the companion sees it, without a fault."""
    if summary.contacts:
        return CONTACT
    if summary.flight_time_s == 0.0:
        return REFUSED
    if summary.outcome != "landed":
        return NOT_ENDED
    if done:
        return DELIVERED if _is_where_it_belongs(summary, mission) else ASTRAY
    given = {answer for answer, _ in answered}
    return LANDED if given & {"hold", "land"} and not given & {"withdraw", "watch"} else WITHDREW


def _is_where_it_belongs(summary: Summary, mission: Mission) -> bool:
    """The vehicle is at home, and the parcel at the last waypoint, by the truth."""
    places = [(summary.final_position_ned, (0.0, 0.0))]
    if mission.delivery is not None:
        door = mission.waypoints[-1]
        places.append((summary.released_at_ned or (math.inf,) * 3, (door.north, door.east)))
    return all(math.dist(there[:2], meant) < _ASTRAY_M for there, meant in places)


def code(*more: str) -> str:
    """A digest of everything that has a say in a flight, `more` files too: rows of other code are flown anew."""
    digest = hashlib.sha256()
    folders = [
        toml_files.ROOT / name for name in ("protocol", "companion", "vehicle_sim", "worlds", "vehicles", "missions")
    ]
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".toml")]
    own = (__file__, catalogue.__file__, changes.__file__, injecting.__file__, joining.__file__, *more)
    for path in sorted([*files, *map(Path, own)]):
        digest.update(path.relative_to(toml_files.ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


class Flown(Protocol):
    """A row that knows what it is the flight of, by which code, and whether it was as promised."""

    @property
    def code(self) -> str: ...
    @property
    def job(self) -> Any: ...
    @property
    def kept(self) -> bool: ...


J = TypeVar("J", bound=Hashable)
R = TypeVar("R", bound=Flown)


def fly_missing(
    jobs: Sequence[J], kind: type[R], path: Path, fly_all: Callable[[list[J]], Iterable[R]], track: Track
) -> list[R]:
    """The flights of these jobs, rows of a kind. Those that a file keeps, one a line, are not flown again, the others
    are added to it. Without jobs: those that the code of the last one has flown."""
    kept = [msgspec.json.decode(line, type=kind) for line in path.read_bytes().splitlines()] if path.exists() else []
    if not jobs:
        return [row for row in kept if row.code == kept[-1].code]
    known = {row.job: row for row in kept}
    todo = [job for job in jobs if job not in known]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab", buffering=0) as file:
        for job, row in zip(track(todo, f"{len(todo)} flights"), fly_all(todo), strict=True):
            file.write(msgspec.json.encode(row) + b"\n")
            known[job] = row
    return [known[job] for job in jobs]
