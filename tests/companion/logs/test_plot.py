"""The picture of a replay's difference, from numbers and beside logs of any kind."""

import os
from array import array
from pathlib import Path
from typing import Any

import pytest
import typer

from companion.cli import logs
from companion.logs.difference import Difference, Series
from companion.logs.plot import plot
from companion.logs.replay import Replay

INF, NAN = float("inf"), float("nan")


def sent(recorded: list[float], replayed: list[float]) -> Series:
    return Series(array("q", range(len(recorded))), array("d", recorded), array("d", replayed))


@pytest.mark.parametrize("name", [b"a$_$b", rb"$\foo$", b"\xff\xfe", "höhe".encode(), b"a\nb", b"[bold]"])
def test_a_log_of_any_name_has_its_picture(tmp_path: Path, name: bytes) -> None:
    folder = tmp_path / os.fsdecode(name)
    folder.mkdir()
    picture = folder / "replay.png"
    series = {("SET_ATTITUDE_TARGET", "thrust"): sent([0.5, 0.6], [0.5, 0.7])}
    assert plot(series, f"{folder / 'flight.mcap'} --set limits.highest_thrust=0.9", picture) == 1
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.filterwarnings("error")
def test_numbers_that_are_none_differ_in_nothing(tmp_path: Path) -> None:
    series = {
        ("COMMAND_LONG", "param1"): sent([NAN, NAN], [NAN, NAN]),
        ("COMMAND_LONG", "param2"): sent([INF, INF], [INF, INF]),
        ("COMMAND_LONG", "param3"): sent([NAN, NAN], [1.0, NAN]),
        ("COMMAND_LONG", "param4"): sent([1.0], [2.0]),
    }
    assert plot(series, "flight.mcap", tmp_path / "none.png") == 0
    assert not (tmp_path / "none.png").exists()
    series["COMMAND_LONG", "param5"] = sent([INF, 1.0, 2.0], [INF, 1.5, 2.0])
    assert plot(series, "flight.mcap", tmp_path / "one.png") == 1


def test_it_is_said_what_makes_no_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A command that is sent once, and now otherwise."""

    def flown(differences: list[Difference]) -> Any:
        return lambda *_, **__: Replay(differences, [], 1, 1, 1, 1.0, 1.0, {}, None)

    log = tmp_path / "flight.mcap"
    log.write_bytes(b"")
    for differences, words in (
        ([Difference("COMMAND_LONG", "param1", 0, 1, 2.0)], "what differs makes no curve"),
        ([], "nothing differs in what is sent"),
    ):
        monkeypatch.setattr("companion.logs.replay.replay", flown(differences))
        try:
            logs.replay(log, plot=tmp_path / "replay.png")
        except typer.Exit:
            assert differences
        assert f"plot: {words}" in capsys.readouterr().err
