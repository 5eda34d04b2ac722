"""A vehicle file in `vehicles/`: its tables as records, and one flat record for compiled code."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from protocol.toml_files import TomlFileError, convert, find, floats, load, read
from protocol.vehicle_parameters import GRAVITY, NotNegative, Positive, VehicleParameters
from vehicle_sim.sensors.lidar import LidarSettings
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.timing import STEP_S

PERFECT = "perfect"
_SHORTEST_S = 0.5 * STEP_S
"""The least time constant: the integration over STEP_S is stable down to 0.36 of it."""

_LEAST, _MOST = 1e-15, 1e9
"""Sizes of numbers between which they can be computed with, and be told: no vehicle has any beyond."""

Axes = tuple[Positive, Positive, Positive]
Four = tuple[Positive, Positive, Positive, Positive]


class Rotors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[rotors]` table."""

    thrust_constant_ns2: Positive
    """kf: the thrust is kf speed^2, with the speed in rad/s."""
    inertia_kgm2: NotNegative
    """Jr: of one rotor with the bell of its motor, about its axis."""
    time_constant_up_s: Positive
    time_constant_down_s: Positive
    thrust_share: Four = (1.0, 1.0, 1.0, 1.0)
    """Thrust and torque of each rotor (front, right, back, left) as a share of those of a sound propeller."""
    lag_share: Four = (1.0, 1.0, 1.0, 1.0)
    """The time constants of each rotor, as a share of those above."""


class Unmodelled(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[unmodelled]` table: what the companion's model of the vehicle leaves out."""

    centre_of_mass_m: tuple[float, float] = (0.0, 0.0)
    """Ahead and to the right of the middle of the rotors. Feet and drag stay where they are."""
    quadratic_drag_kg_m: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Along each axis of the body, beside the linear drag: N for 1 m/s, growing with the square."""
    propeller_radius_m: NotNegative = 0.0
    """For the ground effect; 0: there is none."""
    imbalance_kg_m: NotNegative = 0.0
    """Imbalance of each propeller: mass times distance from its axis, which shakes the accelerometer."""


class Ground(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[ground]` table: four feet under the arms, each a spring and damper with dry friction."""

    foot_radius_m: Positive
    foot_height_m: Positive
    stiffness_n_m: Positive
    damping_ns_m: NotNegative
    friction: NotNegative
    crash_speed_m_s: Positive
    crash_tilt_deg: Positive


class Hull(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[hull]` table."""

    radius_m: Positive
    """The sphere about the centre of mass that must not touch an obstacle."""


class InnerLoop(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[inner_loop]` table: gains and limits of the attitude and rate laws, per axis of the body."""

    attitude_gain_1_s: Axes
    rate_gain_1_s: Axes
    rate_limit_deg_s: Axes


class Auto(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[auto]` table: how the vehicle flies by itself (take-off, hold, return, land)."""

    position_gain_1_s: Positive
    velocity_gain_1_s: Positive
    acceleration_limit_m_s2: Positive
    climb_acceleration_limit_m_s2: Positive
    cruise_speed_m_s: Positive
    climb_speed_m_s: Positive
    descent_speed_m_s: Positive
    land_speed_m_s: Positive
    takeoff_height_m: Positive
    return_height_m: Positive

    @property
    def speed_limits_m_s(self) -> tuple[float, float, float]:
        """Horizontal, up, down."""
        return self.cruise_speed_m_s, self.climb_speed_m_s, self.descent_speed_m_s


class TelemetrySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[telemetry]` table."""

    delay_s: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.0
    """Age of the estimate when it is sent, rounded up to whole ticks of 4 ms."""


class EstimatorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[estimator]` table."""

    sensors: str | None = None
    """perfect (it knows the truth), or a file: a name in vehicles/sensors/, or a path. None: what loads it chooses."""
    range_finder: bool = False
    """The filter uses the beam downward, too."""


class Battery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[battery]` table."""

    capacity_wh: Positive
    full_v: Positive
    empty_v: Positive
    efficiency: Annotated[float, msgspec.Meta(gt=0, le=1)]
    idle_w: NotNegative
    charge: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    """Share of a full battery at the start."""
    internal_resistance_ohm: NotNegative = 0.0
    drives_speed: bool = False
    """The rotors' speed falls with the voltage, as behind a controller that compensates nothing."""


class FenceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[fence]` table: what the vehicle's parameters say of its fence. The companion is to keep within it; the
    vehicle itself does nothing about it."""

    radius_m: NotNegative = 0.0
    """About home; 0: none."""
    max_height_m: NotNegative = 0.0
    """Above home; 0: none."""


class Airframe(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole vehicle file."""

    body: VehicleParameters
    rotors: Rotors
    ground: Ground
    hull: Hull
    inner_loop: InnerLoop
    auto: Auto
    lidar: LidarSettings
    battery: Battery
    telemetry: TelemetrySettings = TelemetrySettings()
    fence: FenceSettings = FenceSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    unmodelled: Unmodelled = Unmodelled()

    def sensors(self) -> SensorSettings | None:
        """What its estimator flies on; None is the truth. Raises TomlFileError."""
        name = self.estimator.sensors
        return None if name in (None, PERFECT) else load(find("vehicles/sensors", name), SensorSettings)

    @classmethod
    def load(cls, path: Path, overrides: Sequence[str] = (), sensors: str = PERFECT) -> "Airframe":
        """Read a vehicle file, with overrides as "body.mass_kg=0.9"; `sensors` are those of a file that names none.

        Raises TomlFileError, naming file and key, also for a vehicle that can't lift its parcel.
        """
        tables = read(path)
        if tables.keys() == {"body"}:
            raise TomlFileError(f"{path}: for the companion alone: it has a [body], and nothing else to simulate")
        airframe = convert(tables, cls, str(path), overrides)
        for key, problem in airframe._problems():
            raise TomlFileError(f"{path}: {key}: {problem}")
        if airframe.estimator.sensors is None:
            airframe = msgspec.structs.replace(
                airframe, estimator=msgspec.structs.replace(airframe.estimator, sensors=sensors)
            )
        airframe.sensors()
        return airframe

    def _problems(self) -> Iterator[tuple[str, str]]:
        """Each key whose value can't be flown, or can't be integrated in steps of STEP_S, and why."""
        for key, value in floats(msgspec.to_builtins(self)):
            if value and not _LEAST <= abs(value) <= _MOST:
                yield key, f"{value:g} is neither 0 nor of a size from {_LEAST:g} to {_MOST:g}"
        mass, rotors = self.takeoff_mass_kg, self.rotors
        if self.body.max_thrust_n <= mass * GRAVITY:
            yield "body.rotor_max_thrust_n", f"four of them can't lift {mass:g} kg"
        for key in ("time_constant_up_s", "time_constant_down_s"):
            shortest = getattr(rotors, key) * min(rotors.lag_share)
            if shortest < _SHORTEST_S:
                yield f"rotors.{key}", f"{shortest:g} s for a rotor is less than {_SHORTEST_S:g} s"
        drag, most_drag = max(self.body.drag_kg_s), self.body.mass_kg / _SHORTEST_S
        if drag > most_drag:
            yield "body.drag_kg_s", f"{drag:g} is more than {most_drag:g} for {self.body.mass_kg:g} kg"
        if self.rest_height_m <= 0.0:
            yield "ground.stiffness_n_m", f"{mass:g} kg sink by more than ground.foot_height_m"
        if self.battery.empty_v >= self.battery.full_v:
            yield "battery.empty_v", "not below battery.full_v"

    @property
    def takeoff_mass_kg(self) -> float:
        """Mass with the parcel."""
        return self.body.mass_kg + self.body.parcel_mass_kg

    @property
    def rest_height_m(self) -> float:
        """Height of the centre of mass above the ground, at rest with the parcel."""
        return self.ground.foot_height_m - self.takeoff_mass_kg * GRAVITY / (4.0 * self.ground.stiffness_n_m)


PARAMETERS = np.dtype(
    [
        ("wind_ned", "f8", 3),  # m/s; the first three change in flight
        ("force_ned", "f8", 3),  # N, beside thrust, drag, weight and ground
        ("mass_kg", "f8"),  # with the parcel
        ("arm_length_m", "f8"),
        ("inertia_kgm2", "f8", 3),
        ("rotor_max_thrust_n", "f8"),
        ("torque_per_thrust_m", "f8"),
        ("thrust_constant_ns2", "f8"),
        ("rotor_max_speed", "f8"),
        ("rotor_running", "f8", 4),  # 1: as commanded, 0: a motor that has failed; changes in flight, as the next
        ("voltage_share", "f8"),  # of the commanded speed that the battery's voltage gives
        ("centre_of_mass_m", "f8", 2),
        ("quadratic_drag_kg_m", "f8", 3),
        ("propeller_radius_m", "f8"),
        ("rotor_thrust_share", "f8", 4),
        ("rotor_lag_share", "f8", 4),
        ("rotor_inertia_kgm2", "f8"),
        ("time_constant_up_s", "f8"),
        ("time_constant_down_s", "f8"),
        ("drag_kg_s", "f8", 3),
        ("foot_radius_m", "f8"),
        ("foot_height_m", "f8"),
        ("stiffness_n_m", "f8"),
        ("damping_ns_m", "f8"),
        ("friction", "f8"),
        ("attitude_gain", "f8", 3),
        ("rate_gain", "f8", 3),
        ("rate_limit", "f8", 3),
        ("position_gain", "f8"),
        ("velocity_gain", "f8"),
        ("acceleration_limit", "f8"),
        ("climb_acceleration_limit", "f8"),
    ]
)
"""The airframe for compiled code, and what acts on it. SI units and radians."""


def parameters(airframe: Airframe) -> NDArray[np.void]:
    """The record (1,) of PARAMETERS for take-off, in still air."""
    body, rotors, ground, inner, auto = (
        airframe.body,
        airframe.rotors,
        airframe.ground,
        airframe.inner_loop,
        airframe.auto,
    )
    record = np.zeros(1, PARAMETERS)
    values = {
        "wind_ned": 0.0,
        "force_ned": 0.0,
        "mass_kg": airframe.takeoff_mass_kg,
        "arm_length_m": body.arm_length_m,
        "inertia_kgm2": body.inertia_kgm2,
        "rotor_max_thrust_n": body.rotor_max_thrust_n,
        "torque_per_thrust_m": body.torque_per_thrust_m,
        "thrust_constant_ns2": rotors.thrust_constant_ns2,
        "rotor_max_speed": math.sqrt(body.rotor_max_thrust_n / rotors.thrust_constant_ns2),
        "rotor_running": 1.0,
        "voltage_share": 1.0,
        "centre_of_mass_m": airframe.unmodelled.centre_of_mass_m,
        "quadratic_drag_kg_m": airframe.unmodelled.quadratic_drag_kg_m,
        "propeller_radius_m": airframe.unmodelled.propeller_radius_m,
        "rotor_thrust_share": rotors.thrust_share,
        "rotor_lag_share": rotors.lag_share,
        "rotor_inertia_kgm2": rotors.inertia_kgm2,
        "time_constant_up_s": rotors.time_constant_up_s,
        "time_constant_down_s": rotors.time_constant_down_s,
        "drag_kg_s": body.drag_kg_s,
        "foot_radius_m": ground.foot_radius_m,
        "foot_height_m": ground.foot_height_m,
        "stiffness_n_m": ground.stiffness_n_m,
        "damping_ns_m": ground.damping_ns_m,
        "friction": ground.friction,
        "attitude_gain": inner.attitude_gain_1_s,
        "rate_gain": inner.rate_gain_1_s,
        "rate_limit": np.radians(inner.rate_limit_deg_s),
        "position_gain": auto.position_gain_1_s,
        "velocity_gain": auto.velocity_gain_1_s,
        "acceleration_limit": auto.acceleration_limit_m_s2,
        "climb_acceleration_limit": auto.climb_acceleration_limit_m_s2,
    }
    for name in PARAMETERS.fields or ():
        record[name] = values[name]
    return record
