"""What a flight can do to its worker. Workers import nothing else for it."""

import os
import signal
import threading
import time
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


def pair(marker: Path) -> int:
    """The first attempts at two of the jobs kill their workers, shortly before the first job ends."""
    time.sleep(1.0 if marker.name == "0" else 0.0)
    if marker.name in ("1", "2") and not marker.exists():
        marker.touch()
        time.sleep(0.9)
        os.kill(os.getpid(), signal.SIGKILL)
    return int(marker.name)


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
