"""A start that compiles says so."""

import numba
import pytest

from protocol.compiling import TAKES, compiling_shown


def test_compilations_are_told_once_and_only_if_there_are_any(capfd: pytest.CaptureFixture[str]) -> None:
    doubled, halved = numba.njit(lambda value: 2.0 * value), numba.njit(lambda value: 0.5 * value)
    raised = numba.njit(lambda value: value + 1.0)
    with compiling_shown():
        assert doubled(1.0) == 2.0 and halved(1.0) == 0.5 and raised(1.0) == 2.0
    assert capfd.readouterr().err.splitlines() == [TAKES]
    with compiling_shown():
        assert doubled(2.0) == 4.0
    assert capfd.readouterr().err == ""
