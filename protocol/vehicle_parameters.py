"""What vehicle and companion both know of the airframe: the `[body]` table of a file in `vehicles/`."""

from typing import Annotated

import msgspec

GRAVITY = 9.81
"""m/s2, the paper's Table 1."""

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A quadrotor in "+": rotors front, right, back, left at `arm_length_m` (the paper's Table 1)."""

    mass_kg: Positive
    arm_length_m: Positive
    inertia_kgm2: tuple[Positive, Positive, Positive]
    rotor_max_thrust_n: Positive
    """Thrust of one rotor at full throttle."""
    torque_per_thrust_m: Positive
    """A rotor's drag torque over its thrust, km/kf."""
    drag_kg_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag (N for 1 m/s) along the body's axes."""
    rotor_time_constant_s: NotNegative = 0.0
    """Of a rotor's thrust, up and down on average; 0: not known."""
    rate_loop_gain_1_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Angular acceleration that the vehicle's own rate loop gives for an error of 1 rad/s; 0: not known."""
    attitude_loop_gain_1_s: NotNegative = 0.0
    """Rate that the vehicle's own attitude loop gives for a tilt's error of 1 rad; 0: not known."""
    parcel_mass_kg: NotNegative = 0.0
    """What it carries at take-off, on top of `mass_kg`."""

    @property
    def max_thrust_n(self) -> float:
        """All four rotors at full throttle: 1.0 on the wire."""
        return 4.0 * self.rotor_max_thrust_n

    @property
    def full_torque_nm(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw torque that 1.0 means in actuator controls: one rotor full against its opposite at rest,
        or for yaw one pair against the other."""
        tilt = self.arm_length_m * self.rotor_max_thrust_n
        return tilt, tilt, 2.0 * self.torque_per_thrust_m * self.rotor_max_thrust_n

    @property
    def hover_thrust(self) -> float:
        """Of 1.0, without a parcel."""
        return self.mass_kg * GRAVITY / self.max_thrust_n
