"""The compiler's code goes back to the system, and can still be used."""

import subprocess
import sys

import pytest

SCRIPT = """
import re
from pathlib import Path

import numba

from companion.runtime.memory import give_back, unchanged

def resident_kb(begin):
    block = Path("/proc/self/smaps").read_text().split(f"{begin:x}-")[1]
    return int(re.search(r"Rss: +([0-9]+) kB", block)[1])

doubled = numba.njit(lambda x: 2.0 * x)
assert doubled(1.0) == 2.0
places = [begin for begin, _ in unchanged("libllvmlite")]
before = sum(map(resident_kb, places))
give_back()
assert before > 30_000 and sum(map(resident_kb, places)) < 0.2 * before, before
halved = numba.njit(lambda x: 0.5 * x)
assert halved(1.0) == 0.5 and doubled(2) == 4.0
"""


@pytest.mark.skipif(sys.platform != "linux", reason="where the system shows no mappings, none are given back")
def test_what_compiles_is_given_back_and_compiles_again() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 0, done.stderr
