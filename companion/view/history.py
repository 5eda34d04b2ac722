"""What a live page knows of a flight: as much of its past as is worth drawing, and any moment of it."""

from dataclasses import dataclass, field

import numpy as np

from companion.trace import TRACE
from companion.vehicles import firmware_of
from companion.view.findings import phase_name, state_name
from companion.view.gather import Batch, Table, Text, euler_deg
from companion.view.lines import Floats, Track
from protocol.flightlog import TEXT

MOST = 10_000
"""Rows of each track; twice as many may be held."""
MOST_TEXTS = 200
STALE_S = 1.5
_INVALID_AUTOPILOT = 8
_ARMED = 128


@dataclass(frozen=True, slots=True)
class Plan:
    """What the companion wanted at a control step."""

    reference_ned: Floats
    target_ned: Floats
    clearance: float
    speed_limit: float
    blocked: bool
    limited: bool
    phase: str
    state: str


@dataclass(frozen=True, slots=True)
class Moment:
    """The flight at a time; None for what was not known or too old by then."""

    time: float
    position_ned: Floats | None
    velocity_ned: Floats | None
    attitude_ned_frd: Floats | None
    returns_frd: Floats
    """(n, 3) what the ring showed, in body axes (m)."""
    nearest: float | None
    """m, of the ring's returns from its centre."""
    plan: Plan | None
    mode: str
    armed: bool
    failsafe: bool
    link_age: float | None
    """s since the vehicle was heard."""
    battery: float | None
    """% left"""
    texts: tuple[Text, ...]
    """The last few that were said by then."""


@dataclass(slots=True)
class _Vehicle:
    """One sender's tracks."""

    places: Track = field(default_factory=lambda: Track(7, MOST))
    attitudes: Track = field(default_factory=lambda: Track(5, MOST))
    rings: Track = field(default_factory=lambda: Track(73, MOST // 4))
    beats: Track = field(default_factory=lambda: Track(4, MOST))
    """custom_mode, armed, critical."""
    battery: Track = field(default_factory=lambda: Track(2, MOST))
    heard: Track = field(default_factory=lambda: Track(2, MOST))
    bearings: Floats = field(default_factory=lambda: np.radians(5.0 * np.arange(72)))
    is_vehicle: bool = False


class History:
    """Filled from batches, asked for moments."""

    def __init__(self) -> None:
        self.start = 0.0
        self.end = 0.0
        self.texts: list[Text] = []
        self._begun = False
        self._vehicles: dict[str, _Vehicle] = {}
        self._plans = Track(14, MOST)
        self._modes: dict[int, str] = {}
        self._has_quaternion = False
        self._has_log = False

    def take(self, batch: Batch) -> None:
        """Add a batch; times count from the log's or the page's own zero."""
        topic, _, times_ns, table = batch
        times = times_ns * 1e-9
        if not self._begun:
            self._begun, self.start = True, float(times[0])
        self.start, self.end = min(self.start, float(times[0])), max(self.end, float(times[-1]))
        parts = topic.split("/")
        if topic == TRACE.topic:
            self._trace(times, table)
        elif topic == TEXT.topic:
            rows = zip(times.tolist(), table, strict=True)
            if not self._has_log:
                self._has_log, self.texts = True, []  # the companion's words repeat the vehicle's
            self._say([Text(at, row["level"], row["name"], row["message"]) for at, row in rows])
        elif len(parts) == 5 and parts[1] == "mavlink":
            self._message(f"{parts[2]}/{parts[3]}", parts[4], times, table)

    def _say(self, texts: list[Text]) -> None:
        self.texts = sorted(self.texts + texts, key=lambda text: text.time)[-MOST_TEXTS:]

    def _trace(self, times: Floats, table: Table) -> None:
        singles = [table[name] for name in ("clearance", "speed_limit", "blocked", "limited", "phase", "state")]
        rows = np.column_stack((table["reference_position_ned"], table["target_ned"], *singles))
        self._plans.add(times, np.column_stack((rows, table["reference_yaw"])))

    def _message(self, sender: str, name: str, times: Floats, table: Table) -> None:
        vehicle = self._vehicles.setdefault(sender, _Vehicle())
        if name == "LOCAL_POSITION_NED":
            vehicle.places.add(times, _columns(table, "x", "y", "z", "vx", "vy", "vz"))
        elif name == "ATTITUDE_QUATERNION":
            self._has_quaternion = True
            vehicle.attitudes.add(times, _columns(table, "q1", "q2", "q3", "q4"))
        elif name == "ATTITUDE" and not self._has_quaternion:
            vehicle.attitudes.add(times, quaternions(_columns(table, "roll", "pitch", "yaw")))
        elif name == "OBSTACLE_DISTANCE":
            self._ring(vehicle, times, table)
        elif name == "HEARTBEAT":
            self._beat(vehicle, times, table)
        elif name in ("BATTERY_STATUS", "SYS_STATUS"):
            left = table["battery_remaining"].astype(np.float64)
            vehicle.battery.add(times[left >= 0], left[left >= 0, None])
        elif name == "STATUSTEXT" and not self._has_log:
            self._say([Text(at, 2, sender, row["text"]) for at, row in zip(times.tolist(), table, strict=True)])

    def _ring(self, vehicle: _Vehicle, times: Floats, table: Table) -> None:
        last = table[-1]
        step = float(last["increment_f"]) or float(last["increment"])
        vehicle.bearings = np.radians(float(last["angle_offset"]) + step * np.arange(72))
        distances = table["distances"].astype(np.float64)
        vehicle.rings.add(times, np.where(distances <= table["max_distance"][:, None], 0.01 * distances, np.nan))

    def _beat(self, vehicle: _Vehicle, times: Floats, table: Table) -> None:
        flown = table["autopilot"] != _INVALID_AUTOPILOT
        times, table = times[flown], table[flown]
        if not len(table):
            return
        vehicle.is_vehicle = True
        for autopilot, mode in {(int(row["autopilot"]), int(row["custom_mode"])) for row in table}:
            firmware = firmware_of(autopilot)
            self._modes[mode] = firmware.mode_of(mode).value if firmware else f"mode {mode}"
        critical = np.isin(table["system_status"], (5, 6))
        vehicle.beats.add(times, np.column_stack((table["custom_mode"], (table["base_mode"] & _ARMED) != 0, critical)))

    # ------------------------------------------------------------------------------------------------- asked by pages

    @property
    def _vehicle(self) -> _Vehicle:
        for vehicle in self._vehicles.values():
            if vehicle.is_vehicle:
                return vehicle
        return next(iter(self._vehicles.values()), _Vehicle())

    def at(self, time: float) -> Moment:
        """The flight at a time of its own clock (s)."""
        vehicle = self._vehicle
        place, _ = _row(vehicle.places, time)
        attitude, _ = _row(vehicle.attitudes, time)
        ring, ring_age = _row(vehicle.rings, time)
        beat, beat_age = _row(vehicle.beats, time, stale_s=np.inf)
        battery, _ = _row(vehicle.battery, time, stale_s=np.inf)
        returns = np.empty((0, 3))
        nearest = None
        if ring is not None:
            hit = np.isfinite(ring)
            ranges, bearings = ring[hit], vehicle.bearings[hit]
            returns = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))))
            nearest = float(ranges.min()) if len(ranges) else None
        ages = [age for age in (beat_age, ring_age, _row(vehicle.places, time, stale_s=np.inf)[1]) if age is not None]
        return Moment(
            time,
            None if place is None else place[:3],
            None if place is None else place[3:],
            attitude,
            returns,
            nearest,
            self._plan(time),
            "unknown" if beat is None else self._modes.get(int(beat[0]), "unknown"),
            beat is not None and bool(beat[1]),
            beat is not None and bool(beat[2]),
            min(ages) if ages else None,
            None if battery is None else float(battery[0]),
            tuple([text for text in self.texts if text.time <= time][-6:]),
        )

    def _plan(self, time: float) -> Plan | None:
        row, _ = _row(self._plans, time)
        if row is None:
            return None
        clearance, limit, blocked, limited, phase, state = row[6:12]
        return Plan(
            row[:3],
            row[3:6],
            float(clearance),
            float(limit),
            bool(blocked),
            bool(limited),
            phase_name(int(phase)),
            state_name(int(state)),
        )

    def path_ned(self) -> Floats:
        """(n, 3): all of it so far."""
        return self._vehicle.places.rows()[:, 1:4]

    def reference_ned(self) -> Floats:
        """(n, 3)"""
        return self._plans.rows()[:, 1:4]

    def attitude_deg(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) and roll, pitch, yaw (n, 3)."""
        rows = _between(self._vehicle.attitudes.rows(), start, stop)
        return rows[:, 0], euler_deg(rows[:, 1:])

    def clearance(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) and clearance of the hull (n,) as the companion had it; without one, the ring's nearest return."""
        plans = _between(self._plans.rows(), start, stop)
        if len(plans):
            return plans[:, 0], np.where(np.isfinite(plans[:, 7]), plans[:, 7], np.nan)
        rings = _between(self._vehicle.rings.rows(), start, stop)
        return rings[:, 0], np.fmin.reduce(rings[:, 1:], axis=1)

    def speed(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) and speed (n,)."""
        rows = _between(self._vehicle.places.rows(), start, stop)
        return rows[:, 0], np.linalg.norm(rows[:, 4:7], axis=1)


def _columns(table: Table, *names: str) -> Floats:
    return np.column_stack([table[name].astype(np.float64) for name in names])


def _row(track: Track, time: float, stale_s: float = STALE_S) -> tuple[Floats | None, float | None]:
    """The last row at or before a time, without its own, and its age; (None, None) if there is none fresh enough."""
    rows = track.rows()
    index = int(np.searchsorted(rows[:, 0], time, side="right")) - 1
    if index < 0:
        return None, None
    age = time - float(rows[index, 0])
    return (rows[index, 1:], age) if age <= stale_s else (None, None)


def _between(rows: Floats, start: float, stop: float) -> Floats:
    first, last = np.searchsorted(rows[:, 0], (start, stop))
    return rows[first : last + 1]


def quaternions(euler: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw (rad) -> (n, 4) w,x,y,z; `protocol.frames.from_euler` for many."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * euler).T, np.sin(0.5 * euler).T
    return np.column_stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )
