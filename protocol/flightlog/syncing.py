"""Takes a log to the disk while it is written. The system alone would do so after half a minute: a battery that is torn
off in a crash would take the last of a flight with it, or all of a short one.
"""

import errno
import threading
from collections.abc import Callable
from typing import Final

EVERY_S: Final = 1.0
_NOT_KNOWN: Final = frozenset({errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP})
"""Errors of a file system that has no such call."""


class Syncing:
    """Calls `sync` each second in a thread of its own, as a disk may take its time."""

    def __init__(self, sync: Callable[[], None], every_s: float = EVERY_S) -> None:
        self.error: OSError | None = None
        """Why the last call failed."""
        self._sync = sync
        self._every_s = every_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sync", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(self._every_s):
            try:
                self._sync()
            except OSError as error:
                if error.errno in _NOT_KNOWN:
                    return
                self.error = error
            else:
                self.error = None

    def stop(self) -> None:
        """No call is under way any more, nor will be."""
        self._stop.set()
        self._thread.join()
