"""The compiler's code goes back to the system, and can still be used."""

import subprocess
import sys

import pytest

SCRIPT = """
import re
from pathlib import Path

import numba

from companion.runtime.memory import give_back

def resident_kb():
    sizes = re.findall(r"/libllvmlite[^/\\n]*\\n(?:Size|KernelPageSize|MMUPageSize).*?Rss: +([0-9]+) kB", smaps(), re.S)
    return sum(map(int, sizes))

def smaps():
    return Path("/proc/self/smaps").read_text()

doubled = numba.njit(lambda x: 2.0 * x)
assert doubled(1.0) == 2.0
before = resident_kb()
give_back()
assert before > 40_000 and resident_kb() < 6_000, (before, resident_kb())
halved = numba.njit(lambda x: 0.5 * x)
assert halved(1.0) == 0.5 and doubled(2) == 4.0
"""


@pytest.mark.skipif(sys.platform != "linux", reason="where the system shows no mappings, none are given back")
def test_what_compiles_is_given_back_and_compiles_again() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 0, done.stderr
