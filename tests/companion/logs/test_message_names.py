"""Messages that the dialect lacks have the names that pymavlink's other dialects give them."""

from pathlib import Path

import pytest

from companion.cli import logs as commands
from companion.logs.message_names import _names, with_name
from companion.view.gather import GatheredFlight
from companion.view.report import compose
from tests.companion.view.made_logs import from_tlog

PX4 = Path(__file__).resolve().parents[2] / "data" / "px4_offboard.tlog"


def test_the_names_are_those_of_the_module() -> None:
    everything = pytest.importorskip("pymavlink.dialects.v20.all")
    assert _names() == {number: each.msgname for number, each in everything.mavlink_map.items()}


@pytest.mark.parametrize(
    ("topic", "named"),
    [
        ("/mavlink/1/1/UNKNOWN_436", "/mavlink/1/1/CURRENT_MODE"),
        ("/mavlink/1/1/UNKNOWN_410", "/mavlink/1/1/UNKNOWN_410"),
        ("/mavlink/1/1/HEARTBEAT", "/mavlink/1/1/HEARTBEAT"),
        ("/log", "/log"),
    ],
)
def test_a_topic_has_a_name_where_there_is_one(topic: str, named: str) -> None:
    assert with_name(topic) == named


def test_info_and_report_say_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    commands.info(PX4)
    page = compose(GatheredFlight(from_tlog(PX4, tmp_path)))
    for shown in (capsys.readouterr().out, " ".join(row.topic for row in page.topics)):
        assert "/mavlink/1/1/CURRENT_MODE" in shown and "UNKNOWN_436" not in shown and "UNKNOWN_410" in shown
