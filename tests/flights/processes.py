"""Companion and simulator as real processes on loopback, for tests that kill and disturb them."""

import json
import os
import queue
import select
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.flights.warm import start

ROOT = Path(__file__).resolve().parents[2]
HOP = str(ROOT / "tests" / "golden" / "short.toml")
"""A mission for flights in real time that are about something else."""
PATIENCE_S = 300.0
"""Far more than anything takes, on a machine that is busy with other things, too; only a failing test waits for it."""


PATIENT = tuple(
    part
    for setting in (
        "supervision.find_timeout=600.0",
        "supervision.ready_timeout=600.0",
        "supervision.command_tries=100",
        "supervision.telemetry_timeout=5.0",
        "supervision.longest_delay=5.0",
        "supervision.scan_timeout=5.0",
        "supervision.overrun=5.0",
        "supervision.heartbeat_timeout=6.0",
        "supervision.silence_timeout=8.0",
        "supervision.resume_within=1.0",
        "rates.least_share=0.01",
    )
    for part in ("--set", setting)
)
"""Options with which a flight in real time is flown to its end on a machine that stands still at times, too, and fails
at once where the vehicle's own failsafe has ended it."""


def run(module: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """`python -m module arguments` to its end."""
    process, streams = start(module, arguments, apart=True)
    with ThreadPoolExecutor(1) as pool, streams[0] as out, streams[1] as errors:
        wrong = pool.submit(errors.read)
        printed = out.read()
        process.join()
    return subprocess.CompletedProcess((module, *arguments), process.exitcode or 0, printed, wrong.result())


@dataclass
class Process:
    """A started process whose lines are read as they come."""

    module: str
    arguments: tuple[str, ...]
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.process, (self._output,) = start(self.module, self.arguments)
        self._queue: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with self._output as output:
            for line in output:
                self._queue.put(line.rstrip())
        self._queue.put(None)

    def wait_for(self, text: str, timeout: float = PATIENCE_S) -> str:
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

    def end(self) -> int:
        """Wait for the end; its exit code."""
        assert self.ended_within(PATIENCE_S), f"{self.module} does not end: {self.lines[-5:]}"
        while (line := self._queue.get(timeout=PATIENCE_S)) is not None:
            self.lines.append(line)
        assert self.process.exitcode is not None
        return self.process.exitcode

    def ended_within(self, seconds: float) -> bool:
        """Wait for the end, at the longest so many seconds."""
        self.process.join(seconds)
        return self.process.exitcode is not None

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        assert self.process.pid is not None
        os.kill(self.process.pid, number)

    def kill(self) -> None:
        """kill -9"""
        self.process.kill()

    def report(self) -> dict[str, Any]:
        """The JSON object that it printed last."""
        value: dict[str, Any] = json.loads([line for line in self.lines if line.startswith("{")][-1])
        return value

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.join()


@contextmanager
def waiting_companion(logs: Path, pace: str, mission: str = "courier", *more: str) -> Iterator[tuple[Process, int]]:
    """A companion that is ready for a vehicle, and the UDP port at which it waits."""
    options = ("--connect", "udpin:127.0.0.1:0", "--pace", pace, "--log", str(logs), "--json", "--no-report")
    with Process("companion", ("fly", mission, *options, *PATIENT, *more)) as companion:
        yield companion, int(companion.wait_for("waiting at udpin:").rpartition(":")[2])


def simulator_for(port: int, pace: str, world: str = "neighbourhood") -> Process:
    """A simulator that flies once, with the companion that waits at a port."""
    options = ("--once", "--bind", f"udpout:127.0.0.1:{port}", "--pace", pace, "--world", world)
    return Process("vehicle_sim", (*options, "--param", "NAV_DLL_ACT=3"))


@contextmanager
def pair(logs: Path, pace: str, mission: str = "courier", *more: str) -> Iterator[tuple[Process, Process]]:
    """A simulator and the companion that it flies with."""
    with (
        waiting_companion(logs, pace, mission, *more) as (companion, port),
        simulator_for(port, pace) as simulator,
    ):
        yield simulator, companion


class Relay:
    """Stands between a companion that waits at `companion_port` and a simulator that sends to `port`.

    Hands on every datagram, in a thread, and keeps what the companion sent.
    """

    def __init__(self, companion_port: int) -> None:
        self._to_companion = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to_companion.connect(("127.0.0.1", companion_port))
        self._to_simulator = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to_simulator.bind(("127.0.0.1", 0))
        self.port: int = self._to_simulator.getsockname()[1]
        self.sent: list[bytes] = []
        """By the companion."""
        self._grown = threading.Condition()
        self._ends = False
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Relay":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
            waker.sendto(b"", ("127.0.0.1", self.port))
        self._thread.join()
        self._to_companion.close()
        self._to_simulator.close()

    def _run(self) -> None:
        simulator: tuple[str, int] | None = None
        while not self._ends:
            for end in select.select([self._to_companion, self._to_simulator], [], [])[0]:
                with suppress(ConnectionError):  # whoever was sent to has gone
                    data, address = end.recvfrom(65535)
                    if end is self._to_simulator:
                        simulator = simulator or address
                        self._to_companion.send(data)
                        continue
                    with self._grown:
                        self.sent.append(data)
                        self._grown.notify_all()
                    if simulator is not None:
                        self._to_simulator.sendto(data, simulator)

    def wait_for(self, count: int) -> None:
        """Until the companion has sent so many datagrams more."""
        with self._grown:
            goal = len(self.sent) + count
            while len(self.sent) < goal:
                assert self._grown.wait(PATIENCE_S), f"{goal - len(self.sent)} of {count} datagrams are missing"
