"""What a live page knows of a flight: as much of its past as is worth drawing, and the flight at any moment of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from companion.link.firmware import firmware_of
from companion.logs.recordings import FARTHEST_M, SETPOINTS
from companion.perception.distance_field import FAR_M
from companion.records import PLANNED, TRACE
from companion.state import Reason, Scan
from companion.supervision.states import State
from companion.view.accumulators.scans import ring_sender
from companion.view.accumulators.senders import CRITICAL, Commanded
from companion.view.accumulators.texts import WARNING, Text, VehicleLines
from companion.view.attitudes import euler_deg, quaternions
from companion.view.batches import Batch, Table, sender_and_name
from companion.view.columns import stacked
from companion.view.events import phase_name, state_name
from companion.view.lines import Floats, Track
from companion.view.mapping import PosedScan
from companion.view.rings import RingTables, shows_around
from protocol.arrays import Array, BoolArray
from protocol.flightlog import TEXT
from protocol.messages import dialect

MOST, RECENT = 10_000, 5_000
"""Rows of each track, of which twice as many may be held, and of those of the last minute or so, which are whole."""
MOST_TEXTS = 200
_TEXTS = 6
STALE_S = 1.5
"""A pose or a scan that is older than this (s) is not shown."""
GUARD_SHOWN_S = 0.5
"""How long (s) an intervention of the guard is shown: many last for one or two control steps."""
_GUARD: dict[int, str] = {
    Reason.BARRIER: "keeps off",
    Reason.STOP: "keeps room to stop",
    Reason.NO_STOP: "no room to stop",
    Reason.STALE: "sees nothing",
    Reason.EVASION: "gets out of the way",
}
_BLIND = (Reason.NO_STOP, Reason.STALE)
_SECTORS = 72
_COORDINATES = PLANNED.dtype["way_ned"].shape[0]
_LARGEST_SCAN_AGE_S = 5.0
"""A scan that seems older than this (s) than the newest attitude, or newer, has a clock of its own."""
_GAP_S = 0.5
"""Poses further apart than this (s) are not interpolated."""
_UNKNOWN_CM = 65535
_ALL_BATTERIES = -1
_NOT_UNIT = 0.02
"""A quaternion whose square is farther from 1 is none."""
_SECONDS = np.array([1.0, 1.0, 1.0, 1.0, 1e-3])
"""Factors of a quaternion's and a time's (ms) columns."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What the companion wanted at a control step."""

    reference_ned: Floats
    """(3,) m"""
    target_ned: Floats
    """(3,) m, where avoidance steers to."""
    way_ned: Floats
    """(k, 2) north and east (m) of the corners of the planned way, as far as the log keeps them. The first is where the
    vehicle was when the way was asked for; there are none without a map."""
    clearance: float
    """m"""
    speed_limit: float
    """m/s"""
    blocked: bool
    """Avoidance steers away from the route."""
    limited: bool
    """A limit on thrust or tilt is reached."""
    guard: str
    """Why the guard changed the command within the last GUARD_SHOWN_S; empty if it did not."""
    guard_change: float
    """By how much the guard changed the acceleration (m/s2)."""
    guard_blind: bool
    """It could not keep room: there was none to stop in, or no scan."""
    pushed_ned: Floats
    """(3,) the acceleration that the guard let through (m/s2)."""


@dataclass(frozen=True, slots=True)
class Span:
    """A part of the flight in which something stayed the same."""

    start: float
    """s"""
    end: float
    """s"""
    name: str


@dataclass(frozen=True, slots=True)
class Moment:
    """The flight at one time; None for what was not known or too old by then."""

    time: float
    """s"""
    position_ned: Floats | None
    """(3,) m"""
    velocity_ned: Floats | None
    """(3,) m/s"""
    attitude_ned_frd: Floats | None
    """(4,)"""
    returns_frd: Floats
    """(n, 3) the returns of the newest scan, in body axes (m)."""
    nearest: float | None
    """Distance of the nearest return from the LiDAR (m)."""
    plan: Plan | None
    phase: str | None
    """What the companion told last of the mission, however long ago: it watches a landing without control steps. None
    without a companion."""
    state: str | None
    """The same of its supervision."""
    mode: str
    armed: bool
    failsafe: bool
    link_age: float | None
    """Time since the vehicle was heard (s)."""
    battery: float | None
    """Charge left (%), of several batteries in the emptiest."""
    texts: tuple[Text, ...]
    """The last few lines that were said by then."""
    warnings: tuple[Text, ...]
    """Those of them that were at least warnings, and earlier ones."""

    @property
    def doing(self) -> str | None:
        """The phase, or the state of a companion that does not fly its mission."""
        return None if self.phase is None or self.state is None else _doing(self.phase, self.state)


@dataclass(slots=True)
class _Vehicle:
    """The tracks of one sender."""

    positions: Track = field(default_factory=lambda: Track(7, MOST, RECENT))
    attitudes: Track = field(default_factory=lambda: Track(6, MOST, RECENT))
    """Quaternion, and the vehicle's time (s)."""
    scans: Track = field(default_factory=lambda: Track(3 + _SECTORS, MOST // 2, RECENT // 5))
    """The vehicle's time (s), the LiDAR's reach (m), and the range of each sector (m): inf for no return, NaN for
    unknown."""
    heartbeats: Track = field(default_factory=lambda: Track(4, MOST, RECENT))
    """custom_mode, armed, critical."""
    batteries: dict[int, Track] = field(default_factory=dict)
    """The charge (%) of each by its number; _ALL_BATTERIES stands for what is told of all of them."""
    bearings: Floats = field(default_factory=lambda: np.radians(5.0 * np.arange(_SECTORS)))
    modes: dict[int, str] = field(default_factory=dict)
    """Names by custom_mode."""
    is_vehicle: bool = False
    has_quaternion: bool = False


class History:
    """The flight so far, filled with batches and asked for moments."""

    def __init__(self) -> None:
        self.start = 0.0
        self.end = 0.0
        self.texts: list[Text] = []
        self._lines = VehicleLines()
        self._begun = False
        self._vehicles: dict[str, _Vehicle] = {}
        self._commanded = Commanded()
        self._rings = RingTables()
        self._plans = Track(19, MOST, RECENT)
        self._ways = Track(2 + _COORDINATES, MOST, RECENT)
        self.shown: str | None = None
        """The sender ("system/component") of the vehicle that is shown; None: the first that was heard."""
        self._has_log = False

    def take(self, batch: Batch) -> None:
        """Add a batch. Times count from the zero of the log's or the page's clock."""
        topic, _, times_ns, table = batch
        times = times_ns * 1e-9
        if not self._begun:
            self._begun, self.start = True, float(times[0])
        self.start, self.end = min(self.start, float(times[0])), max(self.end, float(times[-1]))
        if topic == TRACE.topic:
            self._trace(times, table)
        elif topic == PLANNED.topic:
            self._ways.add(times, np.column_stack((table["corners"], table["way_ned"])))
        elif topic == TEXT.topic:
            rows = zip(times.tolist(), table, strict=True)
            if not self._has_log:
                # The companion's words repeat the vehicle's.
                self._has_log, self.texts, self._lines = True, [], VehicleLines()
            self._say([Text(at, row["level"], row["name"], row["message"]) for at, row in rows])
        elif (message := sender_and_name(topic)) is not None:
            self._message(*message, times, table)
            if cut_short := self._lines.over(self.end):
                self._say(cut_short)

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
            motion = stacked(table, "x", "y", "z", "vx", "vy", "vz")
            told = (abs(motion) <= FARTHEST_M).all(axis=1)
            vehicle.positions.add(times[told], motion[told])
        elif name == "ATTITUDE_QUATERNION":
            vehicle.has_quaternion = True
            turns = stacked(table, "q1", "q2", "q3", "q4", "time_boot_ms") * _SECONDS
            told = abs((turns[:, :4] ** 2).sum(axis=1) - 1.0) < _NOT_UNIT
            vehicle.attitudes.add(times[told], turns[told])
        elif name == "ATTITUDE" and not vehicle.has_quaternion:
            angles = stacked(table, "roll", "pitch", "yaw")
            told = np.isfinite(angles).all(axis=1)
            turns = np.column_stack((quaternions(angles[told]), 1e-3 * table["time_boot_ms"][told]))
            vehicle.attitudes.add(times[told], turns)
        elif (rings := self._rings.take(sender, name, times, table)) is not None:
            self._scan(vehicle, *rings)
        elif name == "HEARTBEAT":
            self._heartbeat(vehicle, times, table)
        elif name in SETPOINTS:
            self._commanded.add(table)
        elif name in ("BATTERY_STATUS", "SYS_STATUS"):
            numbers = table["id"] if name == "BATTERY_STATUS" else np.full(len(table), _ALL_BATTERIES)
            left = table["battery_remaining"].astype(np.float64)
            for number in np.unique(numbers).tolist():
                told = (numbers == number) & (left >= 0)
                vehicle.batteries.setdefault(number, Track(2, MOST, RECENT)).add(times[told], left[told, None])
        elif name == "STATUSTEXT" and not self._has_log:
            self._say(self._lines.take(sender, times, table))

    def _scan(self, vehicle: _Vehicle, times: Floats, table: Table) -> None:
        around = shows_around(table)
        times, table = times[around], table[around]
        if not len(table):
            return
        last = table[-1]
        step = float(last["increment_f"]) or float(last["increment"])
        vehicle.bearings = np.radians(float(last["angle_offset"]) + step * np.arange(_SECTORS))
        distances, reach = table["distances"].astype(np.float64), 0.01 * table["max_distance"]
        ranges = np.where(distances <= table["max_distance"][:, None], 0.01 * distances, np.inf)
        ranges[distances == _UNKNOWN_CM] = np.nan
        vehicle.scans.add(times, np.column_stack((1e-6 * table["time_usec"], reach, ranges)))

    def _heartbeat(self, vehicle: _Vehicle, times: Floats, table: Table) -> None:
        flown = table["autopilot"] != dialect.MAV_AUTOPILOT_INVALID
        times, table = times[flown], table[flown]
        if not len(table):
            return
        vehicle.is_vehicle = True
        for autopilot, mode in {(int(row["autopilot"]), int(row["custom_mode"])) for row in table}:
            firmware = firmware_of(autopilot)
            vehicle.modes[mode] = firmware.mode_of(mode).value if firmware else f"mode {mode}"
        armed = (table["base_mode"] & dialect.MAV_MODE_FLAG_SAFETY_ARMED) != 0
        critical = np.isin(table["system_status"], CRITICAL)
        vehicle.heartbeats.add(times, np.column_stack((table["custom_mode"], armed, critical)))

    @property
    def vehicles(self) -> tuple[str, ...]:
        """The senders of those that can be shown, as they were heard. A log with a trace is of one vehicle."""
        heard = [sender for sender, vehicle in self._vehicles.items() if vehicle.is_vehicle]
        if heard and len(self._plans.rows()):
            heard = [max(heard, key=self._commanded.count)]
        return tuple(heard)

    @property
    def _shown(self) -> str:
        heard = self.vehicles or tuple(self._vehicles)
        return self.shown if self.shown in heard else next(iter(heard), "")

    @property
    def _vehicle(self) -> _Vehicle:
        return self._vehicles.get(self._shown) or _Vehicle()

    @property
    def _scanner(self) -> _Vehicle:
        """Whose scans are those around the vehicle that is shown."""
        scanners = [sender for sender, each in self._vehicles.items() if len(each.scans.rows())]
        flown = [sender for sender, each in self._vehicles.items() if each.is_vehicle]
        return self._vehicles.get(ring_sender(self._shown, scanners, flown)) or _Vehicle()

    def at(self, time: float) -> Moment:
        """The flight at a time of its own clock (s)."""
        vehicle, scanner = self._vehicle, self._scanner
        position, _ = _row(vehicle.positions, time)
        attitude, _ = _row(vehicle.attitudes, time)
        scan, _ = _row(scanner.scans, time)
        told, _ = _row(self._plans, time, stale_s=np.inf)
        heartbeat, heartbeat_age = _row(vehicle.heartbeats, time, stale_s=np.inf)
        charges = [_row(track, time, stale_s=np.inf)[0] for track in vehicle.batteries.values()]
        returns = np.empty((0, 3))
        nearest = None
        if scan is not None:
            hit = np.isfinite(scan[2:])
            ranges, bearings = scan[2:][hit], scanner.bearings[hit]
            returns = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))))
            nearest = float(ranges.min()) if len(ranges) else None
        ages = (heartbeat_age, *(_row(track, time, stale_s=np.inf)[1] for track in (vehicle.scans, vehicle.positions)))
        return Moment(
            time=time,
            position_ned=None if position is None else position[:3],
            velocity_ned=None if position is None else position[3:],
            attitude_ned_frd=None if attitude is None else attitude[:4],
            returns_frd=returns,
            nearest=nearest,
            plan=self._plan(time),
            phase=None if told is None else phase_name(int(told[10])),
            state=None if told is None else state_name(int(told[11])),
            mode="unknown" if heartbeat is None else vehicle.modes.get(int(heartbeat[0]), "unknown"),
            armed=heartbeat is not None and bool(heartbeat[1]),
            failsafe=heartbeat is not None and bool(heartbeat[2]),
            link_age=min((age for age in ages if age is not None), default=None),
            battery=min((float(charge[0]) for charge in charges if charge is not None), default=None),
            texts=tuple([text for text in self.texts if text.time <= time][-_TEXTS:]),
            warnings=tuple([text for text in self.warnings() if text.time <= time][-_TEXTS:]),
        )

    def _plan(self, time: float) -> Plan | None:
        row, _ = _row(self._plans, time)
        if row is None:
            return None
        way, _ = _row(self._ways, time)
        corners = 0 if way is None else int(way[0])
        clearance, limit, blocked, limited = row[6:10]
        lately = _between(self._plans.rows(), time - GUARD_SHOWN_S, time)
        changed = lately[(lately[:, 14] != Reason.NONE) & (lately[:, 0] <= time)]
        worst = changed[changed[:, 15].argmax()] if len(changed) else np.zeros(19)
        return Plan(
            reference_ned=row[:3],
            target_ned=row[3:6],
            way_ned=np.empty((0, 2)) if way is None else way[1 : 1 + 2 * corners].reshape(-1, 2),
            clearance=float(clearance),
            speed_limit=float(limit),
            blocked=bool(blocked),
            limited=bool(limited),
            guard=_GUARD.get(int(worst[14]), ""),
            guard_change=float(worst[15]),
            guard_blind=int(worst[14]) in _BLIND,
            pushed_ned=worst[16:19],
        )

    def warnings(self) -> list[Text]:
        """What was said and is at least a warning."""
        return [text for text in self.texts if text.level >= WARNING]

    def phases(self) -> list[Span]:
        """What the companion was doing, the last of it up to the end; nothing without a companion."""
        rows = self._plans.rows()
        spans = _spans(rows[:, 0], rows[:, 11:13], lambda codes: _doing(phase_name(codes[0]), state_name(codes[1])))
        return [*spans[:-1], *(replace(last, end=max(last.end, self.end)) for last in spans[-1:])]

    def modes(self) -> list[Span]:
        """The vehicle's modes of flight, from the first to the last time."""
        rows, names = self._vehicle.heartbeats.rows(), self._vehicle.modes
        return _spans(rows[:, 0], rows[:, 1:2], lambda codes: names.get(codes[0], "unknown"))

    def path_ned(self) -> Floats:
        """(n, 3) the path of the vehicle so far (m)."""
        return self._vehicle.positions.rows()[:, 1:4]

    def reference_ned(self) -> Floats:
        """(n, 3) the path of the reference so far (m)."""
        return self._plans.rows()[:, 1:4]

    def attitude_deg(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) in s and roll, pitch, yaw (n, 3) in degrees, from `start` to `stop` (s)."""
        rows = _between(self._vehicle.attitudes.rows(), start, stop)
        return rows[:, 0], euler_deg(rows[:, 1:5])

    def clearance(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) in s and clearance of the hull (n,) in m as the companion had it, up to FAR_M.

        Without a companion it is the range of the nearest return, or the LiDAR's reach.
        """
        plans = _between(self._plans.rows(), start, stop)
        if len(plans):
            return plans[:, 0], np.minimum(plans[:, 7], FAR_M)
        scans = _between(self._scanner.scans.rows(), start, stop)
        return scans[:, 0], np.fmin(np.fmin.reduce(scans[:, 3:], axis=1), scans[:, 2])

    def speed(self, start: float, stop: float) -> tuple[Floats, Floats]:
        """Times (n,) in s and speeds (n,) in m/s."""
        rows = _between(self._vehicle.positions.rows(), start, stop)
        return rows[:, 0], np.linalg.norm(rows[:, 4:7], axis=1)

    def scans(self, start: float, stop: float) -> Iterator[PosedScan]:
        """The scans that came after `start` and up to `stop` (s), each with the pose at its own time. Scans for which
        no pose is known are left out."""
        vehicle, scanner = self._vehicle, self._scanner
        rows, attitudes, positions = scanner.scans.rows(), vehicle.attitudes.rows(), vehicle.positions.rows()
        first, last = np.searchsorted(rows[:, 0], (start, stop), side="right")
        rows = rows[first:last]
        if not len(rows) or not len(attitudes) or not len(positions):
            return
        newest = attitudes[np.maximum(np.searchsorted(attitudes[:, 0], rows[:, 0], side="right") - 1, 0), 5]
        age = newest - rows[:, 1]
        when = rows[:, 0] - np.where((age >= 0.0) & (age <= _LARGEST_SCAN_AGE_S), age, 0.0)
        turns, attitude_known = _interpolated(attitudes[:, :5], when)
        places, position_known = _interpolated(positions[:, :4], when)
        known = attitude_known & position_known
        for row, place, turn in zip(rows[known], places[known], turns[known], strict=True):
            ranges: Array = row[3:].astype(np.float64)
            hit, measured = np.isfinite(ranges), ~np.isnan(ranges)
            ranges = np.where(measured, np.minimum(ranges, row[2]), 0.0)
            bearings = scanner.bearings.astype(np.float64)
            scan = Scan(round(row[0] * 1e9), round(row[1] * 1e6), bearings, ranges, hit, measured)
            yield PosedScan(scan, place, turn / np.linalg.norm(turn))


def _doing(phase: str, state: str) -> str:
    return phase if state == State.FLY.name.lower() else state


def _spans(times: Floats, codes: Floats, name: Callable[[list[int]], str]) -> list[Span]:
    """The spans in which codes (n, k) stayed the same at times (n,) in s; each ends where the next begins."""
    if not len(times):
        return []
    firsts = np.concatenate(([0], 1 + np.nonzero((np.diff(codes, axis=0) != 0.0).any(axis=1))[0]))
    ends = [*times[firsts[1:]].tolist(), float(times[-1])]
    return [
        Span(float(times[first]), end, name([int(code) for code in codes[first]]))
        for first, end in zip(firsts.tolist(), ends, strict=True)
    ]


def _interpolated(rows: Floats, times: Floats) -> tuple[Array, BoolArray]:
    """Rows (m, 1 + k), the time (s) first, interpolated at times (n,): values (n, k), and whether a row is near (n,).

    Of two quaternions (k = 4) with opposite signs one is negated first.
    """
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


def _row(track: Track, time: float, stale_s: float = STALE_S) -> tuple[Floats | None, float | None]:
    """The last row at or before a time (s), without its own time, and its age (s); (None, None) if it is too old."""
    found = track.at(time)
    return (None, None) if found is None or found[1] > stale_s else found


def _between(rows: Floats, start: float, stop: float) -> Floats:
    """The rows from `start` to the first one after `stop` (s)."""
    first, last = np.searchsorted(rows[:, 0], (start, stop))
    return rows[first : last + 1]
