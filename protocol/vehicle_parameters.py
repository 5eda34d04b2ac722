"""The airframe as both the vehicle and the companion know it: the `[body]` table of a file in `vehicles/`."""

from typing import Annotated

import msgspec

GRAVITY = 9.81
"""m/s2, the paper's Table 1."""

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


class VehicleParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A quadrotor in "+" layout, with rotors front, right, back and left (the paper's Table 1)."""

    mass_kg: Positive
    arm_length_m: Positive
    inertia_kgm2: tuple[Positive, Positive, Positive]
    rotor_max_thrust_n: Positive
    """Thrust of one rotor at full throttle."""
    torque_per_thrust_m: Positive
    """Drag torque of a rotor divided by its thrust, km/kf."""
    drag_kg_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Linear drag coefficients (N for 1 m/s) along the body's axes."""
    rotor_time_constant_s: NotNegative = 0.0
    """Time constant of a rotor's thrust, the mean of up and down; 0: unknown."""
    rate_loop_gain_1_s: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Angular acceleration of the vehicle's own rate loop for an error of 1 rad/s, per axis; 0: unknown."""
    attitude_loop_gain_1_s: NotNegative = 0.0
    """Rate of the vehicle's own attitude loop for a tilt error of 1 rad; 0: unknown."""
    parcel_mass_kg: NotNegative = 0.0
    """Mass of the parcel at take-off, beside `mass_kg`."""

    @property
    def max_thrust_n(self) -> float:
        """Thrust of all four rotors at full throttle, which is 1.0 on the wire."""
        return 4.0 * self.rotor_max_thrust_n

    @property
    def full_torque_nm(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw torque that 1.0 means in actuator controls.

        One rotor is at full throttle with its opposite at rest, or for yaw one pair with the other at rest.
        """
        tilt = self.arm_length_m * self.rotor_max_thrust_n
        return tilt, tilt, 2.0 * self.torque_per_thrust_m * self.rotor_max_thrust_n

    @property
    def hover_thrust(self) -> float:
        """Collective thrust (of 1.0) that hovers without a parcel."""
        return self.mass_kg * GRAVITY / self.max_thrust_n
