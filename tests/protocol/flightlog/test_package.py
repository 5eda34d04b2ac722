"""What importing the log costs, and who may be imported by it."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["protocol.flightlog", "protocol.flightlog.summary"])
def test_a_log_is_read_without_what_flies(module: str) -> None:
    heavy = ("numba", "numpy", "pymavlink", "msgspec", "companion")
    code = f"import sys, {module}\nprint(*(name for name in {heavy} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
