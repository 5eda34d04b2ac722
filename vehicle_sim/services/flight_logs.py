"""The vehicle's own log of each flight, from arming to disarming, with topics of PX4's names.

It is ULog, since that is what PX4 writes, and so what the tools for its logs (Flight Review, PlotJuggler, pyulog) read.
"""

import struct
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from protocol import ulog
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode, Severity
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.parameter_store import Parameters
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.timing import TICK_NS

MOST_LOGS = 5
"""The oldest goes first."""
MOST_BYTES = 1 << 22
"""Size of one log at most, about 20 min; then the next one begins. So all of them are little beside what the process
holds."""

_RECORD_NS = 12 * TICK_NS
"""Between two records: 21 a second, about as often as PX4 logs an attitude."""
_MODE_SEVERITY = 6

_PLACE, _PLACE_FIELDS = struct.Struct("<6f"), "float x;float y;float z;float vx;float vy;float vz;"
_ATTITUDE, _ATTITUDE_FIELDS = struct.Struct("<4f"), "float[4] q;"
_RATES, _RATES_FIELDS = struct.Struct("<3f"), "float[3] xyz;"
_TOPICS = (
    ("vehicle_local_position", _PLACE_FIELDS),
    ("vehicle_attitude", _ATTITUDE_FIELDS),
    ("vehicle_angular_velocity", _RATES_FIELDS),
    ("vehicle_local_position_groundtruth", _PLACE_FIELDS),
    ("vehicle_attitude_groundtruth", _ATTITUDE_FIELDS),
)
"""Name and fields; the number of a topic is its place here."""


class FlightLog(NamedTuple):
    """One file."""

    begun_s: int
    """Since boot: the vehicle has no time of day."""
    content: bytearray


class FlightLogs:
    """In memory. `whole` are those that have ended; `files` are the same by path, for MAVLink FTP."""

    def __init__(self, parameters: Parameters, flight: FlightControl, identity: Identity) -> None:
        self._parameters = parameters
        self._flight = flight
        self._identity = identity
        self.whole: deque[FlightLog] = deque(maxlen=MOST_LOGS)
        self.files: dict[str, Callable[[], bytes]] = {}
        self._open: FlightLog | None = None
        self._mode: Mode | None = None

    def update(self, now: Snapshot) -> None:
        """Once a tick, before the autopilot's texts are sent."""
        flight = self._flight
        if self._open is None:
            if not flight.armed:
                return
            self._open, self._mode = FlightLog(now.now_ns // 1_000_000_000, self._beginning(now.now_us)), None
        content = self._open.content
        for severity, words in flight.texts:
            content += ulog.text(severity, now.now_us, words)
        if flight.mode is not self._mode:
            self._mode = flight.mode
            content += ulog.text(_MODE_SEVERITY, now.now_us, f"Mode {flight.mode.label}")
        if now.now_ns % _RECORD_NS == 0:
            self._record(content, now)
        if not flight.armed or len(content) > MOST_BYTES:
            self.whole.append(self._open)
            self._open = None
            self._name_files()

    def erase(self) -> None:
        """All that have ended."""
        self.whole.clear()
        self._name_files()
        self._flight.announce(Severity.INFO, "Logs erased")

    def _name_files(self) -> None:
        self.files.clear()
        for number, log in enumerate(self.whole):
            self.files[f"log/{number}.ulg"] = lambda log=log: bytes(log.content)  # type: ignore[misc]

    def _beginning(self, time_us: int) -> bytearray:
        identity, parameters = self._identity, self._parameters
        facts = {
            "sys_name": "PX4",
            "ver_hw": "vehicle-sim",
            "ver_sw_release_str": ".".join(map(str, identity.firmware)),
            "sys_id": str(identity.system),
        }
        content = bytearray(ulog.header(time_us))
        for key, value in facts.items():
            content += ulog.information(key, value)
        for name in parameters.names:
            content += ulog.parameter(name, parameters[name])
        for topic, fields in _TOPICS:
            content += ulog.definition(topic, fields)
        for number, (topic, _) in enumerate(_TOPICS):
            content += ulog.subscription(number, topic)
        return content

    def _record(self, content: bytearray, now: Snapshot) -> None:
        """What the autopilot flies on, and the truth."""
        own, truth = self._flight.motion, now.truth
        values = (
            _PLACE.pack(*own.position_ned, *own.velocity_ned),
            _ATTITUDE.pack(*own.attitude_ned_frd),
            _RATES.pack(*own.rates_frd),
            _PLACE.pack(*truth.position_ned, *truth.velocity_ned),
            _ATTITUDE.pack(*truth.attitude_ned_frd),
        )
        for number, fields in enumerate(values):
            content += ulog.record(number, now.now_us, fields)
