"""What a live page knows of a flight: as much of its past as is worth drawing, and any moment of it."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from companion.link.firmware import firmware_of
from companion.perception.distance_field import FAR_M
from companion.records import PLANNED, TRACE
from companion.state import Reason, Scan
from companion.view.findings import phase_name, state_name
from companion.view.gather import Batch, Table, Text, euler_deg
from companion.view.lines import Floats, Track
from companion.view.mapping import PosedScan
from protocol.arrays import Array, BoolArray
from protocol.flightlog import TEXT

MOST = 10_000
"""Rows of each track; twice as many may be held."""
MOST_TEXTS = 200
STALE_S = 1.5
GUARD_SHOWN_S = 0.5
"""An intervention of the guard is shown for so long: many last for a step or two."""
_GUARD: dict[int, str] = {
    Reason.BARRIER: "keeps off",
    Reason.STOP: "keeps room to stop",
    Reason.NO_STOP: "no room to stop",
    Reason.STALE: "sees nothing",
}
_SECTORS = 72
_COORDINATES = PLANNED.dtype["way_ned"].shape[0]
_CLOCK_S = 5.0
"""A ring that is not between 0 and this older than the attitude then has a clock of its own."""
_GAP_S = 0.5
"""Poses further apart than this are not joined."""
_INVALID_AUTOPILOT = 8
_ARMED = 128
_UNKNOWN_CM = 65535
_SECONDS = np.array([1.0, 1.0, 1.0, 1.0, 1e-3])


@dataclass(frozen=True, slots=True)
class Plan:
    """What the companion wanted at a control step."""

    reference_ned: Floats
    target_ned: Floats
    way_ned: Floats
    """(k, 2) the corners of the way over the map, as far as the log keeps them, the first where the vehicle was when it
    asked; none without a map."""
    clearance: float
    speed_limit: float
    blocked: bool
    limited: bool
    phase: str
    state: str
    guard: str
    """What the guard changed the command for, lately; empty if it did not."""
    guard_change: float
    """m/s2 by which."""
    pushed_ned: Floats
    """(3,) m/s2, the acceleration that it let through."""


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
    attitudes: Track = field(default_factory=lambda: Track(6, MOST))
    """Quaternion, and the vehicle's time (s)."""
    rings: Track = field(default_factory=lambda: Track(3 + _SECTORS, MOST // 2))
    """The vehicle's time (s), reach (m), and of each sector its range (m), inf for nothing there, NaN for unknown."""
    beats: Track = field(default_factory=lambda: Track(4, MOST))
    """custom_mode, armed, critical."""
    battery: Track = field(default_factory=lambda: Track(2, MOST))
    heard: Track = field(default_factory=lambda: Track(2, MOST))
    bearings: Floats = field(default_factory=lambda: np.radians(5.0 * np.arange(_SECTORS)))
    is_vehicle: bool = False


class History:
    """Filled from batches, asked for moments."""

    def __init__(self) -> None:
        self.start = 0.0
        self.end = 0.0
        self.texts: list[Text] = []
        self._begun = False
        self._vehicles: dict[str, _Vehicle] = {}
        self._plans = Track(19, MOST)
        self._ways = Track(2 + _COORDINATES, MOST)
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
        elif topic == PLANNED.topic:
            self._ways.add(times, np.column_stack((table["corners"], table["way_ned"])))
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
        guard = [table[name] for name in ("guard_reason", "guard_change") if name in (table.dtype.names or ())]
        guard = guard or [np.zeros(len(table))] * 2  # a log from before there was one
        rows = (table["reference_position_ned"], table["target_ned"], *singles, table["reference_yaw"], *guard)
        self._plans.add(times, np.column_stack((*rows, table["acceleration_command_ned"])))

    def _message(self, sender: str, name: str, times: Floats, table: Table) -> None:
        vehicle = self._vehicles.setdefault(sender, _Vehicle())
        if name == "LOCAL_POSITION_NED":
            vehicle.places.add(times, _columns(table, "x", "y", "z", "vx", "vy", "vz"))
        elif name == "ATTITUDE_QUATERNION":
            self._has_quaternion = True
            vehicle.attitudes.add(times, _columns(table, "q1", "q2", "q3", "q4", "time_boot_ms") * _SECONDS)
        elif name == "ATTITUDE" and not self._has_quaternion:
            turns = quaternions(_columns(table, "roll", "pitch", "yaw"))
            vehicle.attitudes.add(times, np.column_stack((turns, 1e-3 * table["time_boot_ms"])))
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
        vehicle.bearings = np.radians(float(last["angle_offset"]) + step * np.arange(_SECTORS))
        distances, reach = table["distances"].astype(np.float64), 0.01 * table["max_distance"]
        ranges = np.where(distances <= table["max_distance"][:, None], 0.01 * distances, np.inf)
        ranges[distances == _UNKNOWN_CM] = np.nan
        vehicle.rings.add(times, np.column_stack((1e-6 * table["time_usec"], reach, ranges)))

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
            hit = np.isfinite(ring[2:])
            ranges, bearings = ring[2:][hit], vehicle.bearings[hit]
            returns = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))))
            nearest = float(ranges.min()) if len(ranges) else None
        ages = [age for age in (beat_age, ring_age, _row(vehicle.places, time, stale_s=np.inf)[1]) if age is not None]
        return Moment(
            time,
            None if place is None else place[:3],
            None if place is None else place[3:],
            None if attitude is None else attitude[:4],
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
        way, _ = _row(self._ways, time)
        corners = 0 if way is None else int(way[0])
        clearance, limit, blocked, limited, phase, state = row[6:12]
        lately = _between(self._plans.rows(), time - GUARD_SHOWN_S, time)
        changed = lately[(lately[:, 14] != Reason.NONE) & (lately[:, 0] <= time)]
        worst = changed[changed[:, 15].argmax()] if len(changed) else np.zeros(19)
        return Plan(
            row[:3],
            row[3:6],
            np.empty((0, 2)) if way is None else way[1 : 1 + 2 * corners].reshape(-1, 2),
            float(clearance),
            float(limit),
            bool(blocked),
            bool(limited),
            phase_name(int(phase)),
            state_name(int(state)),
            _GUARD.get(int(worst[14]), ""),
            float(worst[15]),
            worst[16:19],
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
        return rows[:, 0], euler_deg(rows[:, 1:5])

    def clearance(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) and clearance of the hull (n,) as the companion had it, up to FAR_M; without a companion, the
        ring's nearest return, or its reach."""
        plans = _between(self._plans.rows(), start, stop)
        if len(plans):
            return plans[:, 0], np.minimum(plans[:, 7], FAR_M)
        rings = _between(self._vehicle.rings.rows(), start, stop)
        return rings[:, 0], np.fmin(np.fmin.reduce(rings[:, 3:], axis=1), rings[:, 2])

    def speed(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) and speed (n,)."""
        rows = _between(self._vehicle.places.rows(), start, stop)
        return rows[:, 0], np.linalg.norm(rows[:, 4:7], axis=1)

    def scans(self, start: float, stop: float) -> Iterator[PosedScan]:
        """The rings that came after `start` and up to `stop`, each with the pose of its own time; those without one
        are left out."""
        vehicle = self._vehicle
        rows, attitudes, places = vehicle.rings.rows(), vehicle.attitudes.rows(), vehicle.places.rows()
        first, last = np.searchsorted(rows[:, 0], (start, stop), side="right")
        rows = rows[first:last]
        if not len(rows) or not len(attitudes) or not len(places):
            return
        newest = attitudes[np.maximum(np.searchsorted(attitudes[:, 0], rows[:, 0], side="right") - 1, 0), 5]
        age = newest - rows[:, 1]
        when = rows[:, 0] - np.where((age >= 0.0) & (age <= _CLOCK_S), age, 0.0)
        turns, near = _joined(attitudes[:, :5], when)
        positions, also_near = _joined(places[:, :4], when)
        known = near & also_near
        for row, position, turn in zip(rows[known], positions[known], turns[known], strict=True):
            ranges: Array = row[3:].astype(np.float64)
            hit, measured = np.isfinite(ranges), ~np.isnan(ranges)
            ranges = np.where(measured, np.minimum(ranges, row[2]), 0.0)
            bearings = vehicle.bearings.astype(np.float64)
            scan = Scan(round(row[0] * 1e9), round(row[1] * 1e6), bearings, ranges, hit, measured)
            yield PosedScan(scan, position, turn / np.linalg.norm(turn))


def _joined(rows: Floats, times: Floats) -> tuple[Array, BoolArray]:
    """Values (n, k) between rows (m, 1 + k) at times (n,), straight from one to the next, and for which times that
    makes sense (n,). Quaternions may change their sign from row to row."""
    after = np.searchsorted(rows[:, 0], times).clip(0, len(rows) - 1)
    before = (after - 1).clip(0)
    early, late = rows[before], rows[after]
    span = late[:, 0] - early[:, 0]
    share = np.divide(times - early[:, 0], span, out=np.ones_like(times), where=span > 0.0).clip(0.0, 1.0)[:, None]
    to = late[:, 1:]
    if rows.shape[1] == 5:
        to = to * np.where((early[:, 1:] * to).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    near: BoolArray = np.minimum(abs(times - early[:, 0]), abs(times - late[:, 0])) < _GAP_S
    values: Array = (early[:, 1:] + share * (to - early[:, 1:])).astype(np.float64)
    return values, near


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
