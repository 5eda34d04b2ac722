"""The telemetry of one flight: which messages it needs, how often, and what is asked for so that they come."""

from companion.config import Settings
from companion.link.firmware.firmware import Firmware
from companion.link.message_rates import MessageRates
from companion.link.rings import DISTANCE_SENSOR, OBSTACLE_DISTANCE, Rings
from protocol.messages import dialect

Intervals = list[tuple[int, float]]
"""What to ask for: messages, each with its interval (us)."""

_HEARTBEAT: int = dialect.MAVLINK_MSG_ID_HEARTBEAT
_EXTENDED_STATE: int = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
"""Asked for, and done without where a vehicle does not send it."""
_WELCOME = {
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_VIBRATION: 0.5,
}
"""Rates (Hz) by message, of what is good to have of any vehicle."""

FLOWN_BY = frozenset(
    {
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        OBSTACLE_DISTANCE,
        DISTANCE_SENSOR,
        _EXTENDED_STATE,
        _HEARTBEAT,
    }
)
"""Messages without which, or with fewer of which, a flight ends."""

_STILL_ENOUGH = 0.5
"""Part of the least share that is enough, once that was reached."""


class Telemetry:
    """What comes of it is counted in `rates`; what is returned is to be asked for."""

    def __init__(self, settings: Settings) -> None:
        self._enough = False
        self.rates = MessageRates(_needed(settings), settings.rates.least_share)
        self.rings = Rings(self.rates.count)
        self._settings = settings.rates

    def expect(self, firmware: Firmware) -> None:
        """The vehicle that was found is of this make."""
        self.rings.silent_when_free = firmware.silent_when_free
        welcome = {**_WELCOME, **firmware.telemetry}
        if self._settings.odometry > 0.0:
            welcome[dialect.MAVLINK_MSG_ID_ODOMETRY] = self._settings.odometry
        self.rates.welcome(welcome)

    def at_first(self) -> Intervals:
        """All that a flight needs, and the mode more often than it comes."""
        rates = self.rates
        intervals = rates.to_ask((_HEARTBEAT,), self._settings.heartbeat) + rates.to_ask(rates.wanted)
        if OBSTACLE_DISTANCE in rates.wanted and self.rings.silent_when_free:
            intervals += self._parts_of_rings()
        return intervals

    def once_more(self, now_ns: int) -> Intervals:
        """What comes too slowly, and what is good to have and never came."""
        lacking = self.rates.lacking(now_ns)
        intervals = self.rates.to_ask((*self.rates.unheard(), *lacking))
        if OBSTACLE_DISTANCE in lacking and not self.rings.whole:
            intervals += self._parts_of_rings()
        return intervals

    def shortcoming(self, now_ns: int) -> str | None:
        """The first message that comes too slowly for a flight, in words; None if none does. Once all came fast enough,
        half of that will do: what wavers about the least share is no reason to call a start off."""
        part = _STILL_ENOUGH if self._enough else 1.0
        lacking = [each for each in self.rates.lacking(now_ns, part) if each != _EXTENDED_STATE]
        self._enough = not lacking
        return self.rates.describe(lacking[0], now_ns) if lacking else None

    def _parts_of_rings(self) -> Intervals:
        return self.rates.to_ask(self.rings.parts, self._settings.scan)


def _needed(settings: Settings) -> dict[int, float]:
    """Rates (Hz) by message."""
    rates = settings.rates
    needed = {
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: rates.position,
        dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: rates.attitude,
    }
    if settings.avoidance.needs_scan:
        needed[OBSTACLE_DISTANCE] = rates.scan
    if settings.avoidance.ground_slope > 0.0:
        needed[DISTANCE_SENSOR] = rates.scan
    needed[_EXTENDED_STATE] = 5.0
    return needed
