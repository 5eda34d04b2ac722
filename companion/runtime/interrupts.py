"""Processes beside the one that flies: an interrupt at the keyboard, and their end."""

import os
import signal
import threading
from multiprocessing import parent_process, resource_tracker
from multiprocessing.process import BaseProcess


def start_uninterrupted(process: BaseProcess) -> None:
    """Start a process that no interrupt reaches: it goes to all processes of the terminal, and one that is still
    importing would answer it with a traceback."""
    resource_tracker.ensure_running()  # the first process would start it, which lets interrupts in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """End this process as soon as the one that started it has, however that came: what it is about may take a minute
    to compile, or hang."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
