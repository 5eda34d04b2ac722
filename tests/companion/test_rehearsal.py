"""After a rehearsal nothing is left to be compiled in flight."""

import subprocess
import sys
from pathlib import Path

import pytest

from companion.config import load_body, load_settings
from companion.mission import load
from companion.rehearsal import RehearsalError, rehearse
from companion.state import Output

ROOT = Path(__file__).resolve().parents[2]

FLIGHT = """
import sys
sys.path[:0] = [{root!r}, {flights!r}]
from joined import Joined, mission_of
from companion.config import load_body, load_settings
from companion.rehearsal import rehearse
from companion.state import Output

def compiled():
    return {{
        (name, attribute, str(signature))
        for name, module in list(sys.modules.items()) if name.startswith("companion")
        for attribute, function in vars(module).items() if hasattr(function, "signatures")
        if function.py_func.__module__.startswith("companion")  # the simulator compiles what both share for itself
        for signature in function.signatures
    }}

mission = mission_of("courier")
rehearse(load_settings(None, []), load_body("paper_quad"), mission, Output.RATES)
before = compiled()
joined = Joined(mission).fly()
assert joined.autopilot.released
print(sorted(compiled() - before))
"""


def test_nothing_is_compiled_in_flight() -> None:
    script = FLIGHT.format(root=str(ROOT), flights=str(ROOT / "tests" / "flights"))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("output", Output)
@pytest.mark.parametrize("mission", ["courier", "hover", "step"])
def test_every_mission_gets_through_its_rehearsal(mission: str, output: Output) -> None:
    rehearse(load_settings(None, []), load_body("paper_quad"), load(mission)[0], output)


def test_a_rehearsal_that_does_not_end_is_an_error() -> None:
    """A companion that waits for a rate that nobody can send would wait in the air as well."""
    settings = load_settings(None, ["rates.attitude=100000.0"])
    with pytest.raises(RehearsalError, match="ATTITUDE_QUATERNION"):
        rehearse(settings, load_body("paper_quad"), load("hover")[0], Output.RATES)
