"""Messages that the dialect lacks have the names that pymavlink's other dialects give them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cli import logs as commands
from companion.logs.convert import convert
from companion.logs.message_names import _names, decoded, with_name
from companion.view.accumulators.last_values import LastValues
from companion.view.gather import GatheredFlight
from companion.view.report import compose
from protocol.messages import dialect
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


def test_tables_have_it_as_their_name(tmp_path: Path) -> None:
    convert(PX4, tmp_path / "tables", "csv")
    names = {path.name for path in (tmp_path / "tables").iterdir()}
    assert "1_1_CURRENT_MODE.csv" in names and "1_1_UNKNOWN_436.csv" not in names and "1_1_UNKNOWN_410.csv" in names


def test_the_report_decodes_the_last_of_each(tmp_path: Path) -> None:
    """As pymavlink does from the file itself, with the dialect that has them all."""
    everything = pytest.importorskip("pymavlink.dialects.v20.all")
    reader = everything.MAVLink(None)
    reader.robust_parsing = True
    last: dict[str, dict[str, Any]] = {}
    for message in reader.parse_buffer(PX4.read_bytes()):
        last[f"/mavlink/{message.get_srcSystem()}/{message.get_srcComponent()}/{message.get_type()}"] = vars(message)
    shown = {row.topic: row.last for row in compose(GatheredFlight(from_tlog(PX4, tmp_path))).topics}
    for topic, names in (
        ("/mavlink/1/1/CURRENT_MODE", ("standard_mode", "custom_mode", "intended_custom_mode")),
        ("/mavlink/1/1/HEARTBEAT", ("custom_mode", "type", "autopilot", "base_mode", "system_status")),
    ):
        assert shown[topic].startswith(", ".join(f"{name} {last[topic][name]}" for name in names)), topic
    assert shown["/mavlink/1/1/UNKNOWN_410"].startswith("payload ["), "no dialect has it"


@pytest.mark.parametrize("record", [{}, {"payload": 2**62}, {"payload": "text"}, {"payload": bytes(256)}])
def test_what_is_no_payload_is_not_decoded(record: dict[str, Any]) -> None:
    """A log may be anybody's."""
    assert decoded("/mavlink/1/1/UNKNOWN_436", record) is None


@pytest.mark.parametrize("number", sorted(_names().keys() - dialect.mavlink_map.keys()))
@pytest.mark.parametrize("payload", [b"", b"\xff" * 255])
def test_any_payload_of_any_message_is_decoded(number: int, payload: bytes) -> None:
    assert decoded(f"/mavlink/1/1/UNKNOWN_{number}", {"payload": payload}) is not None


def test_values_are_short() -> None:
    values = LastValues()
    values.add("/a", np.array([(1.25e-9, [1] * 9)], [("x", "f8"), ("y", "u1", 9)]))
    values.add("/b", [{"text": "old"}, {"text": "new", "payload": b"\1\2"}])
    assert values.text("/a") == "x 1.25e-09, y [1, 1, 1, 1, 1, 1 and 3 more]"
    assert values.text("/b") == "text new, payload [1, 2]" and values.text("/c") == ""
