"""A search for flights that fail: the file of a campaign with ranges in place of numbers, and an optimiser that comes
nearer to contact from generation to generation.

A `[search]` table has the ranges by name; "{name}" stands for the number anywhere in the rest of the file. The seed is
drawn anew for each flight. Each failure becomes a file of its own, which flies again by its name.
"""

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cma
import msgspec
import numpy as np
from distributed import Client

from protocol import toml_files
from protocol.arrays import Array
from protocol.toml_files import TomlFileError
from studies.campaign import Job, Row
from studies.campaigns.files import AT_LEAST_ONE, CampaignFile, Count
from studies.campaigns.runner import fly_afar
from studies.campaigns.table import naming
from studies.engine import LIMIT_S, Failed, as_they_end
from studies.worlds import toml

GENERATION = 8
"""Flights that are chosen together."""
_SEEDS = 1_000_000
_NAMED = re.compile(r"\{(\w+)\}")

Values = Mapping[str, float]


class SearchTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[search]` table."""

    ranges: Annotated[dict[str, tuple[float, float]], AT_LEAST_ONE]
    budget: Count = 200
    """Flights."""
    failures: Count = 1
    """That are enough."""
    seed: Count = 1
    """Seed of the search."""


@dataclass(frozen=True, slots=True)
class Tried:
    """A flight of a search."""

    number: int
    values: dict[str, float]
    seed: int
    score: float
    """m from a failure, which is 0 or less."""
    outcome: str
    file: dict[str, Any]
    """The tables of a campaign of this flight alone."""


@dataclass(frozen=True, slots=True)
class SearchFile:
    """A file with a `[search]` table, and the other tables."""

    search: SearchTable
    tables: dict[str, Any]

    @classmethod
    def load(cls, path: Path) -> "SearchFile":
        """Raises TomlFileError for a file that can't be searched, also if the middle or an end of its ranges can't be
        flown."""
        tables = toml_files.load(path, dict)
        if "search" not in tables:
            raise TomlFileError(f"{path}: it has no table [search]")
        search = toml_files.convert(tables.pop("search"), SearchTable, f"{path}: search")
        for name, (low, high) in search.ranges.items():
            if not low < high:
                raise TomlFileError(f"{path}: search.ranges.{name}: {low} is not below {high}")
        named = set(_NAMED.findall(repr(tables)))
        for name in named ^ set(search.ranges):
            lacks = "the table search.ranges" if name in named else "the rest of the file"
            raise TomlFileError(f"{path}: {name} is not in {lacks}")
        found = cls(search, tables)
        middle = {name: 0.5 * (low + high) for name, (low, high) in search.ranges.items()}
        toml_files.convert(_filled(tables, middle), CampaignFile, str(path))  # its own name, too
        if len(found.jobs(path, middle)) != 1:
            raise TomlFileError(f"{path}: a search has one place, vehicle, settings, fault, method and speed")
        for name, ends in search.ranges.items():
            for end in ends:
                found.jobs(path, {**middle, name: end})
        return found

    def jobs(self, path: Path, values: Values) -> list[Job]:
        """The flights of values. Raises TomlFileError, which names the file at `path`, if they can't be flown."""
        try:
            flight = self.flight("values", values, 1)
            return flight.jobs(flight.setups(), Path())
        except TomlFileError as error:
            raise TomlFileError(f"{path}: {error}") from error

    def flight(self, name: str, values: Values, seed: int) -> CampaignFile:
        """The campaign of one flight. Raises TomlFileError."""
        return toml_files.convert(self.filled(name, values, seed), CampaignFile, name)

    def filled(self, name: str, values: Values, seed: int) -> dict[str, Any]:
        """The tables of its file."""
        tables: dict[str, Any] = _filled(self.tables, values)
        return {**tables, "name": name, "seeds": 1, "first_seed": seed}


def _filled(value: Any, values: Values) -> Any:
    """A text that is nothing but a name in braces becomes its number."""
    match value:
        case dict():
            return {key: _filled(each, values) for key, each in value.items()}
        case list():
            return [_filled(each, values) for each in value]
        case str():
            for name, number in values.items():
                if value == f"{{{name}}}":
                    return number
                value = value.replace(f"{{{name}}}", repr(number))
    return value


def score(row: Row, limit_s: float) -> float:
    """How far a flight is from failing: its least clearance (m), or twice the share of its time that is left, if that
    is less; -1 for a failure."""
    if not row.succeeded:
        return -1.0
    spare = 2.0 * (1.0 - row.route_s / limit_s)
    return max(min(spare, math.inf if row.least_clearance is None else row.least_clearance), 1e-6)


Ask = Callable[[], list[Array]]
Tell = Callable[[list[Array], list[float]], None]
"""Points of the unit cube, and their scores."""


def at_random(dimensions: int, seed: int) -> tuple[Ask, Tell]:
    """Sampling: it learns nothing."""
    rng = np.random.default_rng(seed)
    return lambda: list(rng.random((GENERATION, dimensions))), lambda points, scores: None


def by_cma(dimensions: int, seed: int) -> tuple[Ask, Tell]:
    """CMA-ES (Hansen), from the middle of the ranges."""
    rng = np.random.default_rng(seed)  # of its own: by default it seeds and draws from numpy's global one
    drawn = {"seed": math.nan, "randn": lambda *shape: rng.standard_normal(shape)}
    options = {"bounds": [0.0, 1.0], "popsize": GENERATION, "verbose": -9, **drawn}
    strategy = cma.CMAEvolutionStrategy(dimensions * [0.5], 0.3, options)
    return strategy.ask, strategy.tell


SAMPLERS: dict[str, Callable[[int, int], tuple[Ask, Tell]]] = {"cma": by_cma, "random": at_random}


class Chooser:
    """A sampler over ranges, by name, that also draws the seed of each flight."""

    def __init__(self, ranges: Mapping[str, tuple[float, float]], sampler: str, seed: int) -> None:
        self._names = list(ranges)
        self._low, self._high = np.array(list(ranges.values())).T
        self._ask, self._tell = SAMPLERS[sampler](len(ranges), seed)
        self._rng = np.random.default_rng(seed)
        self._points: list[Array] = []

    def ask(self) -> list[tuple[dict[str, float], int]]:
        """Values and seed of each flight of the next generation."""
        self._points = self._ask()
        return [(self._values(point), int(self._rng.integers(1, _SEEDS))) for point in self._points]

    def tell(self, scores: list[float]) -> None:
        """How near to a failure each flight of the generation came."""
        self._tell(self._points, scores)

    def _values(self, point: Array) -> dict[str, float]:
        found = self._low + point * (self._high - self._low)
        ends = zip(self._names, found, self._low, self._high, strict=True)
        return {name: _short(each, low, high) for name, each, low, high in ends}


def _short(value: float, low: float, high: float) -> float:
    """A number of a range with as many digits as a thousandth of its width needs, four at least."""
    digits = math.floor(math.log10(max(-low, high) / (high - low)))
    return min(max(float(f"{value:.{4 + max(digits, 0)}g}"), float(low)), float(high))


def search(file: SearchFile, sampler: str, client: Client) -> Iterator[Tried]:
    """Fly, generation by generation, until there are enough failures or the budget is used up; yields each flight, in
    the order of their numbers. The same search tries the same flights. Raises EngineError."""
    asked, number, failures = file.search, 0, 0
    chooser = Chooser(asked.ranges, sampler, asked.seed)
    while number < asked.budget and failures < asked.failures:
        trials = dict(enumerate(chooser.ask()[: asked.budget - number], start=number + 1))
        number += len(trials)
        tried = _fly(file, trials, client)
        if number < asked.budget:
            chooser.tell([each.score for each in tried])
        failures += sum(each.score <= 0.0 for each in tried)
        yield from tried


def _fly(file: SearchFile, trials: dict[int, tuple[dict[str, float], int]], client: Client) -> list[Tried]:
    """A generation, by its numbers."""
    numbers, limits, wall_limit_s = {}, {}, LIMIT_S
    for number, (values, seed) in trials.items():
        flight = file.flight(f"{number}", values, seed)
        (job,) = flight.jobs(flight.setups(), Path())
        numbers[job] = number
        limits[number], wall_limit_s = flight.limit_s, flight.wall_limit_s
    tried = {}
    for batch in as_they_end(client, fly_afar, list(numbers), wall_limit_s):
        for done in batch:
            number = numbers[done.job]
            values, seed = trials[number]
            if isinstance(done.result, Failed):
                points, outcome = -1.0, done.result.why
            else:
                points, outcome = score(done.result.row, limits[number]), done.result.row.outcome
            name = f"{file.tables['name']}-{number}"
            tried[number] = Tried(number, values, seed, points, outcome, file.filled(name, values, seed))
    return [tried[number] for number in trials]


def keep(tried: Tried, folder: Path) -> Path:
    """Write a flight as a campaign's file, which flies it again by its name. Where another search has found another
    failure as that flight, that one is kept, and the new one's name has a number behind it."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(1):
        name = f"{tried.file['name']}{f'_{number}' if number > 1 else ''}"
        text = f"# Found by a search, as flight {tried.number}: {tried.outcome}.\n{toml({**tried.file, 'name': name})}"
        path = folder / f"{name}.toml"
        if not path.exists() or path.read_text(encoding="utf-8") == text:
            break
    with naming(path):
        path.write_text(text, encoding="utf-8")
    return path
