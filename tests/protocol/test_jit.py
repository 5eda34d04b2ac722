"""The cache of compiled code: used, never stale, and done without where it can't be written."""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from protocol import jit as compiled
from protocol.arrays import Array

CALLEE = """from protocol.jit import compiled
from protocol.numbers import OFFSET


@compiled
def shifted(x: float) -> float:
    return x + OFFSET
"""
CALLER = """from protocol.callee import shifted
from protocol.jit import compiled


@compiled
def twice_shifted(x: float) -> float:
    return 2.0 * shifted(x)
"""
PROBE = """from protocol.caller import twice_shifted
value = twice_shifted(1.0)
print(value, sum(twice_shifted.stats.cache_hits.values()))
"""

LATE = """from protocol.callee import shifted
from protocol.jit import compiled


@compiled
def half_shifted(x: float) -> float:
    return 0.5 * shifted(x)
"""

Run = Callable[..., tuple[float, bool]]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A project with one compiled function that calls another one, which uses a number of a third module."""
    package = tmp_path / "checkout" / "protocol"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    for module in ("jit.py", "machine_code.py"):
        shutil.copy(compiled.ROOT / "protocol" / module, package)
    (package / "numbers.py").write_text("OFFSET = 10.0\n")
    (package / "callee.py").write_text(CALLEE)
    (package / "caller.py").write_text(CALLER)
    (package / "late.py").write_text(LATE)
    return package.parent


@pytest.fixture
def run(checkout: Path, tmp_path: Path) -> Run:
    """Calls a function in a new process: its value, and whether it came from the cache."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA", "PYTHON"))}
    environment |= {"HOME": str(tmp_path / "home"), "PYTHONPATH": str(checkout)}
    # Python's own bytecode would miss an edit of the same length in the second that the file was written in.
    environment["PYTHONDONTWRITEBYTECODE"] = "1"

    def call(probe: str = PROBE) -> tuple[float, bool]:
        command = [sys.executable, "-c", probe]
        done = subprocess.run(command, env=environment, cwd=checkout, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        value, hits = done.stdout.split()
        return float(value), hits != "0"

    return call


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_the_cache_is_used_and_never_stale(checkout: Path, run: Run) -> None:
    package, cache = checkout / "protocol", checkout / ".cache" / "compiled"
    assert run() == (22.0, False)
    assert run() == (22.0, True)
    edit(package / "callee.py", "x + OFFSET", "x - OFFSET")
    assert run() == (-18.0, False)
    edit(package / "numbers.py", "10.0", "5.0")  # numba looks at caller.py alone, which is as it was
    assert run() == (-8.0, False)
    assert len([each for each in cache.iterdir() if each.is_dir()]) == 3


def test_a_source_that_another_takes_the_place_of_is_seen(checkout: Path, run: Run) -> None:
    """It has the old one's size and time, as files out of an archive may have."""
    source = checkout / "protocol" / "numbers.py"
    assert run() == (22.0, False)
    state, other = source.stat(), source.with_suffix(".new")
    other.write_text("OFFSET = 20.0\n")
    os.utime(other, ns=(state.st_atime_ns, state.st_mtime_ns))
    other.replace(source)
    assert run() == (42.0, False)


def test_the_sources_are_not_read_where_none_has_changed(checkout: Path, run: Run) -> None:
    """The digest of the time before counts; where what is kept of it is no such thing, they are read."""
    kept = checkout / ".cache" / "compiled" / "sources"
    assert run() == (22.0, False)
    stamp, digest = kept.read_text().split()
    kept.write_text(f"{stamp} elsewhere")
    assert run() == (22.0, False) and (kept.parent / "elsewhere").is_dir()
    for damaged in ("", stamp, f"{stamp} {digest} more"):
        kept.write_text(damaged)
        assert run() == (22.0, True) and kept.read_text() == f"{stamp} {digest}"


FORMS = (
    b"from companion import (  # of (two)\n    trace,\n    state as other,\n)\n",
    b"from companion import trace, \\\n    state\n",
    b"import companion.trace as t, companion.state\n",
    b"if True: import companion.trace; import companion.state\n",
    b"def late():\n    from companion import trace; from companion import state\n",
)


def parsed(source: bytes) -> set[Path]:
    """The modules that Python's own parser finds."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            path = compiled.ROOT / name.replace(".", "/")
            found |= {path.with_suffix(".py"), path / "__init__.py"}
    packages = [compiled.ROOT / name for name in ("protocol", "companion", "vehicle_sim")]
    return {path for path in found if path.is_file() and any(path.is_relative_to(each) for each in packages)}


def test_no_import_is_missed() -> None:
    packages = ("protocol", "companion", "vehicle_sim")
    sources = [path.read_bytes() for package in packages for path in (compiled.ROOT / package).rglob("*.py")]
    assert len(sources) > 100
    for source in (*sources, *FORMS):
        assert parsed(source) <= set(compiled.imported(source)), source[:200]
    for source in FORMS:
        assert {path.stem for path in parsed(source)} >= {"trace", "state"}


# A file where the folder should be refuses even root, whom a read-only mode would not stop.
def test_a_checkout_that_cant_be_written_to_uses_the_users_cache(checkout: Path, tmp_path: Path, run: Run) -> None:
    (checkout / ".cache").touch()
    assert run() == (22.0, False)
    assert list((tmp_path / "home" / ".cache" / "courier" / "compiled").rglob("*.nbc"))


def test_with_nowhere_to_write_it_compiles_without_a_cache(checkout: Path, tmp_path: Path, run: Run) -> None:
    (checkout / ".cache").touch()
    (tmp_path / "home").touch()
    assert run() == (22.0, False)
    assert not list(checkout.rglob("*.nb?"))


def test_a_new_caller_is_compiled_with_what_came_from_the_cache(run: Run) -> None:
    """It is linked with its callee, whose machine code alone was loaded."""
    early = "from protocol.callee import shifted\nprint(shifted(1.0), sum(shifted.stats.cache_hits.values()))"
    late = early.replace("print", "first = ") + "\n" + PROBE.replace("caller", "late").replace("twice", "half")
    assert run(early) == (11.0, False)
    assert run(late) == (5.5, False)
    assert run(late) == (5.5, True)


def test_calling_compiled_code_loads_nothing_of_the_compiler_s() -> None:
    """Its types of arrays take a tenth of a warm start, SciPy another one."""
    script = """
import sys
import numpy as np
from protocol.frames import multiply
assert multiply(np.ones(4), np.ones(4))[0] == -2.0
print("numba.np.arrayobj" in sys.modules, "scipy.linalg" in sys.modules)
"""
    for _ in "compiled", "loaded":
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=compiled.ROOT, capture_output=True, text=True, check=True
        )
    assert done.stdout == "False False\n"


def test_a_slice_of_another_shape_is_refused_and_one_that_fits_is_filled() -> None:
    @compiled.compiled
    def put(target: Array, source: Array) -> None:
        target[1:4] = source

    target = np.zeros(5)
    put(target, np.array([1.0, 2.0, 3.0]))
    assert target.tolist() == [0.0, 1.0, 2.0, 3.0, 0.0]
    with pytest.raises(ValueError, match="another shape"):
        put(target, np.ones(2))
    assert target.tolist() == [0.0, 1.0, 2.0, 3.0, 0.0]
