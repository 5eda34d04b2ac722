"""Texts and progress on standard error."""

import contextlib
import os
import select
import time
from typing import Final

_STATUS_INTERVAL_S: Final = 5.0
"""Between two lines of progress where standard error is no terminal."""


class Console:
    """Lines of text, and one line of progress below them. It never waits for a reader."""

    def __init__(self) -> None:
        self._terminal = os.isatty(2)
        self._poller = select.poll()
        self._poller.register(2, select.POLLOUT)
        self._status = ""
        self._next_s = 0.0

    def text(self, line: str) -> None:
        """Write a line."""
        if self._terminal:
            line = "\r\x1b[K" + line
        self._write(line + "\n" + (self._status if self._terminal else ""))

    def status(self, line: str) -> None:
        """Write a line of progress in place of the last one; where there is no terminal, as a line in 5 s."""
        if self._terminal:
            self._status = line
            self._write("\r\x1b[K" + line)
        elif time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + _STATUS_INTERVAL_S
            self._write(line + "\n")

    def close(self) -> None:
        """End the line of progress."""
        if self._status:
            self._write("\n")

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError):
            if self._poller.poll(0):
                os.write(2, text.encode(errors="replace")[: select.PIPE_BUF])
