"""Campaigns' files: what is wrong in one is said with its name, before anything is flown."""

import shutil
import sys
from pathlib import Path

import pytest

from protocol.toml_files import TomlFileError
from studies import __main__ as command_line
from studies import flyable, packages
from studies.campaign import DEFAULT
from studies.campaigns import files
from tests.companion.broken_package import broken_package
from tests.companion.installed import EXAMPLE, installed

PLACE = '[[place]]\nworld = "forest"\n'


def written(folder: Path, text: str, method: str = DEFAULT) -> Path:
    """A campaign's file of this text."""
    file = folder / "mine.toml"
    file.write_text(f'name = "mine"\nseeds = 1\nmethods = ["{method}"]\n{text}', encoding="utf-8")
    return file


def settings(*overrides: str) -> str:
    return f'{PLACE}[[settings]]\nname = "plain"\n[[settings]]\nname = "changed"\nset = {list(overrides)}\n'


@pytest.mark.parametrize("wrong", ['world = "swamp"', 'world = "forest"\noptions = {densty = 1}'])
def test_what_is_wrong_in_a_file_is_said_with_its_name(wrong: str, tmp_path: Path) -> None:
    with pytest.raises(TomlFileError, match=r"mine\.toml: place (swamp|forest): no such"):
        files.load(written(tmp_path, f"[[place]]\n{wrong}\n"))


@pytest.mark.parametrize("name", ["far/near", "two words", r"line\n", r"\nline", ""])
def test_a_name_is_one_of_a_folder(name: str, tmp_path: Path) -> None:
    file = written(tmp_path, PLACE)
    file.write_text(file.read_text(encoding="utf-8").replace('"mine"', f'"{name}"'), encoding="utf-8")
    with pytest.raises(TomlFileError, match=r"mine\.toml: .* - at `name`"):
        files.load(file)


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("avoidance.guard.keep_out=0.1", "avoidance.guard.keep_out 0.1: less than avoidance.vehicle_radius"),
        ("limits.highest_thrust=0.3", "limits.highest_thrust 0.3: the vehicle hovers at 0.48"),
        ("rates.scan=1.0", "supervision.scan_timeout 0.5: must be above "),
        ("control.position.c1=[30.0, 30.0, 30.0]", "no vehicle of this [body]"),
    ],
)
def test_what_the_demo_refuses_a_campaign_does_not_fly(override: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(TomlFileError) as refused:
        files.load(written(tmp_path, settings(override)))
    assert str(refused.value).startswith(f"{tmp_path / 'mine.toml'}: forest, changed, {DEFAULT}: "), refused.value
    assert says in str(refused.value)


def test_the_vehicle_is_the_one_of_the_file(tmp_path: Path) -> None:
    """It hovers with less thrust than the paper's does."""
    weak = settings("limits.highest_thrust=0.3")
    files.load(written(tmp_path, f'{weak}[[vehicle]]\nname = "sun_quad"\n'))
    with pytest.raises(TomlFileError, match=r"hovers at 0\.48$"):
        files.load(written(tmp_path, f'{weak}[[vehicle]]\nname = "paper_quad"\n'))


@pytest.mark.parametrize(
    ("method", "good", "bad", "says"),
    [
        ("none", "control.position.options.kp=3.0", "control.position.options.kpp=3.0", 'position law "saturated"'),
        ("detour", "avoidance.options.room=0.8", "avoidance.options.rooom=0.8", 'planner "detour"'),
    ],
)
def test_a_plugin_that_can_not_be_made_is_said(method: str, good: str, bad: str, says: str, tmp_path: Path) -> None:
    with installed(EXAMPLE, tmp_path):
        law = "control.position.law=saturated"
        files.load(written(tmp_path, settings(law, good), method))
        with pytest.raises(TomlFileError) as refused:
            files.load(written(tmp_path, settings(law, bad), method))
    text = str(refused.value)
    assert text.startswith(f"{tmp_path / 'mine.toml'}: forest, changed, {method}: {says} of courier-example 0.1.0: ")
    assert bad.split("=")[0].rpartition(".")[2] in text


def loaded() -> list[str]:
    """The modules of the example's package."""
    return [name for name in sys.modules if name.partition(".")[0] == "courier_example"]


def test_rows_of_a_package_that_was_changed_are_flown_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sources or its version; a campaign that does not fly by it keeps its rows."""
    package, site = tmp_path / "plugin", tmp_path / "site"
    shutil.copytree(EXAMPLE, package)
    for name in loaded():
        monkeypatch.delitem(sys.modules, name)

    def codes() -> tuple[str, str]:
        packages.digest.cache_clear()
        site.mkdir()
        with installed(package, site):
            found = [files.load(written(tmp_path, PLACE, method)) for method in ("detour", "none")]
            own, other = (each.jobs(each.setups(), tmp_path)[0].code for each in found)
        shutil.rmtree(site)
        for name in loaded():
            del sys.modules[name]  # as another process
        return own, other

    seen = [codes()]
    for path in (package / "courier_example" / "planner.py", package / "courier_example" / "law.py"):
        path.write_text(f"{path.read_text()}\n# repaired\n")
        seen.append(codes())
    project = package / "pyproject.toml"
    project.write_text(project.read_text().replace("0.1.0", "0.2.0"))
    seen += [codes(), codes()]
    assert len({own for own, _ in seen}) == 4 and len({other for _, other in seen}) == 1
    assert seen[3] == seen[4]


def test_a_package_of_one_file_is_a_package(tmp_path: Path) -> None:
    overrides = ("control.position.law=broken",)
    with broken_package(tmp_path):
        packages.digest.cache_clear()
        before = packages.digest(overrides)
        source = tmp_path / "package" / "broken.py"
        source.write_text(f"{source.read_text()}\n# repaired\n")
        packages.digest.cache_clear()
        assert before != packages.digest(overrides) != "" and packages.digest(()) == ""
    packages.digest.cache_clear()


def test_all_studies_of_the_project_can_be_flown() -> None:
    studies = [study for page in command_line.PAGES for study in command_line._studies(page)]
    setups = [setup for study in studies for setup in getattr(study, "SETUPS", ())]
    assert len(setups) > 20
    flyable.check(setups, (DEFAULT,))
