"""What the programs that show a flight say of how it came out."""

import json
from pathlib import Path

import pytest

from companion.cli import logs as commands
from companion.outcomes import Verdict
from companion.view.finding import Level
from companion.view.gather import GatheredFlight
from companion.view.history import History
from companion.view.live_words import words
from companion.view.report import compose
from companion.view.sources import FinishedLog
from protocol.flightlog import LogReader


def assert_all_say(log: Path, verdict: Verdict, printed: pytest.CaptureFixture[str]) -> None:
    """`info`, `logs`, the report and the live page; the verdict itself is the reader's."""
    outcome, text = verdict.outcome, verdict.text
    printed.readouterr()
    commands.info(log, as_json=True)
    assert json.loads(printed.readouterr().out)["outcome"] == text
    commands.info(log)
    assert text in printed.readouterr().out
    commands.logs(log.parents[1], as_json=True)
    (row,) = json.loads(printed.readouterr().out)
    assert row["result"] == outcome.value and row["faults"] == ([verdict.cause] if verdict.cause else [])
    page = compose(GatheredFlight(log))
    (finding,) = (each for each in page.findings if each.about == "outcome")
    assert finding.text.lower() == f"{text}.".lower() and page.tiles[0] == ("outcome", outcome.value)
    assert (finding.level is Level.GOOD) == outcome.succeeded
    source = FinishedLog(LogReader(log))
    shown = words(History().at(0.0), "made", "", None, source.verdict)
    assert '<td id="outcome"' in shown and text.replace("'", "&#x27;") in shown
