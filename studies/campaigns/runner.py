"""How a campaign is flown: what its table lacks, on a cluster, until there are enough flights of each case."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from distributed import Client

from studies import campaign
from studies.campaign import CaseKey, Job, Row
from studies.campaigns.statistics import wilson
from studies.campaigns.table import Seeds, Table, naming
from studies.engine import LIMIT_S, Done, EngineError, Failed, as_they_end

AT_LEAST = 20


@dataclass(frozen=True, slots=True)
class Stop:
    """A case is over when Wilson's interval of its success is at most so wide."""

    width: float
    """Width of the interval, as a share of 1."""
    at_least: int = AT_LEAST
    """Flights."""


@dataclass(frozen=True, slots=True)
class Flown:
    """What comes back of a flight. Workers need no folder in common with whoever asked for it."""

    row: Row
    files: dict[str, bytes]
    """Files of a failure: contents by the path in the campaign's folder."""
    folder: str
    """In which the flight was; the files name it."""


def fly_afar(job: Job) -> Flown:
    """Fly a job in a folder of its own."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        row = campaign.fly(dataclasses.replace(job, folder=folder))
        kept = [path for path in folder.rglob("*") if path.is_file()] if row.log is not None else []
        return Flown(row, {path.relative_to(folder).as_posix(): path.read_bytes() for path in kept}, name)


class Case:
    """The flights of a case in the order of their seeds, up to the first that has not been flown.

    They alone say when there are enough: so that does not depend on the order in which flights end.
    """

    def __init__(self, jobs: Sequence[Job], stop: Stop | None) -> None:
        self._jobs = jobs
        self._stop = stop
        self.flown = 0
        self.successes = 0
        self.over = False

    def update(self, table: Table) -> None:
        """Look at what has been flown since."""
        while not self.over and self.flown < len(self._jobs):
            row = table.row(self._jobs[self.flown])
            if row is None:
                return
            self.flown += 1
            self.successes += row.succeeded
            low, high = wilson(self.successes, self.flown)
            stop = self._stop
            self.over = stop is not None and self.flown >= stop.at_least and high - low <= stop.width

    @property
    def seeds(self) -> Seeds:
        """The first and the last seed that count."""
        return self._jobs[0].seed, self._jobs[self.flown - 1 if self.over else -1].seed

    def rows(self, table: Table) -> list[Row]:
        """Those that count: of what was in the air when there were enough, nothing."""
        jobs = self._jobs[: self.flown] if self.over else self._jobs
        return [row for job in jobs if (row := table.row(job)) is not None]


class Campaign:
    """Jobs and the table of their flights. Each row is on disk as soon as its flight has ended, so whatever kills a
    campaign costs it the flights that are in the air. `alone`: no other rows in the folder count."""

    def __init__(self, jobs: Sequence[Job], folder: Path, stop: Stop | None = None, alone: bool = True) -> None:
        self.table = Table(folder)
        by_case: dict[CaseKey, list[Job]] = {}
        for job in jobs:
            by_case.setdefault(job.key[:3], []).append(job)
        self.cases = {case: Case(chosen, stop) for case, chosen in by_case.items()}
        for case in self.cases.values():
            case.update(self.table)
        self.jobs, self._alone, self._ended = jobs, alone, dict[CaseKey, Seeds]()
        self._end()

    @property
    def todo(self) -> list[Job]:
        """What has not been flown, unless there are enough of its case."""
        return [job for job in self.jobs if self.table.row(job) is None and not self.cases[job.key[:3]].over]

    def fly(self, client: Client, limit_s: float = LIMIT_S, fly: Callable[[Job], Flown] = fly_afar) -> Iterator[Row]:
        """Fly what is to do, and yield each row when it is on disk. Raises EngineError."""
        todo = (job for job in self.todo if not self.cases[job.key[:3]].over)  # a case may be over by then
        for ended in as_they_end(client, fly, todo, limit_s):
            rows = [self._keep(each) for each in ended]
            self.table.add(rows)
            for case in {each.job.key[:3] for each in ended}:
                self.cases[case].update(self.table)
            self._end()
            yield from rows

    def finish(self) -> list[Row]:
        """Merge the table; the rows that count, sorted."""
        self.table.finish()
        return sorted((row for case in self.cases.values() for row in case.rows(self.table)), key=lambda row: row.key)

    def _end(self) -> None:
        """Keep which seeds count, if that has changed."""
        ends = {key: case.seeds for key, case in self.cases.items()}
        if self._alone and ends != self._ended:
            self.table.end(ends)
            self._ended = ends

    def _keep(self, done: Done[Job, Flown]) -> Row:
        job, flown = done.job, done.result
        if isinstance(flown, Failed):
            return lost(job, flown.why)
        if flown.row.code != job.code:
            raise EngineError("a worker has another version of Courier, a plug-in, a world, a vehicle or a mission")
        for name, content in flown.files.items():
            path = job.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.suffix == ".toml":
                content = content.replace(flown.folder.encode(), str(job.folder.absolute()).encode())
            with naming(path):
                path.write_bytes(content)
        return flown.row


def lost(job: Job, why: str) -> Row:
    """The row of a flight that failed in all attempts."""
    return Row(
        setup=job.setup.name, method=job.method, speed=job.speed, seed=job.seed, outcome=why, met=None, avoidable=None,
        contact_speed=None, route_s=0.0, path_m=0.0, straight_m=0.0, shortest_m=None, goal_speed=0.0,
        top_speed=0.0, least_clearance=None, blocked_share=None, guarded_share=None, simulated_s=0.0, wall_s=0.0,
        log=None, code=job.code,
    )  # fmt: skip
