"""The simulator's truth beside the log: there whole or not at all, and no end of a flight."""

from pathlib import Path

import pytest

from companion.runtime.demo import _keep


def test_it_is_moved_whole(tmp_path: Path) -> None:
    (tmp_path / "made.npy").write_bytes(b"all of it")
    _keep(tmp_path / "made.npy", tmp_path / "truth.npy")
    assert [file.name for file in tmp_path.iterdir()] == ["truth.npy"]
    assert (tmp_path / "truth.npy").read_bytes() == b"all of it"


@pytest.mark.parametrize("folder", [".", "removed"])
def test_what_can_not_be_kept_is_said(folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made, place = tmp_path / "made.npy", tmp_path / folder / "truth.npy"
    if folder == "removed":
        made.write_bytes(b"all of it")
    _keep(made, place)
    said = capsys.readouterr().err
    assert said.startswith(f"companion: {place}: ") and said.count("\n") == 1
    assert not list(tmp_path.glob("**/truth*"))
