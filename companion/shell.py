"""What all commands share: exit codes, words to the person, and errors from outside as one line."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

P = ParamSpec("P")
T = TypeVar("T")

FAILED = 1
"""Exit code: it ended otherwise than it should."""
UNUSABLE = 2
"""Exit code: nothing was done, because a file, a setting or an address can't be used."""
ABANDONED = 130
"""Exit code: interrupted."""


def usable(function: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
    """Call it; what can't be used ends the program with one line and exit code 2."""
    try:
        return function(*arguments, **options)
    except Exception as error:
        if not isinstance(error, _from_outside()):
            raise
        say(f"companion: {error}")
        raise typer.Exit(UNUSABLE) from None


def _from_outside() -> tuple[type[Exception], ...]:
    """Imported when there is something to say: a listing of logs need not load the autopilot."""
    from companion.flight import PlanError
    from companion.rehearsal import RehearsalError
    from protocol.datafile import DataFileError
    from protocol.flightlog import FlightLogError
    from protocol.transport import TransportError

    return DataFileError, FlightLogError, PlanError, RehearsalError, TransportError


def say(text: str) -> None:
    """A line on standard error."""
    typer.echo(text, err=True)
