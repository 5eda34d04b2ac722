"""What can be known before any vehicle is there: limits, gains and mission with which no flight can work."""

import math
from typing import Any

import msgspec
import numpy as np

from companion.config import STEEPEST_DEG, Limits, Settings
from companion.config_avoidance import Avoidance
from companion.control.parameters import kept_tilt
from companion.control.stability import unstable
from companion.curves import Route, Shape
from companion.mission.plan import Mission, steps
from companion.state import Output
from companion.trajectory.minimum_snap import rest_to_rest_durations
from companion.trajectory.track import track_of
from protocol.vehicle_parameters import GRAVITY, VehicleParameters

_TURNS = 2.0
"""1/s; the rate of roll and pitch by the tilt, at least. With 1.33 and 45 degrees a vehicle swings, with 1.55 not."""
_TO_SINK = 0.9
"""Share of the thrust in hover that surely lets a vehicle sink, whose weight and thrust are known so well."""
_PLACES = 360
"""On a lap of a shape, at which its acceleration is looked at."""
_LONGEST_CURVE = 3.0
"""Times as long as its legs from rest to rest a curve may take. Usual ones take 0.7 to 1.9 times as long."""
_BY_INFLATION = "astar", "rrt"
"""The methods whose paths keep the distances of [avoidance.plan]."""


class PlanError(Exception):
    """Settings, mission and vehicle do not go together."""


def _hover_thrust(body: VehicleParameters) -> float:
    """With the parcel."""
    return body.hover_thrust * (body.mass_kg + body.parcel_mass_kg) / body.mass_kg


def feasible(settings: Settings, body: VehicleParameters, mission: Mission, output: Output | None) -> None:
    """Raises PlanError for what no flight can work with; `output`: None, if the vehicle's parameters will choose it."""
    limits = settings.limits
    empty, parcel = body.hover_thrust, " once its parcel is gone" if body.parcel_mass_kg else ""
    hover = _hover_thrust(body)
    if hover >= limits.highest_thrust:
        raise PlanError(f"limits.highest_thrust {limits.highest_thrust:g}: the vehicle hovers at {hover:.2f}")
    if limits.lowest_thrust > _TO_SINK * empty:
        raise PlanError(
            f"limits.lowest_thrust {limits.lowest_thrust:g}: the vehicle hovers at {empty:.2f}{parcel}, and sinks with "
            f"{_TO_SINK * empty:.2f} or less"
        )
    if mission.trajectory is not None and mission.trajectory.shape == "loop":
        _check_loop(settings, body, mission.trajectory)
    if limits.tilt_deg > STEEPEST_DEG and output in (None, Output.ATTITUDE):
        raise PlanError(f"limits.tilt_deg {limits.tilt_deg:g}: choose --output rates or actuators")
    heights, avoidance = [each.height for each in mission.waypoints], settings.avoidance
    if avoidance.needs_scan and heights and avoidance.ground_height >= max(heights):
        raise PlanError(
            f"avoidance.ground_height {avoidance.ground_height:g}: what is below counts as ground, and the route is "
            f"no higher than {max(heights):g} m: no obstacle would be seen"
        )
    _check_turning(limits, output)
    _check_timeouts(settings)
    _check_distances(avoidance)


def check_gains(settings: Settings, body: VehicleParameters, output: Output | None) -> None:
    """Raises PlanError for gains that no flight can work with. It runs compiled code."""
    for each in (Output.ATTITUDE, Output.RATES) if output is None else (output,):
        swings = unstable(settings, body, each)
        if swings is not None:
            law = settings.control.position.law
            loops = f"rate_loop_gain_1_s {body.rate_loop_gain_1_s[0]:g}, {body.rate_loop_gain_1_s[1]:g}"
            raise PlanError(
                f"control.position, control.attitude: with these gains of {law} and lqr no vehicle of this [body] "
                f"(rotor_time_constant_s {body.rotor_time_constant_s:g}, {loops}, attitude_loop_gain_1_s "
                f"{body.attitude_loop_gain_1_s:g}, mass and inertia) flies on output {each.value}: {swings}; take "
                "softer ones of the position or faster ones of the attitude"
            )


def _check_turning(limits: Limits, output: Output | None) -> None:
    """On rates a vehicle that turns more slowly swings from one limit of its tilt to the other for good."""
    least = _TURNS * limits.tilt_deg
    if limits.roll_pitch_rate_deg < least and limits.tilt_deg <= STEEPEST_DEG and output in (None, Output.RATES):
        raise PlanError(
            f"limits.roll_pitch_rate_deg {limits.roll_pitch_rate_deg:g}: on output rates at least {least:g}, as "
            f"limits.tilt_deg is {limits.tilt_deg:g}"
        )


def _check_timeouts(settings: Settings) -> None:
    """What comes as seldom as it is asked for must not count as lost in between: the vehicle would hold each time."""
    streams, avoidance = {"attitude": "telemetry_timeout", "position": "telemetry_timeout"}, settings.avoidance
    if avoidance.needs_scan:
        streams["scan"] = "scan_timeout"
    for name, timeout in streams.items():
        rate, longest = getattr(settings.rates, name), getattr(settings.supervision, timeout)
        least, why = 1.0 / rate, f"rates.{name} is {rate:g} Hz"
        if name == "scan" and avoidance.looks_around:
            least += avoidance.answer_delay
            why += f" and avoidance.answer_delay {avoidance.answer_delay:g} s"
        if least >= longest:
            raise PlanError(f"supervision.{timeout} {longest:g}: must be above {least:g} s, as {why}")


def _check_distances(avoidance: Avoidance) -> None:
    """The hull must not meet what is passed, and a way must lead past it."""
    kept = dict[str, float]()
    if avoidance.mapped:
        kept["plan.tight_inflation"] = avoidance.plan.tight_inflation
        kept["vfh.enlargement_radius"] = avoidance.vfh.enlargement_radius
    if avoidance.guarded:
        names = ("keep_out", "keep_out_unseen", "keep_out_tight", "keep_out_unseen_tight", "keep_out_moving")
        kept |= {f"guard.{name}": getattr(avoidance.guard, name) for name in names}
    radius = avoidance.vehicle_radius
    if least := [f"avoidance.{key} {value:g}" for key, value in kept.items() if value < radius]:
        raise PlanError(f"{', '.join(least)}: less than avoidance.vehicle_radius {radius:g}")
    plan, kept_by_guard = avoidance.plan, avoidance.guard.keep_out
    if avoidance.guarded and avoidance.method in _BY_INFLATION and kept_by_guard > plan.proximity_radius:
        raise PlanError(
            f"avoidance.guard.keep_out {kept_by_guard:g}: paths keep avoidance.plan.inflation {plan.inflation:g} from "
            f"obstacles, and no more than avoidance.plan.proximity_radius {plan.proximity_radius:g} where there is "
            "room: the guard would stop the vehicle on its way"
        )
    room = radius + avoidance.safe_distance
    if avoidance.method == "paper" and avoidance.lateral_margin <= room:
        raise PlanError(
            f"avoidance.lateral_margin {avoidance.lateral_margin:g}: not above vehicle_radius and safe_distance, "
            f"{room:g} in all: the way past an obstacle would be blocked by it"
        )
    if avoidance.vfh.low_threshold > avoidance.vfh.high_threshold:
        raise PlanError(
            f"avoidance.vfh.low_threshold {avoidance.vfh.low_threshold:g}: above high_threshold "
            f"{avoidance.vfh.high_threshold:g}"
        )


def within_reach(settings: Settings, body: VehicleParameters) -> tuple[Settings, str]:
    """Settings with no harder accelerations than the limits of tilt and thrust allow, and what that changed, in words:
    speeds before obstacles and goals are chosen by them."""
    limits, avoidance, replace = settings.limits, settings.avoidance, msgspec.structs.replace
    most = _most_acceleration(limits, body)

    def softened(table: Any, *names: str) -> Any:
        return replace(table, **{name: min(getattr(table, name), most) for name in names})

    trajectory = softened(settings.trajectory, "acceleration")
    softer = softened(avoidance, "braking_acceleration") if avoidance.needs_scan else avoidance
    if avoidance.mapped:
        softer = replace(softer, course=softened(avoidance.course, "acceleration", "braking"))
    if avoidance.looks_around:
        softer = replace(softer, guard=softened(avoidance.guard, "braking"))
    if trajectory == settings.trajectory and softer == avoidance:
        return settings, ""
    softer = replace(softer, guard=softened(softer.guard, "emergency_braking", "evasion"))
    note = (
        f"limits.tilt_deg {limits.tilt_deg:g} and limits.highest_thrust {limits.highest_thrust:g}: the vehicle "
        f"accelerates and brakes with {most:.1f} m/s2 at most, and flies routes as slowly as that needs"
    )
    return replace(settings, trajectory=trajectory, avoidance=softer), note


def out_of_reach(settings: Settings, body: VehicleParameters, mission: Mission) -> str:
    """In words, that the limits of tilt and thrust do not let the vehicle follow the mission's shape, which is flown as
    it is given; empty if they do, or if it has none. It runs compiled code."""
    shape, limits = mission.trajectory, settings.limits
    most = _most_acceleration(limits, body)
    if shape is None or math.isinf(most):
        return ""
    track = track_of(shape, settings.trajectory, limits.tilt)
    rate, lap = track.law.rate, 2.0 * math.pi
    needed = rate**2 * max(float(np.linalg.norm(track.path.at(lap * k / _PLACES)[2])) for k in range(_PLACES))
    if needed <= most:
        return ""
    return (
        f"limits.tilt_deg {limits.tilt_deg:g} and limits.highest_thrust {limits.highest_thrust:g}: the vehicle "
        f"accelerates with {most:.1f} m/s2 at most, and the {shape.shape} needs {needed:.1f} m/s2 at "
        f"{shape.speed:g} m/s: it leaves its path. Fly it more slowly or larger, or raise the limits"
    )


def check_curves(settings: Settings, mission: Mission) -> None:
    """Raises PlanError for waypoints through which no usable curve leads: beside a leg of kilometres one of millimetres
    makes the spline swing far beyond both."""
    tilt = settings.limits.tilt
    acceleration = min(settings.trajectory.acceleration, GRAVITY * math.tan(min(tilt, math.radians(STEEPEST_DEG))))
    for curve in (step.curve for step in steps(mission, np.zeros(3)) if isinstance(step.curve, Route)):
        expected_s = float(rest_to_rest_durations(curve.points_ned, curve.speed, acceleration).sum())
        try:
            with np.errstate(all="ignore"):
                usable = track_of(curve, settings.trajectory, tilt).duration_s < _LONGEST_CURVE * expected_s
        except ValueError:  # the system of equations has no solution in 64 bits
            usable = False
        if not usable:
            lengths = np.linalg.norm(np.diff(curve.points_ned, axis=0), axis=1)
            raise PlanError(
                'waypoints: the profile "minimum_snap" finds no usable curve through them: its shortest leg has '
                f"{lengths.min():.2g} m, its longest {lengths.max():.4g} m. Leave out what lies so near to the next one"
            )


def _most_acceleration(limits: Limits, body: VehicleParameters) -> float:
    """m/s2, level and without losing height; inf where the tilt has no limit."""
    hover = _hover_thrust(body)
    if limits.tilt_deg > STEEPEST_DEG or hover >= limits.highest_thrust:
        return math.inf
    tilt = limits.tilt if min(body.rate_loop_gain_1_s[:2]) > 0.0 else kept_tilt(limits)
    return GRAVITY * math.tan(min(tilt, math.acos(hover / limits.highest_thrust)))


def _check_loop(settings: Settings, body: VehicleParameters, loop: Shape) -> None:
    """At the bottom the thrust bears weight and centrifugal force, at the top it turns fastest."""
    limits = settings.limits
    if limits.tilt_deg <= STEEPEST_DEG:
        raise PlanError(f"limits.tilt_deg {limits.tilt_deg:g}: a loop needs 180")
    acceleration = loop.speed**2 / loop.size
    thrust = (body.mass_kg + body.parcel_mass_kg) * (acceleration + GRAVITY) / body.max_thrust_n
    if thrust > limits.highest_thrust:
        raise PlanError(f"limits.highest_thrust {limits.highest_thrust:g}: the loop needs {thrust:.2f}")
    turning_deg = math.degrees(loop.speed / loop.size * acceleration / (acceleration - GRAVITY))
    if turning_deg > limits.roll_pitch_rate_deg:
        raise PlanError(f"limits.roll_pitch_rate_deg {limits.roll_pitch_rate_deg:g}: the loop needs {turning_deg:.0f}")
