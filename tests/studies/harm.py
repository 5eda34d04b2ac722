"""What a flight can do to its worker. Workers import nothing else for it."""

import os
import signal
import threading
from pathlib import Path


def harmful(number: int) -> int:
    """Kills its worker, throws, hangs, or is the number's square."""
    match number:
        case 2:
            os.kill(os.getpid(), signal.SIGKILL)
        case 4:
            raise ValueError("four")
        case 6:
            signal.pause()
    return number * number


def late(marker: Path) -> int:
    """The first attempt ends, and so does its worker a moment later."""
    if not marker.exists():
        marker.touch()
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return os.getpid()


def once(marker: Path) -> int:
    """The first attempt kills its worker."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()
