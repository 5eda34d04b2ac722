"""The first start on a machine, which compiles the numerical code: on two cores, and with its progress shown."""

import functools
import multiprocessing
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from numba.core.event import Event, Listener, install_listener

from companion.config_avoidance import Avoidance
from companion.runtime.planning import rehearse
from protocol.jit import CACHE_FOLDER

_TAKES = "compiling the numerical code, once on a machine: a minute of computing"


class _Compilations(Listener):  # type: ignore[misc]
    """Counts on standard error: in place on a terminal, otherwise it says once what goes on."""

    def __init__(self) -> None:
        self.count = 0
        self.terminal = os.isatty(2)

    def on_start(self, event: Event) -> None:
        self.count += 1
        if self.terminal:
            self.say(f"\r\x1b[K{_TAKES}, {self.count} functions")
        elif self.count == 1:
            self.say(f"{_TAKES}\n")

    def say(self, text: str) -> None:
        """Write it, if anybody reads."""
        with suppress(OSError):
            os.write(2, text.encode())

    def on_end(self, event: Event) -> None:
        """Nothing: the next one begins."""


@contextmanager
def compiling_shown() -> Iterator[None]:
    """A block whose compilations are told on standard error."""
    compilations = _Compilations()
    with install_listener("numba:compile", compilations):
        try:
            yield
        finally:
            if compilations.terminal and compilations.count:
                compilations.say("\n")


@functools.cache
def first_start() -> bool:
    """Whether nothing is compiled yet, though it would be kept."""
    return CACHE_FOLDER is not None and next(CACHE_FOLDER.rglob("*.nbi"), None) is None


@contextmanager
def planner_compiled_beside(settings: Avoidance) -> Iterator[None]:
    """A block during which a process of its own compiles the map and the planner into the cache; it ends with both.

    What that process leaves uncompiled, also if it fails, is compiled where it is called first.
    """
    process = multiprocessing.get_context("spawn").Process(target=_compile_planner, args=(settings,), daemon=True)
    process.start()
    try:
        yield
        process.join()
    finally:
        process.kill()


def _compile_planner(settings: Avoidance) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with its parent
    rehearse(settings)
