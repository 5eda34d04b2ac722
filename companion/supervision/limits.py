"""The limits of a flight: whether the battery lasts, and whether the vehicle is within its fence."""

import math

import msgspec

from companion.config import Settings
from companion.config_limits import Geofence
from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import Announcement, BatteryLevel, Severity
from companion.supervision.battery import BatteryVerdict, BatteryWatch
from companion.supervision.states import FLYING, State


class LimitsVerdict(msgspec.Struct, frozen=True, gc=False):
    """How the flight stands to its limits."""

    battery: BatteryVerdict = BatteryVerdict()
    beyond: str | None = None
    """How the vehicle is beyond the fence and does not come back, in words."""
    returns: bool = False
    """The battery calls for the way home, and the mission does not lead there already."""


WITHIN = LimitsVerdict()
_SEVERITIES = {
    BatteryLevel.FINE: Severity.WARNING,
    BatteryLevel.WARN: Severity.WARNING,
    BatteryLevel.RETURN: Severity.CRITICAL,
    BatteryLevel.LAND: Severity.CRITICAL,
}


_BACK_M = 0.3
"""m inside of the fence at which the vehicle is back."""
_NEARER_M = 1.0


class FenceWatch:
    """Whether the vehicle is within its fence."""

    def __init__(self, settings: Geofence) -> None:
        self._land_after_ns = settings.land_after * 1e9
        self._beyond = False
        self._least = math.inf
        """m that it was beyond the fence, at the least since `_since_ns`."""
        self._since_ns = 0

    def judge(self, beyond: float, own: bool, now_ns: int) -> tuple[str | None, str]:
        """From m beyond the fence, negative inside: why it must land, if it must, and what is to be said, once. `own`:
        the companion flies; where others do, it need not come back."""
        news = ""
        if beyond > 0.0 and not self._beyond:
            self._beyond, self._least, self._since_ns = True, beyond, now_ns
            news = f"beyond the fence by {beyond:.1f} m: coming back"
        elif self._beyond and beyond < -_BACK_M:
            self._beyond = False
            news = "within the fence again"
        if not self._beyond:
            return None, news
        if beyond < self._least - _NEARER_M or not own:
            self._least, self._since_ns = beyond, now_ns
        late = now_ns - self._since_ns > self._land_after_ns
        return f"beyond the fence by {beyond:.1f} m, and not coming back" if late else None, news


class Limits:
    """The watches over the limits of one flight."""

    def __init__(self, settings: Settings) -> None:
        self._battery = BatteryWatch(settings.battery)
        self._fence = FenceWatch(settings.geofence)

    def judge(
        self, state: State, link: LinkReport, sensing: SensingReport, mission: MissionReport, now_ns: int
    ) -> tuple[LimitsVerdict, Announcement | None]:
        """How the flight stands to its limits, and what is to be said of that beside the table's own sentences."""
        flying = state in FLYING
        battery = self._battery.judge(
            sensing.batteries, mission.landing_s, flying, flying and not link.on_ground, now_ns
        )
        returns = battery.level is BatteryLevel.RETURN and not mission.homeward
        told = (returns and state is State.FLY) or (
            battery.level is BatteryLevel.LAND and state in (State.FLY, State.HOLD)
        )
        own = state in (State.FLY, State.HOLD)
        beyond, news = self._fence.judge(mission.beyond, own, now_ns) if flying else (None, "")
        news = news if own else news.replace(": coming back", "")
        texts = [text for text in ("" if told else battery.news, news) if text]
        said = Announcement(_SEVERITIES[battery.level], ", ".join(texts)) if texts else None
        return LimitsVerdict(battery, beyond, returns), said
