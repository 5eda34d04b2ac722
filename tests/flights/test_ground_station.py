"""A ground station beside the companion, by `--gcs`: pymavlink's own, on a real socket."""

import os
import select
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

from companion.logs.replay import replay
from protocol.flightlog import Direction, LogReader, datagrams
from protocol.messages import dialect
from tests.flights.processes import HOP, PATIENCE_S, PATIENT, Process, simulator_for, waiting_companion

AUTO, LOITER, OFFBOARD = 4, 3, 6


class GroundStation:
    """pymavlink's connection, and how to wait for what is said.

    A thread takes what comes out of the socket, which has room for some 0.3 s of messages: on a busy machine
    pymavlink decodes them later than that, and a text comes once.
    """

    def __init__(self) -> None:
        self.link: Any = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255, source_component=190)
        self.port: int = self.link.port.getsockname()[1]
        self._waiting: deque[bytes] = deque()
        self._receive = self.link.recv
        self.link.recv = lambda n=None: self._waiting.popleft() if self._waiting else b""
        self._ended = False
        self._taker = threading.Thread(target=self._take)
        self._taker.start()
        self._texts: list[Any] = []
        """Those that nobody has waited for yet: they come when they come."""

    def _take(self) -> None:
        while not self._ended:
            select.select([self.link.port], [], [], 0.1)
            while data := self._receive():
                self._waiting.append(data)

    def close(self) -> None:
        self._ended = True
        self._taker.join()
        self.link.close()

    def wait(self, kind: str, holds: Any = lambda message: True) -> Any:
        """The next message of a kind that comes from the vehicle or its companion."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            message = self.link.recv_match(blocking=True, timeout=1.0)
            if message is not None and message.get_type() == kind and holds(message):
                return message
            if message is not None and message.get_type() == "STATUSTEXT":
                self._texts.append(message)
        raise AssertionError(f"no {kind}")

    def hear(self, text: str) -> None:
        """Wait for a text of the companion, which may have come meanwhile."""

        def says(message: Any) -> bool:
            return text in message.text and message.get_srcComponent() == 191

        if not any(map(says, self._texts)):
            self.wait("STATUSTEXT", says)

    def set_mode(self, main: int, sub: int = 0) -> None:
        """PX4's DO_SET_MODE, until the heartbeat has it."""
        while True:
            self.link.mav.command_long_send(1, 1, dialect.MAV_CMD_DO_SET_MODE, 0, 1, main, sub, 0, 0, 0, 0)
            beat = self.wait("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
            if beat.custom_mode >> 16 & 0xFF == main:
                return


@contextmanager
def ground_station() -> Iterator[GroundStation]:
    station = GroundStation()
    try:
        yield station
    finally:
        station.close()


def second_companion(port: int, logs: Path) -> Process:
    """On the vehicle behind a companion that hands its traffic on."""
    options = ("--connect", f"udpout:127.0.0.1:{port}", "--log", str(logs / "second"), "--no-report", *PATIENT)
    return Process("companion", ("fly", HOP, *options, "--set", "avoidance.method=none"))


def test_a_ground_station_watches_asks_and_takes_over(tmp_path: Path) -> None:
    with (
        ground_station() as station,
        waiting_companion(
            tmp_path,
            "realtime",
            HOP,
            *("--set", "avoidance.method=none", "--set", "supervision.resume_within=300.0"),
            *("--gcs", f"udpout:127.0.0.1:{station.port}", "--gcs", "udpin:127.0.0.1:0"),
        ) as (companion, port),
        simulator_for(port, "realtime") as simulator,
    ):
        hub = int(companion.wait_for("ground station at udpin:").rpartition(":")[2])
        assert station.wait("HEARTBEAT", lambda each: each.get_srcComponent() == 191).get_srcSystem() == 1
        station.wait("HEARTBEAT", lambda each: each.get_srcComponent() == 1)
        version = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        station.link.mav.command_long_send(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, version, 0, 0, 0, 0, 0, 0)
        ack = station.wait("COMMAND_ACK", lambda each: each.command == dialect.MAV_CMD_REQUEST_MESSAGE)
        assert (ack.target_system, ack.target_component) == (255, 190)
        station.hear("taking off")
        station.wait("LOCAL_POSITION_NED", lambda each: each.z < -0.5)
        station.set_mode(AUTO, LOITER)
        station.hear("by others")
        with second_companion(hub, tmp_path) as second:
            second.wait_for("the vehicle is armed already: not taken over")
            assert second.end() == 1
        station.set_mode(OFFBOARD)
        companion.wait_for("control is given back")
        assert companion.end() == 0 and simulator.end() == 0
    log = LogReader(companion.report()["log"])
    assert "/mavlink/255/190/COMMAND_LONG" in log.topics, "who commanded"
    forwarded = [address for _, direction, address, _ in datagrams(log.path) if direction is Direction.FORWARDED]
    assert set(forwarded) == {f"127.0.0.1:{station.port}"}
    result = replay(log.path)
    assert result.differences == [] and result.datagrams > 1000
