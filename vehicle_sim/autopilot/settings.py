"""What can be changed about the autopilot while it runs."""

from dataclasses import dataclass

from vehicle_sim.airframe import Airframe, Auto, FenceSettings
from vehicle_sim.autopilot.modes import Trigger

SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class Settings:
    """The autopilot reads them at each tick; the parameters of the names below change them. PX4's defaults, but for
    those of the vehicle file."""

    auto: Auto
    fence: FenceSettings
    stream_loss: Trigger | None = Trigger.STILL_LOST
    """What happens after the hold that follows a lost stream, COM_OBL_RC_ACT; None: nothing."""
    failsafe_hold_ns: int = 5 * SECOND_NS
    """Time in hold before that, COM_FAIL_ACT_T."""
    link_loss: Trigger | None = None
    """What happens to a vehicle in hold that hears no heartbeat, NAV_DLL_ACT; None: nothing."""
    link_loss_ns: int = 10 * SECOND_NS
    """Time without a heartbeat after which it happens, COM_DL_LOSS_T."""
    disarm_landed_ns: int = 2 * SECOND_NS
    """Time on the ground after which the vehicle disarms, COM_DISARM_LAND; 0 or less: never."""
    disarm_preflight_ns: int = 10 * SECOND_NS
    """Time armed without a take-off after which the vehicle disarms, COM_DISARM_PRFLT; 0 or less: never."""

    @classmethod
    def of(cls, airframe: Airframe) -> "Settings":
        return cls(airframe.auto, airframe.fence)
