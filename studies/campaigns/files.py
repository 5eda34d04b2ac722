"""The file of a campaign: places x vehicles x settings x faults x methods x speeds x seeds, as jobs."""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import msgspec

from companion.config_types import Speed
from companion.mission.plan import Mission
from companion.runtime.files import load_mission
from protocol import toml_files
from protocol.toml_files import TomlFileError
from protocol.vehicle_parameters import Positive
from studies import flyable
from studies.campaign import DEFAULT, Job, Setup, chooses_method
from studies.campaigns.runner import AT_LEAST, Stop
from studies.engine import LIMIT_S
from studies.faults.catalogue import FAULTS
from studies.sites import SITES
from studies.worlds import Site
from vehicle_sim.airframe import Airframe
from vehicle_sim.world import World

AT_LEAST_ONE = msgspec.Meta(min_length=1)
Count = Annotated[int, msgspec.Meta(ge=1, le=10_000_000)]


class PlaceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `[[place]]`: a world that each seed makes anew, a mission, or a mission in such a world."""

    world: str | None = None
    """A kind of place (`python -m studies worlds`); none: the mission's own world."""
    mission: str | None = None
    """A mission with waypoints; none: the place's own way, from its start to its goal."""
    options: dict[str, float] = {}
    """Options of the kind of place, as density = 0.04."""
    set: tuple[str, ...] = ()
    """Overrides of the world's file, as "wind.mean_ned=[4.0, 0.0, 0.0]"."""

    @property
    def title(self) -> str:
        words = [f"{self.mission} in {self.world}" if self.mission and self.world else self.mission or self.world or ""]
        return ", ".join([*words, *(f"{name} {value:g}" for name, value in self.options.items()), *self.set])


class VariantTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `[[settings]]`: overrides of the companion's settings, by a name."""

    name: str
    set: tuple[str, ...] = ()


class VehicleTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `[[vehicle]]`. What is set is of the simulated vehicle alone: the companion knows the file."""

    name: str | None = None
    """None: the mission's."""
    set: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        return ", ".join([*([self.name] if self.name else []), *self.set])


class StopTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[stop]` table: how narrow the interval of each case's success has to be."""

    width: Annotated[float, msgspec.Meta(gt=0, le=1)]
    at_least: Count = AT_LEAST


class CampaignFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A whole file."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+\Z")]
    place: Annotated[tuple[PlaceTable, ...], AT_LEAST_ONE]
    vehicle: Annotated[tuple[VehicleTable, ...], AT_LEAST_ONE] = (VehicleTable(),)
    settings: Annotated[tuple[VariantTable, ...], AT_LEAST_ONE] = (VariantTable("default"),)
    faults: Annotated[tuple[str, ...], AT_LEAST_ONE] = ("",)
    """Faults of docs/faults.md; "" is none."""
    methods: Annotated[tuple[str, ...], AT_LEAST_ONE] = (DEFAULT,)
    speeds: Annotated[tuple[Speed, ...], AT_LEAST_ONE] = (5.0,)
    seeds: Count = 100
    """Number of seeds of each case."""
    first_seed: Count = 1
    limit_s: Positive = 60.0
    """Simulated time on the route."""
    wall_limit_s: Positive = LIMIT_S
    """Time limit of one flight."""
    stop: StopTable | None = None

    def __post_init__(self) -> None:
        names = [setup.name for setup in self._all()]
        if len(set(names)) < len(names):
            raise ValueError("two cases are the same: give the settings names of their own")
        for key, values in (("methods", self.methods), ("speeds", self.speeds)):
            if len(set(values)) < len(values):
                raise ValueError(f"{key}: one of them is there twice")
        for fault in self.faults:
            if fault and fault not in FAULTS:
                raise ValueError(f"faults: there is no {fault!r} (there: {'; '.join(FAULTS)})")
        for place in self.place:
            if place.world is None and place.mission is None:
                raise ValueError("place: it has either a world, or a mission, or both")
            if place.world is None and place.options:
                raise ValueError(f"place {place.mission}: options are of a kind of place, and there is no world")
        for variant in self.settings:
            if chooses_method(variant.set):
                raise ValueError(f"settings {variant.name}: avoidance.method is for the key methods")

    @property
    def stopping(self) -> Stop | None:
        return None if self.stop is None else Stop(self.stop.width, self.stop.at_least)

    def setups(self) -> list[Setup]:
        """All of them, checked. Raises TomlFileError for what the flights would refuse."""
        setups = self._all()
        for setup in setups:
            _check(setup, self.first_seed)
        flyable.check(setups, self.methods, self.first_seed)
        return setups

    def jobs(self, setups: Sequence[Setup], folder: Path) -> list[Job]:
        """All seeds of all cases, seed by seed: whenever a campaign ends, its cases have the same seeds."""
        last = self.first_seed + self.seeds
        return [
            Job(setup, method, speed, seed, folder)
            for seed in range(self.first_seed, last)
            for setup in setups
            for method in self.methods
            for speed in self.speeds
        ]

    def _all(self) -> list[Setup]:
        """What there is only one of is not in the names: so two files can be compared that differ in it."""
        return [
            Setup(
                name=name,
                title=name,
                site=partial(place_at, table=table),
                speeds=self.speeds,
                limit_s=self.limit_s,
                seeds=self.seeds,
                overrides=variant.set,
                vehicle_overrides=vehicle.set,
                mission=table.mission,
                vehicle=vehicle.name,
                fault=fault or None,
            )
            for table, vehicle, variant, fault in product(self.place, self.vehicle, self.settings, self.faults)
            for name in [", ".join(self._words(table, vehicle, variant, fault))]
        ]

    def _words(self, place: PlaceTable, vehicle: VehicleTable, variant: VariantTable, fault: str) -> Iterator[str]:
        yield place.title
        if len(self.vehicle) > 1:
            yield vehicle.title
        if len(self.settings) > 1:
            yield variant.name
        if len(self.faults) > 1:
            yield fault or "no fault"


def place_at(seed: int, table: PlaceTable) -> Site:
    """The place of a seed. Raises TomlFileError."""
    site = None if table.world is None else _made(seed, table.world, table)
    if table.mission is not None:
        mission = load_mission(table.mission)[0]
        if site is None:
            world = toml_files.find("worlds", mission.world)
            site = Site(world.stem, toml_files.read(world), ())
        places = tuple((point.north, point.east) for point in mission.waypoints)
        site = replace(site, waypoints=places, height=mission.takeoff_height)
    assert site is not None
    return replace(site, tables=toml_files.convert(site.tables, dict, table.title, table.set))


def _made(seed: int, world: str, table: PlaceTable) -> Site:
    """A place of its kind. Raises TomlFileError for options of which none can be made."""
    try:
        return SITES[world](seed, **_as_asked(table))
    except (ValueError, TypeError, ArithmeticError) as error:
        raise TomlFileError(f"place {table.title}: seed {seed} can't be made ({error})") from error


def _as_asked(table: PlaceTable) -> Mapping[str, Any]:
    """The options, whole numbers as such."""
    return {name: int(value) if float(value).is_integer() else value for name, value in table.options.items()}


def _check(setup: Setup, seed: int) -> None:
    """Raises TomlFileError for a place that can't be."""
    table: PlaceTable = setup.site.keywords["table"]  # type: ignore[attr-defined]
    if table.world is not None:
        if table.world not in SITES:
            raise TomlFileError(f"place {table.world}: no such kind of place (there: {', '.join(SITES)})")
        known = list(inspect.signature(SITES[table.world]).parameters)[1:]
        for name in table.options:
            if name not in known:
                raise TomlFileError(f"place {table.world}: no such option {name} (there: {', '.join(known) or 'none'})")
    mission = None if table.mission is None else load_mission(table.mission)[0]
    if mission is not None and not mission.waypoints:
        raise TomlFileError(f"place {table.mission}: a campaign needs a mission with waypoints")
    if mission is not None and mission.profile != "smooth":
        raise TomlFileError(f'place {table.mission}: a campaign needs a mission with the profile "smooth"')
    site = setup.site(seed)
    World.from_tables(site.tables, setup.name)
    if mission is None:
        toml_files.convert(site.plan(min(setup.speeds), Path()), Mission, f"place {setup.name}")
    vehicle = setup.vehicle or ("paper_quad" if mission is None else mission.vehicle)
    Airframe.load(toml_files.find("vehicles", vehicle), setup.vehicle_overrides)


def load(path: Path) -> CampaignFile:
    """Read and check a campaign's file. Raises TomlFileError, naming the file."""
    given = toml_files.load(path, CampaignFile)
    try:
        given.setups()
    except TomlFileError as error:
        raise TomlFileError(f"{path}: {error}") from error
    return given
