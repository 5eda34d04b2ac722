"""What all commands share: exit codes, lines on standard error, and errors of the user as one line."""

import errno
import os
import select
import signal
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from types import FrameType
from typing import NoReturn, ParamSpec, TypeVar

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
    """Call a function. A file, a setting or an address that can't be used ends the program with one line."""
    try:
        return function(*arguments, **options)
    except Exception as error:
        if not _is_the_user_s(error):
            raise
        exit_as_unusable(str(error))


def _is_the_user_s(error: Exception) -> bool:
    """Whether an error says that a file, a setting or an address can't be used. The modules that raise it are imported
    only now, the autopilot's last, because a listing of logs should not load it."""
    from companion.plugins import PluginError
    from protocol.flightlog import FlightLogError
    from protocol.key_files import KeyFileError
    from protocol.toml_files import TomlFileError
    from protocol.transport import TransportError

    if isinstance(error, TomlFileError | FlightLogError | KeyFileError | TransportError | PluginError):
        return True
    from companion.runtime.flight import PlanError
    from companion.runtime.rehearsal import RehearsalError

    return isinstance(error, PlanError | RehearsalError)


@contextmanager
def exit_on_interrupt(text: str | None = None, then: Callable[[], None] = lambda: None) -> Iterator[None]:
    """A block in which an interrupt ends the program with exit code 130, after this line, if any, and `then`; at its
    end, if that is when it is noticed: Python drops what is raised in a destructor."""
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        signal.default_int_handler(number, frame)

    before = signal.getsignal(signal.SIGINT)
    heeds = callable(before)  # a job in the background of a script ignores it
    if heeds:
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield
        if interrupted:
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        if text is not None:
            say(text)
        then()
        raise typer.Exit(ABANDONED) from None
    finally:
        if heeds:
            signal.signal(signal.SIGINT, before)


def exit_as_unusable(text: str) -> NoReturn:
    """Say what can't be used, and end the program with exit code 2. Call it while nothing was done yet."""
    note(text)
    raise typer.Exit(UNUSABLE) from None


def exit_as_failed(outcome: str) -> NoReturn:
    """Say how it ended, and end the program with exit code 1."""
    from companion.outcomes import Outcome, Verdict

    say(Verdict(Outcome.FAILED, outcome).text)
    raise typer.Exit(FAILED)


def exit_as_undone(outcome: str) -> NoReturn:
    """Say how it ended, as somebody wished, and end the program with exit code 1: what was to be done is not done."""
    say(outcome)
    raise typer.Exit(FAILED)


def run(app: typer.Typer) -> None:
    """Run the whole program. Names that are not UTF-8 are printed escaped, and a full disk is one line."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        _tell_nobody(error)
        sys.exit(UNUSABLE)


@contextmanager
def told_if_there_is_room() -> Iterator[None]:
    """A block that prints how a flight went. What comes after it is done on a full disk, too."""
    try:
        yield
    except OSError as error:
        _tell_nobody(error)


def _tell_nobody(error: OSError) -> None:
    """Say that standard output is full, if that is what went wrong, and write to nowhere from now on."""
    if error.errno != errno.ENOSPC or error.filename is not None:
        raise error
    note(f"standard output: {error.strerror}")
    _to_nowhere(1)


def _to_nowhere(number: int) -> None:
    """What is written to standard output (1) or error (2), and what waits for that, goes nowhere from now on."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, number)
    os.close(null)


def leave_gone_readers() -> None:
    """Write to nowhere what a terminal that has hung up, or a pipe that nobody reads any more, would be told: what
    follows a flight, as its report, is done all the same."""
    for number in (1, 2):
        poll = select.poll()
        poll.register(number, 0)
        if poll.poll(0):
            _to_nowhere(number)


def log_or_newest(log: Path | None) -> Path:
    """The log that was named, or the newest in logs/, which is said; without one the program ends with one line."""
    if log is not None:
        return log
    from companion.logs.recordings import newest

    found = exit_on_user_error(newest, Path("logs"))
    note(f"the newest log: {found}")
    return found


def log_file(log: Path) -> Path:
    """The file of a log; the folder of a flight stands for its file. Without one the program ends with one line."""
    from protocol.flightlog import FILE_NAME

    path = log
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            path = log / FILE_NAME
            mode = path.stat().st_mode
    except OSError as error:
        inside = path is not log and isinstance(error, FileNotFoundError)
        exit_as_unusable(f"{log}: " + (f"a folder without {FILE_NAME}" if inside else error.strerror or str(error)))
    if not stat.S_ISREG(mode):
        exit_as_unusable(f"{path}: not a file")
    return path


def exit_if_damaged(problem: str | None) -> None:
    """Say what is wrong with a log, if anything is, and end with exit code 1. Call it last: what is whole was done."""
    if problem is not None:
        note(problem)
        raise typer.Exit(FAILED)


def note(text: str) -> None:
    """A line on standard error, in the program's name."""
    say(f"companion: {text}")


def say(text: str) -> None:
    """A line on standard error, if there is room for it."""
    try:
        typer.echo(text, err=True)
    except OSError:
        _to_nowhere(2)
