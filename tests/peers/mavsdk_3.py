"""Programs for MAVSDK-Python 3, which is installed beside the environment: that one has version 4."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from protocol.toml_files import ROOT

PACKAGES = ROOT / ".venv" / "mavsdk-3"


@contextmanager
def running(program: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """In its folder; in the end it is killed with the server that it has started."""
    if not PACKAGES.is_dir():
        pytest.skip(f"{PACKAGES} is not there")
    command = [sys.executable, "-u", "-W", "ignore", str(program), *arguments]  # the package's code warns of itself
    with subprocess.Popen(
        command,
        cwd=program.parent,
        env={**os.environ, "PYTHONPATH": str(PACKAGES)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
