"""Rules of the house that no linter knows."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
IMPURE = ("runtime", "logs", "view", "cli")
PURE = [
    path
    for path in (ROOT / "companion").rglob("*.py")
    if path.name != "__main__.py" and path.relative_to(ROOT / "companion").parts[0] not in IMPURE
]


@pytest.mark.parametrize("path", PURE, ids=lambda path: path.name)
def test_no_stage_reads_the_truth_a_clock_a_socket_or_chance(path: Path) -> None:
    """The ground truth crosses the wire as HIL_STATE_QUATERNION alone, and no stage may know its name."""
    text = path.read_text(encoding="utf-8").lower()
    for forbidden in ("hil_state", r"import time\b", "import socket", "import random", "np.random", r"\bprint\("):
        assert not re.search(forbidden, text), forbidden


def test_only_the_transport_opens_sockets() -> None:
    for package in ("protocol", "companion", "vehicle_sim"):
        for path in (ROOT / package).rglob("*.py"):
            if path.name != "transport.py":
                assert "import socket" not in path.read_text(encoding="utf-8"), path


def test_the_simulator_reads_no_wall_clock_but_in_its_runner() -> None:
    for path in (ROOT / "vehicle_sim").rglob("*.py"):
        if path.name != "runner.py":
            assert "import time" not in path.read_text(encoding="utf-8"), path
