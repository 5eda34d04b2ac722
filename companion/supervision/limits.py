"""The limits of a flight: whether the battery lasts."""

import msgspec

from companion.config import Settings
from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import Announcement, BatteryLevel, Severity
from companion.supervision.battery import BatteryVerdict, BatteryWatch
from companion.supervision.states import FLYING, State


class LimitsVerdict(msgspec.Struct, frozen=True, gc=False):
    """How the flight stands to its limits."""

    battery: BatteryVerdict = BatteryVerdict()


WITHIN = LimitsVerdict()
_SEVERITIES = {
    BatteryLevel.FINE: Severity.WARNING,
    BatteryLevel.WARN: Severity.WARNING,
    BatteryLevel.RETURN: Severity.CRITICAL,
    BatteryLevel.LAND: Severity.CRITICAL,
}


class Limits:
    """The watches over the limits of one flight."""

    def __init__(self, settings: Settings) -> None:
        self._battery = BatteryWatch(settings.battery)

    def judge(
        self, state: State, link: LinkReport, sensing: SensingReport, mission: MissionReport, now_ns: int
    ) -> tuple[LimitsVerdict, Announcement | None]:
        """How the flight stands to its limits, and what is to be said of that beside the table's own sentences."""
        flying = state in FLYING
        battery = self._battery.judge(
            sensing.batteries, mission.landing_s, flying, flying and not link.on_ground, now_ns
        )
        told = battery.level is BatteryLevel.RETURN and state is State.FLY and not mission.homeward
        told = told or (battery.level is BatteryLevel.LAND and state in (State.FLY, State.HOLD))
        said = None if told or not battery.news else Announcement(_SEVERITIES[battery.level], battery.news)
        return LimitsVerdict(battery), said
