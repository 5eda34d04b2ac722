"""What can be changed about the autopilot while it runs."""

from dataclasses import dataclass

import msgspec

from vehicle_sim.airframe import Airframe, Auto, FenceSettings
from vehicle_sim.autopilot.modes import Trigger

SECOND_NS = 1_000_000_000


class BatteryFailsafe(msgspec.Struct, frozen=True):
    """What a low battery leads to."""

    action: int = 3
    """COM_LOW_BAT_ACT: 0 a warning, 1 return, 2 land, 3 return when critical and land in the emergency."""
    low: float = 0.15
    critical: float = 0.07
    emergency: float = 0.05
    """Charges below which the battery is so: BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR."""


_PX4_BATTERY = BatteryFailsafe()


@dataclass(slots=True)
class Settings:
    """The autopilot reads them at each tick; the parameters of the names below change them. PX4's defaults, but for
    those of the vehicle file."""

    auto: Auto
    fence: FenceSettings
    stream_loss_ns: int = SECOND_NS
    """Time without a setpoint after which OFFBOARD ends, COM_OF_LOSS_T."""
    stream_loss: Trigger | None = Trigger.STILL_LOST
    """What happens after the hold that follows a lost stream, COM_OBL_RC_ACT; None: nothing."""
    failsafe_hold_ns: int = 5 * SECOND_NS
    """Time in hold before that, COM_FAIL_ACT_T."""
    link_loss: Trigger | None = None
    """What happens to a vehicle in hold that hears no heartbeat, NAV_DLL_ACT; None: nothing."""
    link_loss_ns: int = 10 * SECOND_NS
    """Time without a heartbeat after which it happens, COM_DL_LOSS_T."""
    stick_loss_ns: int = SECOND_NS // 2
    """Time without sticks after which nobody flies by hand, COM_RC_LOSS_T."""
    fence_breach: Trigger | None = Trigger.FENCE_BREACHED
    """What happens beyond the uploaded fence, GF_ACTION; None: nothing."""
    acceptance_m: float = 2.0
    """Distance at which a mission's place is reached, NAV_ACC_RAD as PX4 sets it for multicopters."""
    height_acceptance_m: float = 0.8
    """The same in height, NAV_MC_ALT_RAD."""
    yaw_rate_deg_s: float = 45.0
    """At which a mission turns the nose, MPC_YAWRAUTO_MAX."""
    max_speed_m_s: float = 12.0
    """Level speed of setpoints and sticks, MPC_XY_VEL_MAX."""
    max_climb_m_s: float = 3.0
    """Climb of setpoints and sticks, MPC_Z_VEL_MAX_UP."""
    max_sink_m_s: float = 1.5
    """Descent of setpoints and sticks, MPC_Z_VEL_MAX_DN."""
    stick_tilt_deg: float = 35.0
    """Tilt that a stick at its end asks for, MPC_MAN_TILT_MAX."""
    stick_yaw_rate_deg_s: float = 150.0
    """The same, MPC_MAN_Y_MAX."""
    least_thrust: float = 0.08
    """Share of the full thrust at the lower end of the throttle, MPC_MANTHR_MIN."""
    disarm_landed_ns: int = 2 * SECOND_NS
    """Time on the ground after which the vehicle disarms, COM_DISARM_LAND; 0 or less: never."""
    disarm_preflight_ns: int = 10 * SECOND_NS
    """Time armed without a take-off after which the vehicle disarms, COM_DISARM_PRFLT; 0 or less: never."""
    battery: BatteryFailsafe = _PX4_BATTERY
    roll_failure_deg: int = 0
    pitch_failure_deg: int = 0
    """Beyond which the attitude has failed, FD_FAIL_R and FD_FAIL_P; 0: never."""
    failures_allowed: int = 1
    """SYS_FAILURE_EN: parts can be made to fail by a command."""
    circuit_breaker: int = 121212
    """CBRK_FLIGHTTERM; 121212: nothing but a command terminates a flight."""

    @property
    def terminates(self) -> bool:
        """A failed attitude stops the motors in flight."""
        return self.circuit_breaker != 121212

    @classmethod
    def of(cls, airframe: Airframe) -> "Settings":
        return cls(airframe.auto, airframe.fence)
