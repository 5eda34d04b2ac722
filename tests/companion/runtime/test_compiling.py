"""The first start is known by an empty cache."""

from pathlib import Path

import pytest

from companion.runtime import compiling


def test_the_first_start_is_the_one_with_a_cache_that_is_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first_start = compiling.first_start.__wrapped__
    monkeypatch.setattr(compiling, "CACHE_FOLDER", tmp_path)
    assert first_start()
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "function.nbi").touch()
    assert not first_start()
    monkeypatch.setattr(compiling, "CACHE_FOLDER", None)  # nothing would be kept for the other processes
    assert not first_start()
