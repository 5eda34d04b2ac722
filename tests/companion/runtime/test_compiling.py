"""The first start tells that it compiles, and is known by an empty cache."""

from pathlib import Path

import numba
import pytest

from companion.runtime import compiling
from companion.runtime.compiling import compiling_shown


def test_compilations_are_told_once_and_only_if_there_are_any(capfd: pytest.CaptureFixture[str]) -> None:
    doubled, halved = numba.njit(lambda value: 2.0 * value), numba.njit(lambda value: 0.5 * value)
    with compiling_shown():
        assert doubled(1.0) == 2.0 and halved(1.0) == 0.5
    assert capfd.readouterr().err.splitlines() == [
        "compiling the numerical code, once on a machine: a minute of computing"
    ]
    with compiling_shown():
        assert doubled(2.0) == 4.0
    assert capfd.readouterr().err == ""


def test_the_first_start_is_the_one_with_a_cache_that_is_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first_start = compiling.first_start.__wrapped__
    monkeypatch.setattr(compiling, "CACHE_FOLDER", tmp_path)
    assert first_start()
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "function.nbi").touch()
    assert not first_start()
    monkeypatch.setattr(compiling, "CACHE_FOLDER", None)  # nothing would be kept for the other processes
    assert not first_start()
