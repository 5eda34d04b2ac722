"""Processes beside the one that flies, and an interrupt at the keyboard."""

import signal
from multiprocessing import resource_tracker
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
