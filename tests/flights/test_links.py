"""A whole flight over a serial line, with a scanner on a link of its own, and one over TCP beside a flood."""

import os
import select
import socket
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from companion.logs.replay import replay
from companion.runtime.router import STATION_BYTES_PER_S
from protocol.flightlog import Direction, LogReader, datagrams
from protocol.framing import Framer
from protocol.messages import Encoder, dialect
from tests.flights.processes import HOP, PATIENT, Process, simulator_for

RING = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
RUBBISH = 600
"""Bytes that a flood has beside each heartbeat. They are not sent on, and count."""


class Line:
    """A serial line: what the simulator sends to `port` comes out of `device`, without its rings; these go to the
    scanner's link as soon as that is known."""

    def __init__(self) -> None:
        self._near, far = os.openpty()
        tty.setraw(far)
        self.device = os.ttyname(far)
        self._far = far
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", 0))
        self.port: int = self._udp.getsockname()[1]
        self._scanner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.scanner_port: int | None = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        simulator: tuple[str, int] | None = None
        os.set_blocking(self._near, False)
        while not self._ends.is_set():
            for end in select.select([self._near, self._udp.fileno()], [], [], 0.1)[0]:
                with suppress(ConnectionError, BlockingIOError):
                    if end == self._near:
                        data = os.read(self._near, 4096)
                        if simulator is not None:
                            self._udp.sendto(data, simulator)
                        continue
                    data, simulator = self._udp.recvfrom(65535)
                    frames = Framer().datagram(data)
                    os.write(self._near, b"".join(each.raw for each in frames if each.message_id != RING))
                    for each in frames:
                        if each.message_id == RING and self.scanner_port is not None:
                            self._scanner.sendto(each.raw, ("127.0.0.1", self.scanner_port))

    def __enter__(self) -> "Line":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        for end in (self._udp, self._scanner):
            end.close()
        os.close(self._near)
        os.close(self._far)


@contextmanager
def companion(logs: Path, url: str, *more: str) -> Iterator[Process]:
    options = ("--connect", url, "--log", str(logs), "--json", "--no-report", *PATIENT)
    with Process("companion", ("fly", HOP, *options, *more)) as it:
        yield it


def test_over_a_serial_line_with_a_scanner_of_its_own(tmp_path: Path) -> None:
    """The rates fit the line, the scans come by the scanner's link, and the log replays to the byte."""
    lidar = ("--lidar", "udpin:127.0.0.1:0", "--set", "avoidance.method=paper")
    with Line() as line, companion(tmp_path, f"serial:{line.device}:115200", *lidar) as flying:
        line.scanner_port = int(flying.wait_for("sensor at udpin:").rpartition(":")[2])
        with simulator_for(line.port, "realtime") as simulator:
            flying.wait_for("11520 bytes a second")
            assert "OBSTACLE_DISTANCE" in flying.wait_for("telemetry: ")
            assert flying.end() == 0 and simulator.end() == 0
    log = LogReader(flying.report()["log"])
    ways = [direction for _, direction, _, _ in datagrams(log.path)]
    assert ways.count(Direction.SENSOR) > 50
    assert "/mavlink/1/1/OBSTACLE_DISTANCE" in log.topics
    result = replay(log.path)
    assert result.differences == [] and result.datagrams > 100


def test_over_tcp_beside_a_ground_station_that_floods(tmp_path: Path) -> None:
    """Everything that it throws at the companion, while that flies: what reaches the vehicle is a trickle of it."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood:
        url, more = f"tcp:127.0.0.1:{server.getsockname()[1]}", ("--set", "avoidance.method=none")
        with companion(tmp_path, url, *more, "--gcs", "udpin:127.0.0.1:0") as flying:
            flood.connect(("127.0.0.1", int(flying.wait_for("ground station at udpin:").rpartition(":")[2])))
            flood.setblocking(False)
            end, _ = server.accept()
            with end, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
                udp.bind(("127.0.0.1", 0))
                with simulator_for(udp.getsockname()[1], "realtime") as simulator:
                    _relay(end, udp, simulator, flood)
                    assert simulator.end() == 0 and flying.end() == 0
    report = flying.report()
    assert report["outcome"] == "flown"
    logged = list(datagrams(report["log"]))
    forwarded = b"".join(data for _, way, _, data in logged if way is Direction.FORWARDED)
    frames, passed_s = Framer().datagram(forwarded), (logged[-1][0] - logged[0][0]) * 1e-9
    assert {frame.system for frame in frames} == {255}
    assert len(forwarded) + len(frames) * RUBBISH < STATION_BYTES_PER_S * (passed_s + 1.0)
    assert replay(Path(report["log"])).differences == []


def _relay(end: socket.socket, udp: socket.socket, simulator: Process, flood: socket.socket) -> None:
    """Between a stream and a simulator, until that ends; whenever something comes, the flood gets more."""
    address: tuple[str, int] | None = None
    encoder, rubbish = Encoder(255, 190), np.random.default_rng(1).bytes(RUBBISH)
    while not simulator.ended_within(0.0):
        for ready in select.select([end, udp], [], [], 0.1)[0]:
            with suppress(ConnectionError):
                if ready is udp:
                    data, address = udp.recvfrom(65535)
                    end.sendall(data)
                    continue
                data = end.recv(1200)
                if address is not None and data:
                    udp.sendto(data, address)
        beat = encoder.encode_fields(dialect.MAVLink_heartbeat_message, 6, 8, 0, 0, 4, 3)
        with suppress(BlockingIOError, ConnectionRefusedError):
            for data in (beat, rubbish) * 5:
                flood.send(data)


@pytest.mark.parametrize(
    ("url", "named"),
    [("px5", "px5"), ("serial:/dev/nothing:57600", "/dev/nothing"), ("tcp:127.0.0.1:1", "tcp:127.0.0.1:1")],
)
def test_a_wrong_url_is_named(tmp_path: Path, url: str, named: str) -> None:
    with companion(tmp_path, url, "--set", "avoidance.method=none") as flying:
        assert flying.end() != 0
    assert any(named in line for line in flying.lines)
