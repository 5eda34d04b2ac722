"""A rehearsal: the whole mission against canned telemetry, so that nothing is compiled or met for the first time in
flight."""

import math

import msgspec

from companion.autopilot import Autopilot, Datagram, Planned, Tick
from companion.config import AvoidanceAltitudeSearch, Settings
from companion.mission.plan import Mission
from companion.runtime.planning import InProcessPlanner, Planning
from companion.state import Output
from companion.supervision.supervisor import State
from companion.trace import Thinning
from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import VehicleParameters

_TICK_NS = 4_000_000
_LONGEST_TICKS = 50_000
_ON_THE_WAY_TICKS = 250
"""So long it is still short of the first waypoint, with obstacles before it; then it is there."""
_ON_OTHER_WAYS_TICKS = 50
_RINGS, _RINGS_WITH_A_THING = 16, 14
"""Of so many rings so many show something; it turns with the vehicle, long enough to be seen to move."""
_REHEARSED_LAPS = 0.1
_REHEARSED_RAMP_S = 0.2
_REHEARSED_REACH = 3.0
_OFFBOARD = 6 << 16
_LANDING = 4 << 16 | 6 << 24


class RehearsalError(Exception):
    """The autopilot does not get through its own mission on perfect telemetry."""


def rehearse(settings: Settings, body: VehicleParameters, mission: Mission, output: Output) -> None:
    """Fly a vehicle that is always where it should be. Raises RehearsalError if that does not lead to the end."""
    if settings.avoidance.mapped and settings.avoidance.method != "vfh":  # which is asked where the others find nothing
        avoidance = msgspec.structs.replace(settings.avoidance, method="vfh")
        _fly(msgspec.structs.replace(settings, avoidance=avoidance), body, mission, output)
    _fly(settings, body, mission, output)


def _fly(settings: Settings, body: VehicleParameters, mission: Mission, output: Output) -> None:
    # At the route's heights, where the vehicle here is.
    avoidance = msgspec.structs.replace(settings.avoidance, heights=AvoidanceAltitudeSearch())
    autopilot = Autopilot(msgspec.structs.replace(settings, avoidance=avoidance), body, _hurried(mission), output)
    planning = Planning(InProcessPlanner(settings.avoidance), settings.avoidance.answer_delay)
    thinning = Thinning(settings.log.trace_rate)
    encoder = Encoder(1, 1)
    step, step_began, on_the_way = -1, 0, 0
    rings = ([300] * 4 + [1501] * 68, [1501] * 72)

    def send(message: type, *fields: object) -> bytes:
        return encoder.encode_fields(message, *fields)

    for tick in range(1, _LONGEST_TICKS):
        now = tick * _TICK_NS
        state = autopilot.supervisor.state
        armed = state >= State.ARM and state is not State.LAND
        mode = _LANDING if state is State.LAND else _OFFBOARD if state >= State.ENGAGE else 3 << 16
        place = [0.0, 0.0, 0.0]
        if state is State.FLY and autopilot.steps:
            if autopilot.step_index != step:
                step, step_began = autopilot.step_index, tick
                on_the_way = _ON_THE_WAY_TICKS if step == 1 else _ON_OTHER_WAYS_TICKS
            target = autopilot.steps[step].target_ned
            place = target.tolist() if target is not None else place
            if tick - step_began < on_the_way:
                place[0] -= 12.0
        north, east, down = place
        yaw = 0.5 * math.sin(tick * 0.01)
        # As a vehicle sends it before it was asked for the quaternion.
        data = send(dialect.MAVLink_attitude_message, tick * 4, 0.0, 0.0, yaw, 0.0, 0.0, 0.0) if tick <= 16 else b""
        data += send(
            dialect.MAVLink_attitude_quaternion_message,
            tick * 4,
            math.cos(yaw / 2),
            0.0,
            0.0,
            math.sin(yaw / 2),
            0.0,
            0.0,
            0.0,
        )
        data += send(dialect.MAVLink_local_position_ned_message, tick * 4, north, east, down, 0.1, 0.0, 0.0)
        if tick % 16 == 1:
            sensor = (tick * 4, 20, 1500, 300, 0, 10, 0, 0, 0.0, 0.0, (0.0,) * 4, 0)
            data += send(dialect.MAVLink_distance_sensor_message, *sensor)
            ring = rings[tick // 16 % _RINGS >= _RINGS_WITH_A_THING]
            data += send(dialect.MAVLink_obstacle_distance_message, tick * 4000, 0, ring, 5, 20, 1500, 5.0, 0.0, 12)
            flies = dialect.MAV_LANDED_STATE_IN_AIR if state is State.FLY else dialect.MAV_LANDED_STATE_ON_GROUND
            data += send(dialect.MAVLink_extended_sys_state_message, 0, flies)
            base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
            data += send(dialect.MAVLink_heartbeat_message, 2, dialect.MAV_AUTOPILOT_PX4, base, mode, 4, 3)
            data += send(
                dialect.MAVLink_autopilot_version_message, 0xFFFFFFFF, 0x010D00FF, 0, 0, 0, *_NO_HASHES, 0, 0, 0
            )
            data += send(dialect.MAVLink_command_ack_message, dialect.MAV_CMD_DO_GRIPPER, 0)
            data += send(dialect.MAVLink_timesync_message, 0, now)
            data += send(dialect.MAVLink_timesync_message, now, now)
            data += send(dialect.MAVLink_sys_status_message, *[0] * 13)
            data += send(dialect.MAVLink_statustext_message, dialect.MAV_SEVERITY_INFO, b"rehearsal")
        trace = autopilot.handle(Datagram(now, data)).trace
        if trace is not None:
            thinning.step(now, trace)
        while (answer := planning.due(now)) is not None:
            autopilot.handle(Planned(now, answer))
        question = autopilot.handle(Tick(now)).question
        if question is not None:
            planning.ask(question)
        if autopilot.ended:
            break
    if autopilot.supervisor.fault is not None or not autopilot.ended:
        reason = autopilot.supervisor.fault or f"it does not get past {autopilot.supervisor.state.name}"
        raise RehearsalError(f"the rehearsal of {mission.name} fails: {reason}")


def _hurried(mission: Mission) -> Mission:
    """The same with short holds and short curves."""
    waypoints = [msgspec.structs.replace(waypoint, hold_s=min(waypoint.hold_s, 0.1)) for waypoint in mission.waypoints]
    shape = mission.trajectory
    if shape is not None:
        laps, ramp_s = min(shape.laps, _REHEARSED_LAPS), min(shape.ramp_s, _REHEARSED_RAMP_S)
        shape = msgspec.structs.replace(shape, laps=laps, ramp_s=ramp_s)
    if mission.profile == "minimum_snap":
        reach = max(math.hypot(waypoint.north, waypoint.east) for waypoint in waypoints)
        scale = _REHEARSED_REACH / max(reach, _REHEARSED_REACH)
        waypoints = [
            msgspec.structs.replace(waypoint, north=scale * waypoint.north, east=scale * waypoint.east)
            for waypoint in waypoints
        ]
    return msgspec.structs.replace(mission, waypoints=waypoints, trajectory=shape)


_NO_HASHES = ([0] * 8, [0] * 8, [0] * 8)
