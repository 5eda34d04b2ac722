"""The pages are true: their commands run, links lead somewhere, quoted messages exist, public names are documented."""

import ast
import inspect
import re
import shlex
import shutil
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperGroup
from typer.testing import CliRunner

import companion.api
from companion.avoidance.methods import PathPlanner
from companion.avoidance.path import Path as PlannedPath
from companion.cli.app import app as companion_app
from companion.cli.flights import DemoOptions, FlyOptions, _plan
from companion.config_avoidance import Avoidance
from companion.control.foreign import PositionLaw
from companion.control.tracking_error import TrackingError
from companion.perception.map_view import MapView
from protocol.toml_files import by_first_word
from tests.companion.mission.test_files import HOME, UP, A, B, at, plan
from tests.companion.view.made_logs import make
from vehicle_sim.airframe import Airframe
from vehicle_sim.cli import app as simulator_app
from vehicle_sim.gym import TargetEnv
from vehicle_sim.library import Setpoint, Simulation, State
from vehicle_sim.world import World

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
COMMAND = re.compile(r"^\s{4,}(?:\.venv/bin/)?(companion|vehicle-sim) (.*)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PROGRAMS = {"companion": typer.main.get_command(companion_app), "vehicle-sim": typer.main.get_command(simulator_app)}


def commands() -> list[tuple[str, str, str]]:
    """Page, program and arguments of all commands that stand in a block of code."""
    found = []
    for page in PAGES:
        text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
        found += [(page.name, program, arguments) for program, arguments in COMMAND.findall(text)]
    return found


def split(arguments: str) -> list[str]:
    """The words of a command, with its options and without a pipe and a comment."""
    words = shlex.split(re.sub(r"(?<= )\[(--.*?)\]", r"\1", arguments), comments=True)
    cut = next((index for index, word in enumerate(words) if word in (">", "|", "&", "&&")), len(words))
    return [word.replace("...", "hover") for word in words[:cut]]


def parse(program: str, arguments: str) -> tuple[Any, dict[str, Any]]:
    """The command and its options by name. Raises what the program would refuse the arguments with."""
    words = split(arguments)
    command: Any = PROGRAMS[program]
    context = command.context_class(command, info_name=program)
    while isinstance(command, TyperGroup):
        name, command, words = command.resolve_command(context, words)
        context = command.context_class(command, context, name)
    command.parse_args(context, words)
    return command, context.params


def test_the_pages_have_commands() -> None:
    assert len(commands()) > 40


@pytest.mark.parametrize(("page", "program", "arguments"), commands())
def test_a_command_of_the_pages_is_understood(page: str, program: str, arguments: str) -> None:
    parse(program, arguments)


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the pages' commands expect it: a flight, the README's mission, a ground station's, a vehicle."""
    folder = tmp_path_factory.mktemp("started")
    shutil.copytree(make(folder / "made", 2.0).parent, folder / "logs" / "flown")
    shutil.copy(folder / "logs" / "flown" / "flight.mcap", folder / "LOG")
    (mission,) = re.findall(r'^```toml\n(name = "mine"\n.*?)^```', (ROOT / "README.md").read_text(), re.M | re.S)
    (folder / "mission.toml").write_text(mission)
    shutil.copy(ROOT / "vehicles" / "x500.toml", folder / "vehicle.toml")
    (folder / "trip.plan").write_text(plan([UP, at(*A, 2.0), at(*B), HOME]))
    return folder


QUICK = ("report", "logs", "mission", "foxglove", "key")
"""Commands that are run here as they stand."""
FLOWN = ("demo", "fly")
"""Commands of which all is done here that is done before a process is started or a link opened."""
SHOWN = {
    "check": "tests/companion/runtime/test_check.py::test_the_command_prints_a_table_or_json",
    "view": "tests/companion/view/test_live.py::test_the_page_moves_the_vehicle_draws_the_scan_and_obeys_the_slider",
    "replay": "tests/companion/logs/test_replay.py::test_what_if",
    "--mission": "tests/companion/runtime/test_locate.py::"
    "test_the_vehicle_s_own_mission_is_planned_and_goes_into_the_log",
    "vehicle-sim": "tests/vehicle_sim/test_vehicle_cli.py::test_overrides_and_truth_of_a_whole_process",
    "detour": "tests/companion/test_plugins.py::"
    "test_a_foreign_law_and_a_foreign_planner_deliver_and_fly_again_to_the_byte",
}
"""The tests that run the others."""


def word_of(program: str, arguments: str) -> str:
    """Which of the tables above a command is in."""
    if program == "vehicle-sim":
        return program
    return next((part for part in ("--mission", "detour") if part in arguments), arguments.split()[0])


@pytest.mark.parametrize(
    ("page", "arguments"),
    [(page, rest) for page, program, rest in commands() if word_of(program, rest) in (*QUICK, *FLOWN)],
)
def test_a_command_of_the_pages_runs(
    page: str, arguments: str, started: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(started)
    monkeypatch.setenv("HOME", str(tmp_path))
    shutil.copy("mission.toml" if page == "README.md" else "vehicle.toml", "mine.toml")
    if arguments.split()[0] in QUICK:
        words = [word.replace("~", str(tmp_path)).replace("FILE", str(tmp_path / "file")) for word in split(arguments)]
        done = CliRunner().invoke(companion_app, words)
        assert done.exit_code == 0, done.output
        return
    command, options = parse("companion", arguments)
    asked, seed = (DemoOptions(**options), 1) if command.name == "demo" else (FlyOptions(**options), None)
    station = asked.mission.endswith(".plan") and seed is None
    planned = _plan(asked, seed, (47.3977, 8.5456) if station else None)
    if seed is not None:
        overrides = by_first_word(planned.overrides, ("vehicle", "world", "mission"))
        Airframe.load(planned.files["vehicle"], overrides["vehicle"])
        World.load(planned.files["world"], overrides["world"])


def test_the_settings_for_a_larger_vehicle_are_flown_with(started: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(started)
    (block,) = re.findall(r"^```toml\n(\[avoidance\]\n.*?)^```", (ROOT / "docs" / "lidar.md").read_text(), re.M | re.S)
    Path("large.toml").write_text(block)
    planned = _plan(FlyOptions(mission="courier", settings=Path("large.toml")), None)
    added = {
        round(getattr(now, name) - getattr(usual, name), 9)
        for now, usual in (
            (planned.settings.avoidance, Avoidance()),
            *(
                (getattr(planned.settings.avoidance, part), getattr(Avoidance(), part))
                for part in ("plan", "vfh", "guard")
            ),
        )
        for name in now.__struct_fields__
        if isinstance(getattr(now, name), float) and getattr(now, name) != getattr(usual, name)
    }
    assert added == {0.14}


def test_every_other_command_of_the_pages_is_run_by_the_test_that_is_named() -> None:
    words = {word_of(program, arguments) for _, program, arguments in commands()}
    assert words == {*QUICK, *FLOWN, *SHOWN}
    for test in SHOWN.values():
        file, _, name = test.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text()


def test_a_command_that_does_not_exist_is_found() -> None:
    for arguments in ("fly hover --nosuch 1", "nosuch", "mission nosuch", "mission show"):
        with pytest.raises(Exception, match=r"(?i)no such|missing"):
            parse("companion", arguments)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        assert re.match(r"https?:|mailto:", link) or (page.parent / link).exists(), link


def anchor(heading: str) -> str:
    """The link to a heading, as mkdocs and GitHub make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip("# \n").lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_headings(page: Path) -> None:
    """A generated page has lost a section before."""
    for name, wanted in re.findall(r"\]\(([^)\s#]*)#([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if name.startswith(("http:", "https:")):
            continue
        there = (page.parent / name if name else page).read_text(encoding="utf-8")
        assert wanted in map(anchor, re.findall(r"^#+ .*$", there, re.MULTILINE)), f"{name}#{wanted}"


@cache
def sources() -> str:
    """The programs' code, with the parts of a string on several lines put together."""
    text = "\n".join(
        path.read_text(encoding="utf-8")
        for folder in ("companion", "protocol")
        for path in (ROOT / folder).rglob("*.py")
    )
    return re.sub(r'"\s*\n\s*f?"', "", text)


def test_the_messages_of_the_troubleshooting_page_are_the_programs_own() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    messages = re.findall(r"^\| ((?:`[^`]+`(?:, )?)+) \|", page, re.MULTILINE)
    assert len(messages) > 15
    for message in messages:
        for part in re.split(r"\.\.\.|`, `|`", message):
            words = part.strip(" :,")
            assert len(words) < 4 or words in sources() or words.startswith("Address already in use"), words


def test_the_site_names_every_page() -> None:
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = re.findall(r"^ +- .*?([\w./-]+\.md)$", site.partition("\nnav:\n")[2], re.MULTILINE)
    assert sorted(named) == sorted(str(page.relative_to(ROOT)) for page in PAGES)


def undocumented(kind: type) -> list[str]:
    """A class's public attributes and methods without a docstring, as its source has them."""
    (body,) = (node.body for node in ast.parse(inspect.getsource(kind)).body if isinstance(node, ast.ClassDef))
    found = []
    for node, after in zip_longest(body, body[1:]):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            name, documented = node.name, ast.get_docstring(node) is not None
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            name = ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
            documented = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        else:
            continue
        found += [] if documented or name.startswith("_") else [name]
    return found


DOCUMENTED = [*(getattr(companion.api, name) for name in companion.api.__all__), Setpoint, Simulation, State, TargetEnv]
DOCUMENTED += [PositionLaw, TrackingError, PathPlanner, PlannedPath, MapView]


@pytest.mark.parametrize("kind", DOCUMENTED)
def test_public_names_are_documented(kind: type) -> None:
    assert kind.__doc__ and undocumented(kind) == []
