"""Companions that follow a script, made of unmodified pymavlink: in one thread on a manual clock, or over UDP."""

import collections
import contextlib
import math
import socket
import threading
from collections.abc import Callable, Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import AIRFRAME, OFFBOARD
from vehicle_sim.timing import TICK_NS

UNSET = math.nan

Script = Callable[[int], list[object] | None]
"""A lockstep tick -> the messages that go with the answer to it; None: no answer."""


def command(number: int, *params: float) -> object:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *(0.0,) * (7 - len(params)))


def hop(tick: int) -> list[object]:
    """Take off, and land once that is high enough to be a flight."""
    if tick == 300:
        return [command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7), command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)]
    return [command(mavlink.MAV_CMD_NAV_LAND)] if tick == 500 else []


def offboard_until(last: int) -> Script:
    """Take off, hover in OFFBOARD, and be silent after tick `last`."""

    def script(tick: int) -> list[object] | None:
        if tick > last:
            return None
        out = hop(tick) if tick < 500 else []
        if tick > 400:
            thrust = AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n
            out.append(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0, 0, 0], 0, 0, 0, thrust))
        if tick == 1000:
            out.append(command(mavlink.MAV_CMD_DO_SET_MODE, 1, OFFBOARD >> 16))
        return out

    return script


class ScriptedCompanion:
    """Answers the lockstep ticks as its script says, but not the first `deaf_to` datagrams."""

    def __init__(self, script: Script, *, deaf_to: int = 0) -> None:
        self._script = script
        self._deaf_to = deaf_to
        self._reader, self._writer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 191)
        self.heard: list[bytes] = []
        self.texts: list[str] = []

    def answer(self, datagram: bytes) -> bytes:
        """What it sends when this datagram arrives; empty for nothing."""
        self.heard.append(datagram)
        out = b""
        if len(self.heard) <= self._deaf_to:
            return out
        for message in self._reader.parse_buffer(datagram) or []:
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            if message.get_type() != "TIMESYNC" or message.tc1 != 0:
                continue
            answers = self._script(message.ts1 // TICK_NS)
            if answers is not None:
                answers.append(mavlink.MAVLink_timesync_message(message.ts1 + 1, message.ts1))
                out += b"".join(answer.pack(self._writer) for answer in answers)  # type: ignore[attr-defined]
        return out


class ManualLink:
    """A transport to a companion in the same thread. Its clock moves only when the vehicle waits in vain."""

    preserves_datagrams = True
    peer = "test"

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self._answer = answer
        self._incoming: collections.deque[bytes] = collections.deque()
        self.now_ns = 0
        self.sent_at_ns: list[int] = []
        """Time of each datagram of the vehicle."""

    def monotonic_ns(self) -> int:
        return self.now_ns

    def receive(self, timeout_s: float) -> bytes | None:
        if self._incoming:
            return self._incoming.popleft()
        self.now_ns += math.ceil(timeout_s * 1e9)
        return None

    def send(self, data: bytes) -> None:
        self.sent_at_ns.append(self.now_ns)
        answer = self._answer(data)
        if answer:
            self._incoming.append(answer)

    def lock(self) -> None:
        """There is one peer."""

    def close(self) -> None:
        """There is nothing to close."""


class UdpCompanion(threading.Thread):
    """A scripted companion behind a socket of its own, in a thread."""

    def __init__(self, script: Script) -> None:
        super().__init__(daemon=True)
        self._companion = ScriptedCompanion(script)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(60.0)
        self.port: int = self._socket.getsockname()[1]

    @property
    def heard(self) -> list[bytes]:
        return self._companion.heard

    @property
    def texts(self) -> list[str]:
        return self._companion.texts

    def run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                datagram, address = self._socket.recvfrom(65535)
                answer = self._companion.answer(datagram)
                if answer:
                    self._socket.sendto(answer, address)

    def close(self) -> None:
        self._socket.close()


@contextlib.contextmanager
def started(companion: UdpCompanion) -> Iterator[UdpCompanion]:
    companion.start()
    try:
        yield companion
    finally:
        companion.close()
