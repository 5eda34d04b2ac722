"""Companion and simulator as real processes on loopback, for tests that kill and disturb them."""

import json
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def free_port() -> int:
    """A UDP port that nobody has just now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def run(*arguments: str, timeout: float = 200.0, **options: Any) -> "subprocess.CompletedProcess[str]":
    """`python -m ...` to its end."""
    return subprocess.run(
        [sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=timeout, **options
    )


@dataclass
class Process:
    """A started process whose lines are read as they come."""

    module: str
    arguments: tuple[str, ...]
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", self.module, *self.arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._queue: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._queue.put(line.rstrip())
        self._queue.put(None)

    def wait_for(self, text: str, timeout: float = 120.0) -> str:
        """The first line (from here on) that holds the text."""
        return self._until(lambda line: text in line, f"{text!r}", timeout)

    def _until(self, holds: Callable[[str], bool], what: str, timeout: float) -> str:
        while True:
            try:
                line = self._queue.get(timeout=timeout)
            except queue.Empty:
                raise AssertionError(f"{self.module} did not say {what}: {self.lines[-5:]}") from None
            if line is None:
                raise AssertionError(f"{self.module} ended without saying {what}: {self.lines[-10:]}")
            self.lines.append(line)
            if holds(line):
                return line

    def end(self, timeout: float = 120.0) -> int:
        """Wait for the end; its exit code."""
        code = self.process.wait(timeout)
        while (line := self._queue.get(timeout=10.0)) is not None:
            self.lines.append(line)
        return code

    def kill(self) -> None:
        """kill -9"""
        os.kill(self.process.pid, signal.SIGKILL)

    def report(self) -> dict[str, Any]:
        """The JSON object that it printed last."""
        value: dict[str, Any] = json.loads([line for line in self.lines if line.startswith("{")][-1])
        return value

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


def pair(logs: Path, pace: str, mission: str = "courier", *more: str) -> tuple[Process, Process]:
    """A simulator and a companion that have found each other's address."""
    port = free_port()
    companion = Process(
        "companion",
        ("fly", mission, "--connect", f"udpin:127.0.0.1:{port}", "--pace", pace, "--log", str(logs), "--json", *more),
    )
    simulator = Process(
        "vehicle_sim", ("--once", "--bind", f"udpout:127.0.0.1:{port}", "--pace", pace, "--world", "neighbourhood")
    )
    return simulator, companion
