"""Standard input, output and error of a program that was started without them, as service managers may do."""

import os
import sys


def open_closed() -> None:
    """Open those that are closed, to nowhere. Otherwise the first files that the program opens take their numbers, and
    get what is printed. `sys.stdin` stays None: there is nothing to read."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free
            if number:
                setattr(sys, name, os.fdopen(number, "w", closefd=False))
