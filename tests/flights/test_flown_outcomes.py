"""Ways to end a flight, each flown by two processes: console, info, logs, report and page say the same of it."""

from pathlib import Path

import pytest

from companion.logs.info import info
from companion.outcomes import Outcome
from tests.companion.said_alike import assert_all_say
from tests.flights.processes import HOP, run

LOW = (
    "vehicle.battery.capacity_wh=5",
    "vehicle.battery.charge=0.8",
    "battery.warn_charge=0.79",
    "battery.return_charge=0.77",
)


@pytest.mark.parametrize(
    ("outcome", "cause", "mission", "changes"),
    [
        (Outcome.FLOWN, "", HOP, ()),
        (Outcome.NOT_STARTED, "too low for", HOP, ("vehicle.battery.charge=0.1", "supervision.ready_timeout=3")),
        (Outcome.NO_TAKE_OFF, "too heavy?", HOP, ("vehicle.body.mass_kg=2.9",)),
        (Outcome.RETURNED, "battery at", "hover", LOW),
        (
            Outcome.LANDED_EARLY,
            "battery at",
            HOP,
            (*LOW, "battery.land_charge=0.77"),
        ),
        (Outcome.CRASHED, "hit street lamp", "courier", ('avoidance.method="none"',)),
    ],
)
def test_everybody_says_what_happened(
    outcome: Outcome,
    cause: str,
    mission: str,
    changes: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "250")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    options = ["--sensors", "perfect", *(part for change in changes for part in ("--set", change))]
    done = run("companion", "demo", mission, "--no-report", "--log", str(tmp_path / "logs"), *options)
    (log,) = (tmp_path / "logs").rglob("flight.mcap")
    verdict = info(log).verdict
    assert verdict is not None and verdict.outcome is outcome and cause in verdict.cause
    assert verdict.sentence in done.stdout
    assert done.returncode == (0 if outcome.succeeded else 1)
    assert_all_say(log, verdict, capsys)
