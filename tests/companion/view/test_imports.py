"""What reading a log and printing help load: nothing that compiles, flies or draws."""

import subprocess
import sys

import pytest

COMPILES_OR_FLIES = {"numba", "scipy", "ruckig", "ompl", "plotly", "viser", "companion.autopilot"}


def loaded_by(statement: str) -> set[str]:
    """The modules that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("module", "unwanted"),
    [
        ("companion.view.report", COMPILES_OR_FLIES),
        ("companion.runtime.summary", COMPILES_OR_FLIES),
        ("companion.logs.info", COMPILES_OR_FLIES | {"numpy"}),
        ("companion.cli.app", COMPILES_OR_FLIES | {"numpy", "msgspec", "mcap", "rich"}),
    ],
)
def test_a_reader_loads_no_more_than_it_needs(module: str, unwanted: set[str]) -> None:
    loaded = loaded_by(f"import {module}")
    assert module in loaded
    assert not loaded & unwanted
