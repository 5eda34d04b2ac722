"""Rules of the project that no linter knows: import contracts that bite, the ground truth, locked packages, sizes."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.slow import SLOW, seconds

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("protocol", "companion", "vehicle_sim")

# --- import contracts -------------------------------------------------------------------------------------------------

OFFENCES = [
    ("protocol knows neither process", "protocol/framing.py", "import companion.state"),
    ("protocol knows neither process", "protocol/clock.py", "import vehicle_sim"),
    ("the two processes meet on the wire only", "vehicle_sim/__init__.py", "import companion.state"),
    ("the two processes meet on the wire only", "companion/runtime/__init__.py", "import vehicle_sim"),
    ("layers of the companion", "companion/control/__init__.py", "import companion.avoidance"),
    ("layers of the companion", "companion/perception/__init__.py", "import companion.avoidance"),
    ("layers of the companion", "companion/avoidance/__init__.py", "import companion.autopilot"),
    ("layers of the companion", "companion/autopilot.py", "import companion.runtime"),
    ("layers of the companion", "companion/runtime/__init__.py", "import companion.logs"),
    ("layers of the companion", "companion/view/__init__.py", "import companion.cli"),
    ("layers of the companion", "companion/new_module.py", ""),
    ("only guidance reads trajectories", "companion/mission/__init__.py", "import companion.trajectory"),
    ("purity of the companion", "companion/autopilot.py", "from time import monotonic"),
    ("purity of the companion", "companion/state.py", "import multiprocessing.shared_memory"),
    ("purity of the companion", "companion/supervision/__init__.py", "from pathlib import Path"),
    ("purity of the companion", "companion/link/__init__.py", "from protocol.transport import Udp"),
    ("purity of the companion", "companion/avoidance/__init__.py", "def chance():\n    import random"),
    ("purity of the companion", "companion/new_module.py", "import socket"),
    ("purity of the protocol", "protocol/peer.py", "import time"),
    ("purity of the protocol", "protocol/new_module.py", "import random"),
    ("only the transport opens sockets", "companion/view/__init__.py", "import socket"),
    ("only the simulator's runner reads a clock", "vehicle_sim/__init__.py", "import time"),
    ("logs are read without compiled code", "protocol/flightlog/__init__.py", "from protocol import frames"),
]
"""Contract, file, and what is added to that file to break the contract."""


def verdicts(root: Path) -> dict[str, str]:
    """KEPT or BROKEN of each contract for the packages in `root`, which has a pyproject.toml."""
    command = [str(Path(sys.executable).with_name("lint-imports")), "--cache-dir", str(root / "cache")]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    found = dict(re.findall(r"^(.+?) (KEPT|BROKEN)\b", done.stdout, re.MULTILINE))
    assert found, done.stdout + done.stderr
    assert (done.returncode == 0) is ("BROKEN" not in found.values())
    return found


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages and the contracts in a folder of their own; all contracts are kept."""
    root = tmp_path_factory.mktemp("packages")
    shutil.copy(ROOT / "pyproject.toml", root)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__"))
    assert set(verdicts(root).values()) == {"KEPT"}
    return root


@pytest.mark.parametrize(("contract", "file", "added"), OFFENCES)
def test_an_import_against_a_contract_breaks_it(copied: Path, contract: str, file: str, added: str) -> None:
    path = copied / file
    before = path.read_text(encoding="utf-8") if path.exists() else None
    path.write_text(f"{before or ''}\n{added}\n", encoding="utf-8")
    try:
        assert verdicts(copied)[contract] == "BROKEN"
    finally:
        path.unlink() if before is None else path.write_text(before, encoding="utf-8")


def test_each_contract_is_shown_to_break() -> None:
    names = re.findall(r'contracts\]\]\nname = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert set(names) == {contract for contract, _, _ in OFFENCES}


# --- what imports do not show -----------------------------------------------------------------------------------------

IMPURE = ("runtime", "logs", "view", "cli", "__main__.py")
PURE = [
    path
    for path in sorted((ROOT / "companion").rglob("*.py"))
    if path.relative_to(ROOT / "companion").parts[0] not in IMPURE
]


@pytest.mark.parametrize("path", PURE, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_stage_names_the_truth_or_draws_random_numbers(path: Path) -> None:
    """The ground truth crosses the wire as HIL_STATE_QUATERNION alone, and no stage may know its name."""
    text = path.read_text(encoding="utf-8").lower()
    for forbidden in ("hil_state", "numpy.random", "np.random", "default_rng"):
        assert forbidden not in text, forbidden


# --- what is installed ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lock", "extras"), [("run", ()), ("dev", ("dev",)), ("peers", ("dev", "peers"))])
def test_every_package_is_locked_to_files_by_their_hashes(lock: str, extras: tuple[str, ...]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = [*project["dependencies"], *(each for extra in extras for each in project["optional-dependencies"][extra])]
    entries = re.split(r"\n(?=\S)", (ROOT / "constraints" / f"{lock}.txt").read_text("utf-8").strip())
    locked = {re.match(r"[\w.-]+(?===)", each)[0].lower().replace("_", "-"): each for each in entries}  # type: ignore[index]
    for each in wanted:
        assert re.match(r"[\w-]+", each)[0].lower() in locked  # type: ignore[index]
    for each in entries:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", each), each
    assert "://" not in "".join(entries)


# --- what is found by its name ----------------------------------------------------------------------------------------


def test_each_folder_of_code_is_a_package() -> None:
    """Others are not installed."""
    for package in (*PACKAGES, "studies"):
        for path in (ROOT / package).rglob("*.py"):
            assert (path.parent / "__init__.py").exists(), path


@pytest.mark.parametrize("name", SLOW)
def test_what_is_listed_as_slow_exists(name: str) -> None:
    file, _, test = name.partition("::")
    assert (ROOT / file).exists()
    assert not test or re.search(rf"^def {test.partition('[')[0]}\(", (ROOT / file).read_text("utf-8"), re.MULTILINE)


def test_the_longest_name_that_fits_says_how_slow_a_test_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"tests/a": 1.0, "tests/a/b.py": 2.0, "tests/a/b.py::c": 3.0, "tests/a/b.py::c[x]": 4.0}.items():
        monkeypatch.setitem(SLOW, name, value)
    tests = ("tests/a/x.py::c", "tests/a/b.py::d", "tests/a/b.py::c[y::z/w]", "tests/a/b.py::c[x]", "tests/b.py::c")
    assert [seconds(test) for test in tests] == [1.0, 2.0, 3.0, 4.0, 0.0]


# --- sizes ------------------------------------------------------------------------------------------------------------

FILE_LINES = 500
CLASS_LINES = 300
FIELDS = 25
FUNCTION_LINES = 60
PARAMETERS = 7
REASON = "# Longer than a screen: "
"""The comment directly above a function that is longer on purpose begins so and says why."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def fields(node: ast.ClassDef) -> set[str]:
    """The attributes that its methods set and those that its body declares."""
    found = {
        each.target.id
        for each in node.body
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name) and "ClassVar" not in ast.dump(each)
    }
    for method in node.body:
        if isinstance(method, Function) and method.args.args:
            own = method.args.args[0].arg
            found |= {
                each.attr
                for each in ast.walk(method)
                if isinstance(each, ast.Attribute)
                and isinstance(each.ctx, ast.Store)
                and isinstance(each.value, ast.Name)
                and each.value.id == own
            }
    return found


def parameters(node: Function) -> int:
    """How many arguments may be given by position; the instance or class of a method is not counted."""
    names = [each.arg for each in node.args.posonlyargs + node.args.args]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def has_reason(node: Function, lines: list[str]) -> bool:
    """Whether the comment directly above it (and above its decorators) says why it is so long."""
    above = min([node.lineno, *(each.lineno for each in node.decorator_list)]) - 2
    while above >= 0 and lines[above].strip().startswith("#"):
        if lines[above].strip().startswith(REASON):
            return True
        above -= 1
    return False


def excesses(text: str) -> Iterator[str]:
    """What in a module is larger than it may be: `name: lines`, `name: fields`, `name: parameters`."""
    lines = text.splitlines()
    if len(lines) >= FILE_LINES:
        yield ": lines"

    def inside(parent: ast.AST, prefix: str) -> Iterator[str]:
        for node in ast.iter_child_nodes(parent):
            if not isinstance(node, ast.ClassDef | Function):
                if not isinstance(node, ast.expr):  # in which nothing is defined
                    yield from inside(node, prefix)
                continue
            name = f"{prefix}{node.name}"
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if isinstance(node, ast.ClassDef):
                if length > CLASS_LINES:
                    yield f" {name}: lines"
                if len(fields(node)) > FIELDS:
                    yield f" {name}: fields"
            else:
                if length > FUNCTION_LINES and not has_reason(node, lines):
                    yield f" {name}: lines"
                if parameters(node) > PARAMETERS:
                    yield f" {name}: parameters"
            yield from inside(node, f"{name}.")

    yield from inside(ast.parse(text), "")


def test_nothing_outgrows_its_room() -> None:
    found = {
        f"{path.relative_to(ROOT)}{excess}"
        for folder in (*PACKAGES, "studies", "bench", "tests")
        for path in (ROOT / folder).rglob("*.py")
        for excess in excesses(path.read_text(encoding="utf-8"))
    }
    assert sorted(found) == [], "take it apart, or say why above it"


def test_docstrings_have_a_subject() -> None:
    """What begins with "Of" has its subject in the name above it, or nowhere."""
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for folder in (*PACKAGES, "studies", "bench", "tests")
        for path in (ROOT / folder).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.lstrip().startswith('"""Of ')
    ]
    assert found == []


def a_function(lines: int, arguments: str = "", above: str = "") -> str:
    return f"{above}def f({arguments}):\n" + "    pass\n" * (lines - 1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("#\n" * 499, []),
        ("#\n" * 500, [": lines"]),
        (a_function(60), []),
        (a_function(61), [" f: lines"]),
        (a_function(61, above=f"@decorated\n{REASON}a table.\n"), [" f: lines"]),
        (a_function(61, above=f"{REASON}a table\n# of messages.\n@decorated\n"), []),
        (a_function(2, "a, b, /, c, d, e, f, g"), []),
        (a_function(2, "a, b, /, c, d, e, f, g, h"), [" f: parameters"]),
        ("class A:\n    def f(self, a, b, c, d, e, f, g): pass\n", []),
        ("class A:\n    def f(self, a, b, c, d, e, f, g, h): pass\n", [" A.f: parameters"]),
        ("class A:\n" + "    #\n" * 298 + "    a = 1\n", []),
        ("class A:\n" + "    #\n" * 299 + "    a = 1\n", [" A: lines"]),
        ("class A:\n" + "".join(f"    a{k}: int\n" for k in range(25)), []),
        ("class A:\n" + "".join(f"    a{k}: int\n" for k in range(26)), [" A: fields"]),
        (
            "class A:\n    a: int\n    def f(me):\n        me.a = me.b = 1\n"
            + "".join(f"        me.a{k}: int = 1\n" for k in range(24)),
            [" A: fields"],
        ),
    ],
)
def test_what_is_too_large_is_found(text: str, expected: list[str]) -> None:
    assert list(excesses(text)) == expected
