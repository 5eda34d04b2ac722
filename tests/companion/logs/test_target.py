"""Where commands write: whole or not at all, and never over a recording."""

import errno
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.shell import UNUSABLE
from companion.logs.recordings import as_date, is_recording, printable, started_unix_s
from companion.logs.target import output, writable
from protocol.flightlog import FlightLogError
from tests.companion.view.made_logs import make

DATA = Path(__file__).resolve().parents[2] / "data"


def test_a_file_and_a_folder_come_whole(tmp_path: Path) -> None:
    with output(tmp_path / "a.txt") as draft:
        draft.write_text("whole")
        assert not (tmp_path / "a.txt").exists() and draft.name == "a.txt"
    with output(tmp_path / "deep" / "b", parents=True) as draft:
        draft.mkdir()
        (draft / "c.csv").write_text("1")
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert (tmp_path / "deep" / "b" / "c.csv").read_text() == "1"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "deep"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("no"), OSError(errno.ENOSPC, "No space left")])
def test_nothing_is_left_of_what_did_not_end(tmp_path: Path, error: BaseException) -> None:
    (tmp_path / "old.html").write_text("old")
    for name in ("new.html", "old.html"):
        with (
            pytest.raises(FlightLogError if isinstance(error, OSError) else type(error)) as raised,
            output(tmp_path / name, replaces=True) as draft,
        ):
            draft.write_text("half")
            raise error
    if isinstance(error, OSError):
        assert str(raised.value) == f"{tmp_path / 'old.html'}: can't be written: No space left"
    assert [path.name for path in tmp_path.iterdir()] == ["old.html"]
    assert (tmp_path / "old.html").read_text() == "old"


def test_a_place_that_can_not_be_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for place in (tmp_path / "none" / "a", tmp_path / "file" / "a", tmp_path / ("x" * 300), tmp_path):
        with pytest.raises(FlightLogError) as raised:
            writable(place, replaces=True)
        assert str(raised.value).startswith(f"{place}: ")


def test_an_error_that_names_the_draft_names_the_target(tmp_path: Path) -> None:
    with pytest.raises(FlightLogError) as raised, output(tmp_path / "a.mcap") as draft:
        raise FlightLogError(f"{draft}: No space left on device")
    assert str(raised.value) == f"{tmp_path / 'a.mcap'}: No space left on device"


def test_what_is_there_is_refused_or_makes_room(tmp_path: Path) -> None:
    old = tmp_path / "old.html"
    old.write_text("old")
    with pytest.raises(FlightLogError, match=r"old\.html: exists already"), output(old):
        pass
    with output(old, replaces=True) as draft:
        draft.write_text("new")
    assert old.read_text() == "new"
    for refused in ({"source": old, "replaces": True}, {"replaces": False}):
        with pytest.raises(FlightLogError), output(old, **refused):
            pass
    link = tmp_path / "link.html"
    link.symlink_to(old)
    with output(link, replaces=True) as draft:
        draft.write_text("through the link")
    assert link.is_symlink() and old.read_text() == "through the link"
    with output(Path("/dev/null"), replaces=True) as draft:
        draft.write_text("nowhere")
    assert Path("/dev/null").is_char_device()


def test_no_recording_makes_room(tmp_path: Path) -> None:
    whole = make(tmp_path / "flight", 0.5).read_bytes()
    contents = {
        "whole.mcap": whole,
        "cut.mcap": whole[:-100],
        "headless.mcap": whole[8:],
        "disguised.html": whole,
        "a.tlog": (DATA / "px4_offboard.tlog").read_bytes()[:5000],
    }
    for name, content in contents.items():
        path = tmp_path / name
        path.write_bytes(content)
        assert is_recording(path), name
        with pytest.raises(FlightLogError, match="never written over"), output(path, replaces=True):
            pass
        assert path.read_bytes() == content
    for content in (b"", b"<!doctype html>"):
        (tmp_path / "page").write_bytes(content)
        assert not is_recording(tmp_path / "page")


@pytest.mark.parametrize("command", ["report", "foxglove"])
@pytest.mark.parametrize("kind", ["mcap", "tlog"])
def test_commands_leave_recordings_alone(tmp_path: Path, command: str, kind: str) -> None:
    log = tmp_path / f"one.{kind}"
    other = make(tmp_path / "other", 0.5)
    shutil.copy(other if kind == "mcap" else DATA / "px4_offboard.tlog", log)
    before = log.read_bytes(), other.read_bytes()
    for target in (log, other):
        done = CliRunner().invoke(app, [command, str(log), "--to", str(target)])
        assert done.exit_code == UNUSABLE and done.output == f"companion: {target}: a log is never written over\n"
    assert (log.read_bytes(), other.read_bytes()) == before
    if kind == "mcap":
        drawn = tmp_path / "one_foxglove.mcap"
        for _ in range(2):
            assert CliRunner().invoke(app, ["foxglove", str(log)]).exit_code == 0, "its own output makes room"
        again = CliRunner().invoke(app, ["foxglove", str(drawn), "--to", str(drawn)])
        assert again.exit_code == UNUSABLE and "never written over" in again.output


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e300", "-1e11", "soon", ""])
def test_what_is_no_time_is_none(text: str) -> None:
    assert started_unix_s({"flight": {"started_unix_s": text}}) is None
    assert started_unix_s({}) is None
    assert started_unix_s({"flight": {"started_unix_s": "1.5e9"}}) == as_date(1.5e9) == 1.5e9


def test_names_of_any_bytes_are_printable(tmp_path: Path) -> None:
    name = b"h\xf6ver".decode(errors="surrogateescape")
    assert printable(tmp_path / name).encode().endswith(b"ver")
    assert printable("höver") == "höver"
