"""A companion and a vehicle as processes of their own in real time, with the injector between them on UDP."""

import json
import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from protocol import toml_files
from studies.faults.injector import Injector

_LARGEST = 65535
_LOOK_S = 0.1
"""So often it is looked whether both still run."""


class Console:
    """What a process prints, by whole lines, as it comes."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", *arguments], cwd=toml_files.ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        assert self.process.stdout is not None
        self.pipe = self.process.stdout.fileno()
        self.lines: list[tuple[int, str]] = []
        """When (monotonic, ns), and what."""
        self._rest = b""

    def read(self) -> bool:
        """What has come, at once or as soon as there is something; False at the end."""
        data = os.read(self.pipe, _LARGEST)
        *lines, self._rest = (self._rest + data).split(b"\n")
        now_ns = time.monotonic_ns()
        self.lines += ((now_ns, line.decode(errors="replace")) for line in lines)
        return bool(data)

    def wait_for(self, words: str) -> str:
        """The first line with these words. Raises RuntimeError if there is none to its end."""
        while True:
            for _, line in self.lines:
                if words in line:
                    return line
            if not self.read():
                raise RuntimeError(f"the companion never said {words!r}: {self.lines[-5:]}")

    def end(self) -> dict[str, Any] | None:
        """The JSON object that a process printed last, once it has ended."""
        while self.read():
            pass
        self.process.wait()
        objects = [line for _, line in self.lines if line.startswith("{")]
        value: dict[str, Any] | None = json.loads(objects[-1]) if objects else None
        return value


Watch = Callable[[Console, Console], None]
"""Gets the companion and the vehicle."""


class Proxy:
    """Two sockets on loopback: the vehicle sends to `port`."""

    def __init__(self, between: Injector, companion_port: int) -> None:
        self._between = between
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.connect(("127.0.0.1", companion_port))
        self._far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far.bind(("127.0.0.1", 0))
        self.port: int = self._far.getsockname()[1]
        self._vehicle: tuple[str, int] | None = None

    def carry(self, companion: Console, vehicle: Console, limit_s: float, watch: Watch) -> None:
        """Hand on what comes, until both have ended or time is over."""
        end_ns = time.monotonic_ns() + round(limit_s * 1e9)
        pipes = [companion.pipe]
        while time.monotonic_ns() < end_ns:
            if self.step(pipes) and not companion.read():
                pipes = []
            watch(companion, vehicle)
            if not pipes and vehicle.process.poll() is not None:
                return

    def step(self, pipes: Sequence[int] = ()) -> bool:
        """Hand on what has come, or comes soon; whether one of the pipes has something."""
        next_ns = self._between.next_ns
        wait_s = _LOOK_S if next_ns is None else (next_ns - time.monotonic_ns()) * 1e-9
        ends: list[Any] = [self._near, self._far, *pipes]
        ready = select.select(ends, [], [], min(max(wait_s, 0.0), _LOOK_S))[0]
        for end in (self._near, self._far):
            if end in ready:
                self._take(end)
        now_ns = time.monotonic_ns()
        for data in self._between.at_companion(now_ns):
            with suppress(ConnectionError):
                self._near.send(data)
        for data in self._between.at_vehicle(now_ns):
            if self._vehicle is not None:
                with suppress(ConnectionError):
                    self._far.sendto(data, self._vehicle)
        return any(each in ready for each in pipes)

    def _take(self, end: socket.socket) -> None:
        with suppress(ConnectionError):  # whoever was sent to has gone
            data, address = end.recvfrom(_LARGEST)
            if end is self._far:
                self._vehicle = address
                self._between.to_companion(data, time.monotonic_ns())
            else:
                self._between.to_vehicle(data, time.monotonic_ns())

    def close(self) -> None:
        self._near.close()
        self._far.close()


def sentence(line: str) -> str:
    """What is said in a line of the companion's console; "" for its status."""
    return line.partition(" companion: ")[2]


def fly(
    between: Injector, mission: str, world: str, seed: int, folder: Path, watch: Watch = lambda companion, vehicle: None
) -> tuple[Console, Console]:
    """A flight in real time, both processes to their end; meanwhile `watch` is called again and again. The vehicle's
    truth is at truth.npy in `folder`."""
    companion = Console(
        "companion", "fly", mission, "--connect", "udpin:127.0.0.1:0", "--output", "rates", "--no-report",
        "--log", str(folder), "--json",
    )  # fmt: skip
    proxy = vehicle = None
    try:
        port = int(companion.wait_for("waiting at udpin:").rpartition(":")[2])
        proxy = Proxy(between, port)
        vehicle = Console(
            "vehicle_sim", "--once", "--bind", f"udpout:127.0.0.1:{proxy.port}", "--world", world, "--seed", str(seed),
            "--sensors", "perfect", "--truth", str(folder / "truth.npy"), "--param", "NAV_DLL_ACT=3",
        )  # fmt: skip
        proxy.carry(companion, vehicle, 300.0, watch)
        return companion, vehicle
    finally:
        for each in (companion, vehicle):
            if each is not None and each.process.poll() is None:
                each.process.terminate()
        if proxy is not None:
            proxy.close()
