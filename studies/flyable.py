"""What the companion's own commands refuse to fly is not flown by campaigns either."""

from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path

from companion.autopilot import Autopilot
from companion.mission.plan import Mission
from companion.plugins import PluginError
from companion.runtime.feasibility import PlanError, check_gains, feasible, within_reach
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.planning import InProcessPlanner
from companion.state import Output
from protocol.toml_files import TomlFileError
from studies.campaign import Job, Setup


def check(setups: Iterable[Setup], methods: Sequence[str], seed: int = 1, overrides: Sequence[str] = ()) -> None:
    """Raises TomlFileError, which names the set-up and the method, where settings, mission and vehicle do not go
    together or what another package brings can't be made. `seed`: of the places that are looked at."""
    for setup, method in product(setups, methods):
        job = Job(setup, method, min(setup.speeds), seed, Path(), tuple(overrides))
        try:
            _check(job)
        except (PlanError, PluginError) as error:
            raise TomlFileError(f"{setup.name}, {method}: {error}") from error


def _check(job: Job) -> None:
    """The checks of `companion demo` before it rehearses. Raises PlanError, PluginError and TomlFileError."""
    mission, settings = _mission(job), load_settings(None, job.settings)
    body = load_body(job.setup.vehicle or mission.vehicle)
    feasible(settings, body, mission, Output.RATES)
    settings, _ = within_reach(settings, body)
    check_gains(settings, body, Output.RATES)
    if settings.plugins:  # whoever flies makes them like this
        Autopilot(settings, body, mission, Output.RATES)
        InProcessPlanner(settings.avoidance)


def _mission(job: Job) -> Mission:
    setup = job.setup
    if setup.mission is not None:
        return load_mission(setup.mission)[0]
    return setup.site(job.seed).mission(job.speed, Path())
