"""Packages with plug-ins, installed for a test without an installer: a folder on the path with their metadata."""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion import plugins

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plugin"


@contextmanager
def installed(package: Path, folder: Path) -> Iterator[None]:
    """The package of a folder with a pyproject.toml; `folder` is for its metadata."""
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    name, version = project["name"].replace("-", "_"), project["version"]
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n")
    groups = (
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in entries.items())
        for group, entries in project["entry-points"].items()
    )
    (info / "entry_points.txt").write_text("".join(groups))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(package), str(folder), *sys.path])
        plugins.installed.cache_clear()
        yield
    plugins.installed.cache_clear()
