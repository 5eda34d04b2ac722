"""Texts and progress on standard error."""

import contextlib
import os
import select
import time
from typing import Final

from protocol.flightlog.status import Status

_STATUS_INTERVAL_S: Final = 5.0
"""Between two lines of progress where standard error is no terminal."""
_COLORS: Final = {"WARNING": "33", "ERROR": "31", "FATAL": "1;31"}
"""Colors of a level's lines on a terminal."""


class Console:
    """Lines of text, and the progress below them. It never waits for a reader, and has no thread."""

    def __init__(self, *, panels: bool = True) -> None:
        """`panels`: progress is drawn as a panel on a terminal, which takes milliseconds; otherwise as one line."""
        self._terminal = os.isatty(2)
        self._panels = panels and self._terminal and os.environ.get("TERM") != "dumb"
        self._poller = select.poll()
        self._poller.register(2, select.POLLOUT)
        self._status = ""
        self._back = ""
        """What takes the cursor back to where the progress on the terminal begins, and clears all from there on."""
        self._next_s = 0.0

    def text(self, line: str, level: str = "") -> None:
        """Write a line."""
        if not self._terminal:
            self._write(line + "\n")
            return
        if level in _COLORS and self._panels:
            line = f"\x1b[{_COLORS[level]}m{line}\x1b[m"
        if self._write(self._back + line + "\n"):
            self._back = ""
        self._draw()

    def status(self, status: Status) -> None:
        """Show the progress in place of the last one; where there is no terminal, as a line in 5 s."""
        if self._terminal:
            self._status = self._drawn(status)
            self._draw()
        elif time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + _STATUS_INTERVAL_S
            self._write(status.line + "\n")

    def close(self) -> None:
        """Take the panel away, or end the line of progress."""
        if self._status:
            self._write(self._back if self._panels else "\n")

    def _drawn(self, status: Status) -> str:
        if not self._panels:
            return status.line
        from protocol.flightlog.panel import drawn

        try:
            columns = os.get_terminal_size(2).columns
        except OSError:
            columns = 0
        return drawn(status, columns or 80)

    def _draw(self) -> None:
        if self._status and self._write(self._back + self._status):
            up = self._status.count("\n")
            self._back = f"\r\x1b[{up}A\x1b[J" if up else "\r\x1b[K"

    def _write(self, text: str) -> bool:
        """Whether it was written."""
        with contextlib.suppress(OSError):
            if self._poller.poll(0):
                os.write(2, text.encode(errors="replace")[: select.PIPE_BUF])
                return True
        return False
