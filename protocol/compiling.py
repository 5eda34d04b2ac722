"""Says that the numerical code is compiled, which the first start on a machine does."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from numba.core.event import Event, Listener, install_listener

TAKES = "compiling the numerical code, once on a machine: a minute of computing"


class _Compilations(Listener):  # type: ignore[misc]
    """Counts on standard error: in place on a terminal, otherwise it says once what goes on."""

    def __init__(self) -> None:
        self.count = 0
        self.terminal = os.isatty(2)

    def on_start(self, event: Event) -> None:
        self.count += 1
        if self.terminal:
            self.say(f"\r\x1b[K{TAKES}, {self.count} functions")
        elif self.count == 1:
            self.say(f"{TAKES}\n")

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
