"""One pass over a log, ours or one converted from another system's telemetry: everything that the report draws."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import Settings, recorded_settings
from companion.link.firmware import firmware_of
from companion.mission.plan import Phase
from companion.records import LOOP, TICK, TRACE
from companion.supervision.supervisor import FLYING, State
from companion.view.lines import (
    Floats,
    Line,
    Pairs,
    Regularity,
    Response,
    Rings,
    Segments,
    Spectrum,
    Stretches,
    Track,
)
from protocol.flightlog import DATAGRAM, TEXT, LogReader, RecordType
from protocol.messages import dialect
from protocol.toml_files import TomlFileError

Table = NDArray[np.void]
Batch = tuple[str, RecordType, NDArray[np.int64], Any]
"""Topic, type, times (n,) ns and the records: a structured array of (n,), or n dicts if they vary in size."""
Columns = dict[str, Floats]

BATCH = 4096
"""Records of a topic that are looked at together."""
MOST_TEXTS = 2000
CLEARANCE_BIN_M = 0.25
CLEARANCE_BINS = 60
_DAY_NS = 86_400_000_000_000
_INVALID_AUTOPILOT = 8
_ARMED = 128
_SILENCE_S = 10.0
_INTEGERS = {
    dialect.MAV_PARAM_TYPE_UINT8: "<B",
    dialect.MAV_PARAM_TYPE_INT8: "<b",
    dialect.MAV_PARAM_TYPE_UINT16: "<H",
    dialect.MAV_PARAM_TYPE_INT16: "<h",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}
_FLYING = [state.value for state in FLYING]


@dataclass(frozen=True, slots=True)
class Text:
    """Something that was said, or that changed."""

    time: float
    level: int
    """As in `logging`, by tens: 2 info, 3 warning, 4 error, 5 fatal."""
    source: str
    text: str


@dataclass(slots=True)
class Errors:
    """Tracking within one phase: sums over its control steps."""

    count: int = 0
    squares: Floats = field(default_factory=lambda: np.zeros(3))
    largest: float = 0.0
    largest_at: float = 0.0

    def add(self, times: Floats, errors_ned: Floats, size: Floats) -> None:
        """(n,), (n, 3) and (n,): the greatest distance since the step before."""
        self.count += len(times)
        self.squares += (errors_ned**2).sum(axis=0)
        worst = int(size.argmax())
        if size[worst] > self.largest:
            self.largest, self.largest_at = float(size[worst]), float(times[worst])

    @property
    def rms_ned(self) -> Floats:
        return np.sqrt(self.squares / max(self.count, 1))


@dataclass(slots=True)
class Worst:
    """How often something was too large, and the few largest."""

    count: int = 0
    examples: list[tuple[float, float]] = field(default_factory=list)
    """(how large, when), largest first."""

    def add(self, times: Floats, sizes: Floats, limits: Floats | float) -> None:
        """(n,) each."""
        found = np.flatnonzero(sizes > limits)
        self.count += len(found)
        if len(found):
            top = found[np.argsort(sizes[found])[-5:]]
            mine = [(float(sizes[index]), float(times[index])) for index in top]
            self.examples = sorted([*self.examples, *mine], reverse=True)[:5]


@dataclass(slots=True)
class Ring:
    """One sender's rings."""

    rings: Rings = field(default_factory=Rings)
    offset_deg: float = 0.0
    increment_deg: float = 5.0


class Gathered:
    """What a log came to. Keys of `lines` are "<source>:<quantity>"; the source of a message is "sys/comp/NAME"."""

    def __init__(self, path: Path) -> None:
        self.log = LogReader(path)
        self.start_ns = 0
        """Time 0 of the charts, on the log's clock: the clock's own zero where that is near."""
        self.end = 0.0
        self.begin: float | None = None
        self.lines: dict[str, Line] = {}
        self.clocks: dict[str, Regularity] = {}
        self.texts: list[Text] = []
        self.vehicle_texts: list[Text] = []
        self.states = Stretches()
        self.phases = Stretches()
        self.modes: dict[str, Stretches] = {}
        self.mode_names: dict[int, str] = {}
        self.armed: dict[str, Stretches] = {}
        self.critical: dict[str, Stretches] = {}
        self.limited = Stretches()
        self.blocked = Stretches()
        self.guard = Stretches()
        """By its reason."""
        self.guard_changes = Worst()
        """m/s2"""
        self.tracking: dict[int, Errors] = {}
        self.clearance_counts = np.zeros(CLEARANCE_BINS, np.int64)
        self.safe_distance = settings_of(self.log).avoidance.safe_distance
        """m, as it was flown"""
        self.near_steps = 0
        """Control steps with less clearance than that."""
        self.least_clearance: tuple[float, float] | None = None
        """m, when."""
        self.late = Worst()
        self.latency_us = Line()
        self.latency_counts = np.zeros(120, np.int64)
        """By 20 bins a decade from 1 us."""
        self.path = Track(10)
        """Position NED, reference NED, target NED."""
        self.paths: dict[str, Track] = {}
        """Position NED by sender, for logs without a trace."""
        self._rates = Spectrum(3)
        self._torques = Spectrum(3)
        self._response = Response(3)
        self._sent_torques = Spectrum(3)
        self._sent_response = Response(3)
        self._sent_rates = Pairs(3)
        self._vehicle_rates: dict[str, Spectrum] = {}
        self.rings: dict[str, Ring] = {}
        self.position_jumps: dict[str, Worst] = {}
        self.attitude_jumps: dict[str, Worst] = {}
        self.distance_m = 0.0
        self.energy_wh: dict[str, float] = {}
        """By the message that told voltage and current."""
        self._parameters: dict[str, tuple[str, float, int]] = {}
        """Who said it, the value and its type."""
        self._bytewise: set[str] = set()
        """Senders that put an integer's bits where the message has a float."""
        self._last: dict[str, Table] = {}
        self._home: dict[str, tuple[float, float]] = {}
        self._power: dict[str, tuple[Floats, Floats]] = {}
        for topic, kind, times_ns, table in batches(self.log):
            self._take(topic, kind, times_ns, table)
        self.has_trace = TRACE.topic in self.clocks

    # ------------------------------------------------------------------------------------------------- sorting

    def _take(self, topic: str, kind: RecordType, times_ns: NDArray[np.int64], table: Any) -> None:
        if self.begin is None:
            self.start_ns = 0 if 0 <= times_ns[0] < _DAY_NS else int(times_ns[0])
            self.begin = float(times_ns[0] - self.start_ns) * 1e-9
        times = (times_ns - self.start_ns) * 1e-9
        self.begin = min(self.begin, float(times[0]))
        self.end = max(self.end, float(times[-1]))
        self.clocks.setdefault(topic, Regularity()).add(times)
        parts = topic.split("/")
        if topic == TRACE.topic:
            self._trace(times, table)
        elif topic == TICK.topic:
            self.line("ticks:late_ms", times, table["late_ns"] * 1e-6)
            self.late.add(times, table["late_ns"] * 1e-9, 2e-3)
        elif topic == LOOP.topic:
            self._latency(*_latencies(times, table))
        elif topic == TEXT.topic:
            rows = zip(times.tolist(), table, strict=True)
            self.texts += [Text(at, row["level"], row["name"], row["message"]) for at, row in rows]
            del self.texts[MOST_TEXTS:]
        elif len(parts) == 5 and parts[1] == "mavlink":
            self._message(f"{parts[2]}/{parts[3]}", parts[4], times, table)

    def line(self, key: str, times: Floats, values: Floats) -> None:
        """Add to a line: (n,) each, or values of (n, k) to k lines with a number behind their key."""
        if values.ndim == 2:
            for column in range(values.shape[1]):
                self.line(f"{key}.{column}", times, values[:, column])
            return
        known = self.lines.get(key)
        if known is None:
            known = self.lines[key] = Line()
        known.add(times, values)

    def _continued(self, key: str, table: Table) -> Table:
        """The table with the last row of the one before it in front: (n + 1,), or (n,) the first time."""
        before = self._last.get(key)
        self._last[key] = table[-1:].copy()
        return table if before is None else np.concatenate((before, table))

    # --------------------------------------------------------------------------------------------- the companion's

    def _trace(self, times: Floats, table: Table) -> None:
        names = table.dtype.names or ()
        error = table["position_ned"] - table["reference_position_ned"]
        for name in ("position_ned", "velocity_ned", "reference_position_ned", "reference_velocity_ned", "lyapunov"):
            self.line(f"trace:{name}", times, table[name])
        self.line("trace:height", times, -table["position_ned"][:, 2])
        self.line("trace:reference_height", times, -table["reference_position_ned"][:, 2])
        self.line("trace:speed", times, np.linalg.norm(table["velocity_ned"], axis=1))
        self.line("trace:reference_speed", times, np.linalg.norm(table["reference_velocity_ned"], axis=1))
        # What is the worst of many steps in the log is each step's own in a whole trace.
        size = table["worst_error"] if "worst_error" in names else np.linalg.norm(error, axis=1)
        torque = table["worst_torque"] if "worst_torque" in names else table["torque_command"]
        thrust = table["worst_thrust"] if "worst_thrust" in names else table["thrust_command"]
        self.line("trace:error_cm", times, 100.0 * size)
        self.line("trace:worst_torque", times, torque)
        self.line("trace:worst_thrust", times, thrust)
        euler = euler_deg(table["attitude_ned_frd"])
        self.line("trace:euler_deg", times, euler)
        self.line("trace:tilt_deg", times, tilt_deg(euler))
        self.line("trace:euler_command_deg", times, euler_deg(table["attitude_command_ned_frd"]))
        self.line("trace:rates_deg", times, np.degrees(table["rates_frd"]))
        self.line("trace:rates_command_deg", times, np.degrees(table["rates_command_frd"]))
        self.line("trace:torque_command", times, table["torque_command"])
        self.line("trace:thrust_command", times, table["thrust_command"])
        self.line("trace:age_ms", times, table["position_age"] * 1e3)
        self.line("trace:clearance", times, table["clearance"])
        self.line("trace:speed_limit", times, table["speed_limit"])
        for name in names:
            if name.startswith(("guard_", "disturbance", "wind")) and table.dtype[name].base.kind == "f":
                self.line(f"trace:{name}", times, table[name])
        self.path.add(
            times, np.column_stack((table["position_ned"], table["reference_position_ned"], table["target_ned"]))
        )
        self._rates.add(times, table["rates_frd"])
        self._torques.add(times, table["torque_command"])
        self.states.add(times, table["state"])
        self.phases.add(times, table["phase"])
        flown = table["state"] == State.FLY.value  # otherwise what is commanded is not what moves the vehicle
        self.limited.add(times, (table["limited"] & flown).astype(np.int64))
        self.blocked.add(times, (table["blocked"] & flown).astype(np.int64))
        if "guard_reason" in names:
            self.guard.add(times, table["guard_reason"].astype(np.int64))
            self.guard_changes.add(times, table["guard_change"], np.where(table["guard_reason"] > 0, 0.0, np.inf))
        self._response.add_pairs(times[flown], table["rates_command_frd"][flown], table["rates_frd"][flown])
        for phase in np.unique(table["phase"][flown]):
            chosen = flown & (table["phase"] == phase)
            self.tracking.setdefault(int(phase), Errors()).add(times[chosen], error[chosen], size[chosen])
        airborne = np.isin(table["state"], _FLYING) & (table["phase"] > Phase.PREPARE.value)
        self._clearances(times[airborne], table["clearance"][airborne])
        moved = self._continued("trace", table)
        airborne = moved["phase"][1:] > Phase.PREPARE.value
        steps = np.linalg.norm(np.diff(moved["position_ned"], axis=0), axis=1)
        self.distance_m += float(steps[airborne].sum())

    def _clearances(self, times: Floats, clearance: Floats) -> None:
        finite = np.isfinite(clearance)
        times, clearance = times[finite], clearance[finite]
        if not len(clearance):
            return
        bins = (clearance.clip(min=0.0) / CLEARANCE_BIN_M).astype(np.int64).clip(max=CLEARANCE_BINS - 1)
        self.clearance_counts += np.bincount(bins, minlength=CLEARANCE_BINS)
        self.near_steps += int((clearance < self.safe_distance).sum())
        nearest = int(clearance.argmin())
        if self.least_clearance is None or clearance[nearest] < self.least_clearance[0]:
            self.least_clearance = float(clearance[nearest]), float(times[nearest])

    def _latency(self, times: Floats, latency_us: Floats) -> None:
        self.latency_us.add(times, latency_us)
        bins = (20.0 * np.log10(latency_us.clip(min=1.0))).astype(np.int64)
        self.latency_counts += np.bincount(bins.clip(max=119), minlength=120)

    # ----------------------------------------------------------------------------------------------- the vehicle's

    def _message(self, sender: str, name: str, times: Floats, table: Any) -> None:
        source = f"{sender}/{name}"
        if name == "STATUSTEXT":
            for at, row in zip(times.tolist(), table, strict=True):
                level = max(1, 5 - max(int(row["severity"]) - 1, 0) // 2)
                self.vehicle_texts.append(Text(at, level, sender, row["text"]))
            del self.vehicle_texts[MOST_TEXTS:]
            return
        if name == "PARAM_VALUE":
            for row in table[:MOST_TEXTS] if len(self._parameters) < MOST_TEXTS else ():
                self._parameters[row["param_id"]] = sender, row["param_value"], row["param_type"]
            return
        if isinstance(table, list):
            return
        if name == "HEARTBEAT":
            self._heartbeat(sender, times, table)
        elif name == "OBSTACLE_DISTANCE":
            self._rings(sender, times, table)
        elif name == "GLOBAL_POSITION_INT":
            self._global_position(sender, times, table)
        if name == "LOCAL_POSITION_NED":
            self._position_jumps(sender, times, table)
            rows = np.column_stack((table["x"], table["y"], table["z"]))
            self.paths.setdefault(sender, Track(4)).add(times, rows)
        elif name in ("ATTITUDE", "ATTITUDE_QUATERNION"):
            rates = np.column_stack((table["rollspeed"], table["pitchspeed"], table["yawspeed"])).astype(np.float64)
            self._vehicle_rates.setdefault(source, Spectrum(3)).add(times, rates)
            if name == "ATTITUDE_QUATERNION":
                self._attitude_jumps(sender, times, table)
                self._sent_response.add_pairs(*self._sent_rates.answers(times, rates))
        elif name == "SET_ACTUATOR_CONTROL_TARGET":
            self._sent_torques.add(times, table["controls"][:, :3])
        elif name == "SET_ATTITUDE_TARGET":
            sent = (table["type_mask"] & 0x07) == 0
            rates = _stack(table, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")[sent]
            self._sent_response.add_pairs(*self._sent_rates.commands(times[sent], rates))
        known = MESSAGES.get(name)
        columns = known(table) if known else {}
        for key, values in columns.items():
            self.line(f"{source}:{key}", times, values)
        if "volts" in columns and "amperes" in columns:
            self._energy(source, times, columns["volts"] * columns["amperes"])

    def _energy(self, source: str, times: Floats, watts: Floats) -> None:
        """By the trapezoidal rule, without silences and what was not measured."""
        if source in self._power:
            before = self._power[source]
            times, watts = np.concatenate((before[0], times)), np.concatenate((before[1], watts))
        self._power[source] = times[-1:], watts[-1:]
        seconds = np.diff(times)
        joules = np.where(seconds < _SILENCE_S, 0.5 * (watts[1:] + watts[:-1]) * seconds, 0.0)
        if np.isfinite(joules).any():
            self.energy_wh[source] = self.energy_wh.get(source, 0.0) + float(np.nansum(joules)) / 3600.0

    def _heartbeat(self, sender: str, times: Floats, table: Table) -> None:
        flown = table["autopilot"] != _INVALID_AUTOPILOT
        times, table = times[flown], table[flown]
        if not len(table):
            return
        for autopilot, mode in {(int(row["autopilot"]), int(row["custom_mode"])) for row in table}:
            if autopilot == dialect.MAV_AUTOPILOT_PX4:
                self._bytewise.add(sender)
            firmware = firmware_of(autopilot)
            self.mode_names[mode] = firmware.mode_of(mode).value if firmware else f"mode {mode}"
        self.modes.setdefault(sender, Stretches()).add(times, table["custom_mode"].astype(np.int64))
        self.armed.setdefault(sender, Stretches()).add(times, (table["base_mode"] & _ARMED).astype(np.int64) // _ARMED)
        critical = np.isin(table["system_status"], (5, 6))
        self.critical.setdefault(sender, Stretches()).add(times, critical.astype(np.int64))

    def _rings(self, sender: str, times: Floats, table: Table) -> None:
        ring = self.rings.setdefault(sender, Ring())
        distances = table["distances"].astype(np.float64)
        ranges = np.where(distances <= table["max_distance"][:, None], distances * 0.01, np.nan)
        for at, row in zip(times.tolist(), ranges, strict=True):
            ring.rings.add(at, row)
        last = table[-1]
        ring.increment_deg = float(last["increment_f"]) or float(last["increment"])
        ring.offset_deg = float(last["angle_offset"])
        with np.errstate(all="ignore"):
            self.line(f"{sender}/OBSTACLE_DISTANCE:nearest", times, np.fmin.reduce(ranges, axis=1))

    def _global_position(self, sender: str, times: Floats, table: Table) -> None:
        """As metres north and east of the first fix, on the sphere that touches there."""
        fixed = (table["lat"] != 0) | (table["lon"] != 0)
        times, table = times[fixed], table[fixed]
        if not len(table):
            return
        north, east = np.radians(table["lat"] * 1e-7) * 6371000.0, np.radians(table["lon"] * 1e-7) * 6371000.0
        home = self._home.setdefault(sender, (float(north[0]), float(east[0])))
        scale = np.cos(home[0] / 6371000.0)
        rows = np.column_stack((north - home[0], (east - home[1]) * scale, table["relative_alt"] * -1e-3))
        self.paths.setdefault(f"{sender} global", Track(4)).add(times, rows)

    def _position_jumps(self, sender: str, times: Floats, table: Table) -> None:
        joined = self._continued(f"{sender}/position", table)
        seconds = np.diff(joined["time_boot_ms"].astype(np.float64)) * 1e-3
        places = np.column_stack((joined["x"], joined["y"], joined["z"])).astype(np.float64)
        speeds = np.column_stack((joined["vx"], joined["vy"], joined["vz"])).astype(np.float64)
        left = np.diff(places, axis=0) - 0.5 * (speeds[1:] + speeds[:-1]) * seconds[:, None]
        # What an acceleration of 10 m/s2 that is not seen in between could make, and noise.
        limit = 0.3 + 10.0 * seconds**2
        worst = self.position_jumps.setdefault(sender, Worst())
        worst.add(times[len(times) - len(left) :], np.linalg.norm(left, axis=1), limit)

    def _attitude_jumps(self, sender: str, times: Floats, table: Table) -> None:
        joined = self._continued(f"{sender}/attitude", table)
        seconds = np.diff(joined["time_boot_ms"].astype(np.float64)) * 1e-3
        q = np.column_stack([joined[name] for name in ("q1", "q2", "q3", "q4")]).astype(np.float64)
        angle = 2.0 * np.arccos(np.abs((q[1:] * q[:-1]).sum(axis=1)).clip(max=1.0))
        rates = np.column_stack([joined[name] for name in ("rollspeed", "pitchspeed", "yawspeed")]).astype(np.float64)
        turned = 0.5 * (np.linalg.norm(rates[1:], axis=1) + np.linalg.norm(rates[:-1], axis=1)) * seconds
        worst = self.attitude_jumps.setdefault(sender, Worst())
        worst.add(times[len(times) - len(angle) :], np.abs(angle - turned), 0.1 + 20.0 * seconds**2)

    # ------------------------------------------------------------------------------------------------- asked later

    @property
    def vehicle(self) -> str:
        """ "sys/comp" of the autopilot that is reported on; empty if there is none."""
        counts: dict[str, int] = {}
        for topic, clock in self.clocks.items():
            parts = topic.split("/")
            if len(parts) == 5 and parts[1] == "mavlink" and f"{parts[2]}/{parts[3]}" in self.modes:
                counts[f"{parts[2]}/{parts[3]}"] = counts.get(f"{parts[2]}/{parts[3]}", 0) + clock.count
        return max(counts, key=lambda sender: counts[sender], default="")

    @property
    def parameters(self) -> dict[str, float]:
        """The vehicle's, as it told them last; PX4 sends an integer's bits, ArduPilot its value."""
        return {
            name: _integer(value, _INTEGERS[kind]) if kind in _INTEGERS and sender in self._bytewise else value
            for name, (sender, value, kind) in self._parameters.items()
        }

    @property
    def rates(self) -> Spectrum | None:
        """Of the body rates, from what tells them most often; None where nothing does."""
        own = [self._vehicle_rates.get(f"{self.vehicle}/{name}") for name in ("ATTITUDE_QUATERNION", "ATTITUDE")]
        return _fastest(self._rates, *own)

    @property
    def torques(self) -> Spectrum | None:
        """Of the torque commands."""
        return _fastest(self._torques, self._sent_torques)

    @property
    def response(self) -> Response | None:
        """Of the body rates to the rate commands."""
        return _fastest(self._response, self._sent_response)

    def latency_quantile(self, share: float) -> float | None:
        """us, to 12 %; None where nothing was measured."""
        total = int(self.latency_counts.sum())
        if not total:
            return None
        return float(10 ** ((int(np.searchsorted(np.cumsum(self.latency_counts), share * total)) + 0.5) / 20.0))


def _integer(value: float, form: str) -> int:
    """What a float's bits are as an integer."""
    (whole,) = struct.unpack_from(form, struct.pack("<f", value))
    return int(whole)


S = TypeVar("S", bound=Segments)


def _fastest(*found: S | None) -> S | None:
    """The one that was sampled most often."""
    known = [each for each in found if each is not None and each.segments]
    return min(known, key=lambda each: each.step, default=None)


def _latencies(times: Floats, table: Any) -> tuple[Floats, Floats]:
    """When commands left and after how long (us); those of one record evenly over the time since the one before."""
    if not isinstance(table, list):  # an older log: one a record
        return times, table["latency_ns"] * 1e-3
    counts = np.array([len(row["latency_ns"]) for row in table])
    since = np.diff(times, prepend=times[0] - 0.1).clip(max=0.1)
    late = [(np.arange(count) + 1 - count) / max(count, 1) for count in counts]
    when = np.repeat(times, counts) + np.hstack(late) * np.repeat(since, counts)
    return when, np.hstack([row["latency_ns"] for row in table]) * 1e-3


def settings_of(log: LogReader) -> Settings:
    """As they were flown; the defaults where the log has none that this version reads."""
    try:
        tables = msgspec.json.decode(log.attachments.get("settings.json", b"{}"), type=dict[str, Any])
        return recorded_settings(tables, "settings.json")
    except (msgspec.MsgspecError, TomlFileError):
        return Settings()


def batches(log: LogReader) -> Iterator[Batch]:
    """All topics but the raw datagrams; what is not as its schema says is left out."""
    times: dict[str, list[int]] = {}
    parts: dict[str, list[bytes]] = {}
    kinds = log.topics
    wanted = frozenset(kinds) - {DATAGRAM.topic}
    for record in log.records(wanted):
        topic = record.topic
        try:
            held = parts[topic]
        except KeyError:
            held, times[topic] = parts.setdefault(topic, []), []
        held.append(record.data)
        times[topic].append(record.time_ns)
        if len(held) >= BATCH:
            yield from batch(kinds[topic], times[topic], held)
            parts[topic], times[topic] = [], []
    for topic, held in parts.items():
        yield from batch(kinds[topic], times[topic], held)


def batch(kind: RecordType, times: list[int], held: list[bytes]) -> Iterator[Batch]:
    """Records of one topic as one batch, or none if none of them is as the schema says."""
    size = kind.size
    if size is None:
        values = [_unpacked(kind, data) for data in held]
        kept = [(at, value) for at, value in zip(times, values, strict=True) if value is not None]
        if kept:
            yield kind.topic, kind, np.array([at for at, _ in kept], np.int64), [value for _, value in kept]
        return
    if any(len(data) != size for data in held):
        whole = [(at, data) for at, data in zip(times, held, strict=True) if len(data) == size]
        times, held = [at for at, _ in whole], [data for _, data in whole]
    if held:
        yield kind.topic, kind, np.array(times, np.int64), np.frombuffer(b"".join(held), kind.dtype)


def _unpacked(kind: RecordType, data: bytes) -> dict[str, Any] | None:
    try:
        return kind.unpack(data)
    except struct.error:
        return None


def euler_deg(attitude: NDArray[Any]) -> Floats:
    """(n, 4) quaternions w,x,y,z -> (n, 3) roll, pitch, yaw (deg), Z-Y-X; `protocol.frames.to_euler` for many."""
    w, x, y, z = (attitude[:, index].astype(np.float64) for index in range(4))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin((2.0 * (w * y - z * x)).clip(-1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    angles: Floats = np.degrees(np.column_stack((roll, pitch, yaw)))
    return angles


def tilt_deg(euler: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw (deg) -> (n,) the angle between the body's down axis and the world's (deg)."""
    roll, pitch = np.radians(euler[:, :2]).T
    angles: Floats = np.degrees(np.arccos((np.cos(roll) * np.cos(pitch)).clip(-1.0, 1.0)))
    return angles


# -------------------------------------------------------------------------------------------------- fields of messages


def _stack(table: Table, *names: str) -> Floats:
    return np.column_stack([table[name].astype(np.float64) for name in names])


def _attitude(table: Table) -> Columns:
    euler = np.degrees(_stack(table, "roll", "pitch", "yaw"))
    return {
        "euler_deg": euler,
        "tilt_deg": tilt_deg(euler),
        "rates_deg": np.degrees(_stack(table, "rollspeed", "pitchspeed", "yawspeed")),
    }


def _attitude_quaternion(table: Table) -> Columns:
    euler = euler_deg(_stack(table, "q1", "q2", "q3", "q4"))
    return {
        "euler_deg": euler,
        "tilt_deg": tilt_deg(euler),
        "rates_deg": np.degrees(_stack(table, "rollspeed", "pitchspeed", "yawspeed")),
    }


def _attitude_target(table: Table) -> Columns:
    rates = _stack(table, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")
    mask = table["type_mask"]
    attitude = np.where(((mask & 0x80) != 0)[:, None], np.nan, euler_deg(table["q"]))
    return {
        "euler_deg": attitude,
        "rates_deg": np.where(((mask & 0x07) != 0)[:, None], np.nan, np.degrees(rates)),
        "thrust": table["thrust"].astype(np.float64),
    }


def _local_position(table: Table) -> Columns:
    velocity = _stack(table, "vx", "vy", "vz")
    return {
        "position_ned": _stack(table, "x", "y", "z"),
        "height": -table["z"].astype(np.float64),
        "velocity_ned": velocity,
        "speed": np.linalg.norm(velocity, axis=1),
    }


def _global(table: Table) -> Columns:
    velocity = _stack(table, "vx", "vy", "vz") * 0.01
    return {
        "height": table["relative_alt"] * 1e-3,
        "velocity_ned": velocity,
        "speed": np.linalg.norm(velocity, axis=1),
    }


def _battery(table: Table) -> Columns:
    volts = np.where(table["voltages"] == 65535, 0, table["voltages"]).sum(axis=1) * 1e-3
    return {
        "volts": np.where(volts > 0.0, volts, np.nan),
        "amperes": np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 0.01),
        "remaining": np.where(table["battery_remaining"] < 0, np.nan, table["battery_remaining"]).astype(np.float64),
    }


def _system(table: Table) -> Columns:
    volts = table["voltage_battery"]
    remaining = table["battery_remaining"]
    return {
        "volts": np.where((volts == 65535) | (volts == 0), np.nan, volts * 1e-3),
        "amperes": np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 0.01),
        "remaining": np.where(remaining < 0, np.nan, remaining).astype(np.float64),
        "load": table["load"] * 0.1,
    }


def _servos(table: Table) -> Columns:
    outputs = _stack(table, *(f"servo{number}_raw" for number in range(1, 9)))
    return {"outputs": np.where(outputs == 0.0, np.nan, outputs)}


def _positions_wanted(table: Table) -> Columns:
    places = _stack(table, "x", "y", "z")
    unset = ((table["type_mask"] & 0x07) != 0)[:, None]
    places = np.where(unset, np.nan, places)
    speeds = np.where(((table["type_mask"] & 0x38) != 0)[:, None], np.nan, _stack(table, "vx", "vy", "vz"))
    return {"position_ned": places, "height": -places[:, 2], "velocity_ned": speeds}


def _satellites(table: Table) -> Columns:
    return {
        "satellites": np.where(table["satellites_visible"] == 255, np.nan, table["satellites_visible"]),
        "fix": table["fix_type"].astype(np.float64),
    }


def _vibration(table: Table) -> Columns:
    clips = _stack(table, "clipping_0", "clipping_1", "clipping_2").sum(axis=1)
    return {"vibration": _stack(table, "vibration_x", "vibration_y", "vibration_z"), "clips": clips}


def _fields(*names: str) -> Callable[[Table], Columns]:
    return lambda table: {name: table[name].astype(np.float64) for name in names}


MESSAGES: dict[str, Callable[[Table], Columns]] = {
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "ATTITUDE_TARGET": _attitude_target,
    "SET_ATTITUDE_TARGET": _attitude_target,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global,
    "POSITION_TARGET_LOCAL_NED": _positions_wanted,
    "VFR_HUD": _fields("airspeed", "groundspeed", "throttle", "climb"),
    "SERVO_OUTPUT_RAW": _servos,
    "BATTERY_STATUS": _battery,
    "SYS_STATUS": _system,
    "GPS_RAW_INT": _satellites,
    "VIBRATION": _vibration,
    "EKF_STATUS_REPORT": _fields(
        "velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "flags"
    ),
    "ESTIMATOR_STATUS": _fields("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio", "flags"),
    "RADIO_STATUS": _fields("rssi", "remrssi", "noise"),
}
"""What is drawn of a message, by what it is; SI and degrees."""
