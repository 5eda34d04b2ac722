"""What an installation from the wheel has: the programs and the files that they need."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from protocol.toml_files import ROOT

DATA = "missions", "vehicles", "worlds"
PACKAGES = "companion", "protocol", "studies", "vehicle_sim"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's content, as pip installs it. It is built from a copy, since building writes there."""
    pytest.importorskip("setuptools")
    folder = tmp_path_factory.mktemp("wheel")
    source, out = folder / "source", folder / "site"
    for name in (*DATA, *PACKAGES):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet")
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, "-w", str(folder), str(source)], check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(out)
    return out


@pytest.mark.parametrize("folder", DATA)
def test_it_has_all_files_of(folder: str, site: Path) -> None:
    ours = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*.toml")}
    assert ours and ours == {path.relative_to(site) for path in (site / folder).rglob("*.toml")}


def test_it_starts_anywhere(site: Path, tmp_path: Path) -> None:
    """The installed modules, not those of this folder, load a world and a vehicle with sensors."""
    program = f"""
import sys
sys.path.insert(0, {str(site)!r})
from protocol.toml_files import find
from vehicle_sim.airframe import Airframe
from vehicle_sim.world import World
World.load(find("worlds", "empty"))
airframe = Airframe.load(find("vehicles", "paper_quad"), ['estimator.sensors="gnss"'])
assert airframe.sensors() is not None
print(find("missions", "courier"))
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(site / "missions" / "courier.toml"), done.stderr
