"""What all commands share: exit codes, words to the person, and errors from outside as one line."""

import errno
import os
import stat
import sys
from collections.abc import Callable
from io import TextIOWrapper
from pathlib import Path
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


def exit_on_user_error(function: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
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
    from companion.runtime.flight import PlanError
    from companion.runtime.rehearsal import RehearsalError
    from protocol.flightlog import FlightLogError
    from protocol.toml_files import TomlFileError
    from protocol.transport import TransportError

    return TomlFileError, FlightLogError, PlanError, RehearsalError, TransportError


def run(app: typer.Typer) -> None:
    """The whole program: names that are not UTF-8 are printed all the same, and an output that is full is one line."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        if error.errno != errno.ENOSPC or error.filename is not None:
            raise
        say(f"companion: standard output: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left in the buffer has nowhere to go
        sys.exit(UNUSABLE)


def log_file(log: Path) -> Path:
    """The log that is meant: a folder of a flight stands for its file. Without one the program ends with one line."""
    from protocol.flightlog import FILE_NAME

    path = log
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            path = log / FILE_NAME
            mode = path.stat().st_mode
    except OSError as error:
        inside = path is not log and isinstance(error, FileNotFoundError)
        say(f"companion: {log}: " + (f"a folder without {FILE_NAME}" if inside else error.strerror or str(error)))
        raise typer.Exit(UNUSABLE) from None
    if not stat.S_ISREG(mode):
        say(f"companion: {path}: not a file")
        raise typer.Exit(UNUSABLE)
    return path


def exit_if_damaged(problem: str | None) -> None:
    """Say what is wrong with a log, if anything is, and end with exit code 1; after all that could be done with it."""
    if problem is not None:
        say(f"companion: {problem}")
        raise typer.Exit(FAILED)


def say(text: str) -> None:
    """A line on standard error."""
    typer.echo(text, err=True)
