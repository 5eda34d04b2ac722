"""The two programs as processes that are forked from one that has imported them and loaded their compiled code.

A start costs a second of CPU less than that of `python -m`. Arguments, outputs, signals and exit code are those of the
real one, which `make` and some tests start.
"""

import importlib
import multiprocessing
import os
import sys
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parents[2]
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["tests.flights.preloaded"])


def start(module: str, arguments: tuple[str, ...], *, apart: bool = False) -> tuple[ForkServerProcess, list[TextIO]]:
    """`python -m module arguments`: the process, and what it writes; its errors `apart`, or in the same stream."""
    pipes = [CONTEXT.Pipe(duplex=False) for _ in range(1 + apart)]
    process = CONTEXT.Process(target=_be, args=(module, arguments, [pipes[0][1], pipes[-1][1]]))
    process.start()
    for _, theirs in pipes:
        theirs.close()
    return process, [os.fdopen(os.dup(ours.fileno()), encoding="utf-8") for ours, _ in pipes]


def _be(module: str, arguments: tuple[str, ...], outputs: list[Connection]) -> None:
    """In the new process."""
    os.chdir(ROOT)
    for number, connection in enumerate(outputs, start=1):
        os.dup2(connection.fileno(), number)
    for connection in outputs:
        connection.close()
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False)
    sys.argv = [module, *arguments]
    importlib.import_module(f"{module}.cli").main()
