"""Logs with known contents, written by the recorder as a flight's are."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.mission.plan import Phase
from companion.records import LOGGED, LOOP, PLANNED, RECORD_TYPES, TICK, TRACE
from companion.supervision.states import State
from companion.trace import Thinning
from protocol.flightlog import Direction, FlightLog
from protocol.messages import Encoder, dialect
from protocol.toml_files import ROOT

STEP_NS = 4_000_000
VEHICLE = "127.0.0.1:14580"
SPEED = 2.0
SHAKE_HZ = 40.0
WORLD = (ROOT / "worlds" / "neighbourhood.toml").read_bytes()

Values = dict[str, object]


def trace_values(time: float) -> Values:
    """Flying north at SPEED, 0.1 m behind the reference, 3 m high, shaking a little about the roll axis."""
    return {
        "state": State.FLY.value,
        "phase": Phase.ROUTE.value if time < 10.0 else Phase.RETURN.value,
        "position_ned": (SPEED * time, 0.0, -3.0),
        "velocity_ned": (SPEED, 0.0, 0.0),
        "attitude_ned_frd": (1.0, 0.0, 0.0, 0.0),
        "rates_frd": (0.05 * math.sin(2.0 * math.pi * SHAKE_HZ * time), 0.0, 0.0),
        "reference_position_ned": (SPEED * time + 0.1, 0.0, -3.0),
        "reference_velocity_ned": (SPEED, 0.0, 0.0),
        "attitude_command_ned_frd": (1.0, 0.0, 0.0, 0.0),
        "thrust_command": 0.4,
        "clearance": 5.0,
        "speed_limit": 4.0,
    }


def packed(values: Mapping[str, object]) -> bytes:
    """A step's trace; fields that are not given are zero."""
    record = np.zeros(1, TRACE.dtype)
    for name, value in values.items():
        record[name] = value
    return record.tobytes()


def make(
    folder: Path,
    seconds: float = 20.0,
    *,
    change: Callable[[float, Values], None] | None = None,
    late_ms: Mapping[int, float] | None = None,
    silent: tuple[float, float] = (0.0, 0.0),
    jump_at: float = math.inf,
    result: Mapping[str, str] | None = None,
    trace_rate: float = 250.0,
    motion_every: int = 5,
    traced: float = math.inf,
    planned: Callable[[float], Sequence[tuple[float, float]]] | None = None,
    settings: bytes = b"{}",
) -> Path:
    """A log of `seconds`, 250 control steps in each, with the vehicle's telemetry beside them.

    The log keeps `trace_rate` (Hz) of the trace, which ends at `traced`. `change` may edit each step's; the vehicle
    tells its motion each `motion_every` steps; `late_ms` by number of the step; the vehicle is silent between two times
    and its position is 1.5 m off from `jump_at` on. `planned` tells the corners of the way that is planned at a time.
    """
    vehicle, thinning = Encoder(1, 1), Thinning(trace_rate)
    log = FlightLog.open(
        folder,
        metadata={"flight": {"mission": "made", "output": "rates", "pace": "lockstep", "seed": "1"}},
        attachments={"world.toml": WORLD, "settings.json": settings},
        types=RECORD_TYPES,
        on_full="wait",
        console=False,
    )
    for step in range(round(seconds * 250)):
        time_ns = step * STEP_NS
        time = time_ns * 1e-9
        log.record(TICK, time_ns, TICK.pack(round(1e6 * (late_ms or {}).get(step, 0.0))))
        values = trace_values(time)
        if change is not None:
            change(time, values)
        if not silent[0] <= time < silent[1]:
            north = SPEED * time + (1.5 if time >= jump_at else 0.0)
            said = telemetry(vehicle, step, north, values["rates_frd"], motion_every)
            log.datagram(time_ns, Direction.IN, VEHICLE, said)
        for at_ns, record in thinning.step(time_ns, packed(values)) if time < traced else ():
            log.record(LOGGED, at_ns, record)
        if planned is not None and step % 16 == 0:
            log.record(PLANNED, time_ns, plan(step, planned(time)))
        if step % 25 == 24:
            log.record(LOOP, time_ns, LOOP.pack(200_000, [200_000] * 25))
    for at_ns, record in thinning.rest():
        log.record(LOGGED, at_ns, record)
    log.text(0, 20, "companion", "armed, taking off")
    log.close({"result": dict(result or {"delivered": "True", "landed": "True", "fault": "", "messages_lost": "0"})})
    return log.path


def plan(number: int, corners: Sequence[tuple[float, float]]) -> bytes:
    """A record of PLANNED."""
    record = np.zeros(1, PLANNED.dtype)
    record["number"], record["corners"] = number, len(corners)
    record["way_ned"][0, : 2 * len(corners)] = np.ravel(corners)
    return record.tobytes()


def telemetry(
    vehicle: Encoder, step: int, north: float, rates_frd: Any = (0.0, 0.0, 0.0), motion_every: int = 5
) -> bytes:
    """What the vehicle says at a step: its motion every `motion_every` steps, a scan 10 times a second, a heartbeat
    once a second."""
    boot_ms = step * 4
    frames = []
    if step % motion_every == 0:
        place = (boot_ms, north, 0.0, -3.0, SPEED, 0.0, 0.0)
        frames.append(vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, *place))
        attitude = (boot_ms, 1.0, 0.0, 0.0, 0.0, *rates_frd)
        frames.append(vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, *attitude))
    if step % 25 == 0:
        distances = [501] * 72
        distances[9] = 300  # 45 degrees to the right
        scan = (boot_ms * 1000, 0, distances, 5, 20, 500, 5.0, 0.0, dialect.MAV_FRAME_BODY_FRD)
        frames.append(vehicle.encode_fields(dialect.MAVLink_obstacle_distance_message, *scan))
    if step % 250 == 0:
        offboard = 6 << 16
        beat = (dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_PX4, 0x80 | 0x01, offboard, 4, 3)
        frames.append(vehicle.encode_fields(dialect.MAVLink_heartbeat_message, *beat))
    return b"".join(frames)


def from_tlog(source: Path, folder: Path) -> Path:
    """Another system's telemetry log as a flight log: its stamps, its frames, no trace."""
    data = source.read_bytes()
    first = int.from_bytes(data[:8], "big")
    log = FlightLog.open(
        folder, metadata={}, attachments={}, types=(), on_full="wait", console=False, epoch_ns=first * 1000
    )
    at = 0
    while at < len(data):
        end = at + 8 + 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        time_ns = (int.from_bytes(data[at : at + 8], "big") - first) * 1000
        direction = Direction.OUT if data[at + 14] == 191 else Direction.IN
        log.datagram(time_ns, direction, "", data[at + 8 : end])
        at = end
    log.close()
    return log.path
