"""What the vehicle says of itself: mode, arming, failsafe, whether it stands on the ground; and whether that is news.

A heartbeat has no time. One that was sent before a command took effect, or before a gap of our own, says nothing of
what came of it.
"""

from typing import Any

from companion.reports import StatusReport
from companion.state import FlightMode, VehicleStatus
from protocol.arrays import Array
from protocol.messages import dialect
from protocol.peer import Peer

_SECOND_NS = 1_000_000_000
_ANSWER_NS = _SECOND_NS
"""A mode that was asked for is there after this time, if the command was not answered."""
_SETTLES_NS = _SECOND_NS // 10
"""The same after the answer: PX4 answers twice, the first time up to 16 ms before the mode changes."""
_BACKLOG_NS = 3 * _SECOND_NS // 10
"""What queued up during a gap of our own has been read after this time. Where the vehicle's clock is known, its
telemetry says so,"""
_LONGEST_BACKLOG_NS = 2 * _SECOND_NS
"""but it is not waited for longer than this."""
_TOLERANCE_NS = _SECOND_NS // 20
"""How much (ns) of the vehicle's clock two stamps may be apart."""
_WORN_OUT_NS = 5 * _SECOND_NS
"""That it stands on the ground holds for so long: a vehicle that says nothing more may have taken off since. PX4 says
it each 2 s on a slow link, unless it is asked for more."""
_FALLS_NS = 3 * _SECOND_NS // 10
"""A vehicle that has been disarmed for so long and says that it is in the air falls: what it says of the ground may be
that much older than what it says of its motors."""
_TELLS_NS = _SECOND_NS
"""So long is waited for a word of the ground from a vehicle that was disarmed in the air."""
_LATE_PERIODS = 1.5
"""A heartbeat that is older than so many of its periods is asked for."""

_EMERGENCY = frozenset({dialect.MAV_STATE_EMERGENCY, dialect.MAV_STATE_FLIGHT_TERMINATION})
_CRITICAL = _EMERGENCY | {dialect.MAV_STATE_CRITICAL}
_AIRBORNE = frozenset(
    {dialect.MAV_LANDED_STATE_IN_AIR, dialect.MAV_LANDED_STATE_TAKEOFF, dialect.MAV_LANDED_STATE_LANDING}
)


class StatusWatch:
    """The latest heartbeat and the latest word on the ground. Times in ns of the companion's clock."""

    def __init__(self) -> None:
        self.status = VehicleStatus(FlightMode.OTHER, False, False)
        self.on_ground: bool | None = None
        """The vehicle says that it stands on the ground; None: it says nothing of it."""
        self.home_ned: Array | None = None
        """(3,) m: where it took off, as it says."""
        self.rebooted = False
        """It has rebooted, and was not armed since."""
        self.catching_up = False
        """Telemetry from before a gap of our own may still come."""
        self._chosen: FlightMode | None = None
        """The mode that began together with a failsafe; None: the present one did not."""
        self._airborne = False
        self._landed_ns: int | None = None
        self._disarmed_ns: int | None = None
        """When it was disarmed; None while it is armed, or never was."""
        self._fell = False
        self._told_ns = 0
        """When it said anything of the ground last."""
        self._heard_ns: int | None = None
        self._orders = {"heartbeat": 0, "extended state": 0}
        """`Peer.order` of the latest of each."""
        self._asked_ns = -_SECOND_NS
        self._awake_ns = 0
        self._after_command_ns = 0
        self._after_gap_ns = 0
        """Heartbeats count that came after both."""

    @property
    def home(self) -> Array:
        """(3,) m: where it took off, once it has said so."""
        assert self.home_ned is not None
        return self.home_ned

    def _is_latest(self, kind: str, peer: Peer | None) -> bool:
        """Whether the message that `peer` has just sent is the latest of its kind; one that was overtaken says how it
        was before."""
        order = 0 if peer is None else peer.order
        latest = order >= self._orders[kind]
        self._orders[kind] = max(order, self._orders[kind])
        return latest

    def heartbeat(self, message: Any, mode: FlightMode, peer: Peer | None, now_ns: int) -> None:
        """HEARTBEAT (0) of a `peer`, whose custom mode means `mode`.

        The mode in which the vehicle's own failsafe has begun stays its own when the failsafe is over: ArduPilot's is
        as soon as it hears the companion again.
        """
        if not self._is_latest("heartbeat", peer):
            return
        self._heard_ns = now_ns
        before, critical = self.status, message.system_status in _CRITICAL
        if mode is not before.mode:
            begins = critical and not before.failsafe and before.mode is FlightMode.EXTERNAL
            self._chosen = mode if begins else None
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        self.rebooted = self.rebooted and not armed
        if armed:
            self._disarmed_ns, self._fell = None, False
        elif before.armed:
            self._disarmed_ns = now_ns
        self.status = VehicleStatus(
            mode,
            armed,
            critical or self._chosen is not None,
            message.system_status in _EMERGENCY,
        )

    def extended_state(self, message: Any, peer: Peer | None, now_ns: int) -> None:
        """EXTENDED_SYS_STATE (245) of a `peer`."""
        if not self._is_latest("extended state", peer):
            return
        self.on_ground = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
        self._airborne = message.landed_state in _AIRBORNE
        if not self.on_ground:
            self._landed_ns = None
        elif self._landed_ns is None or self._is_worn_out(now_ns):
            self._landed_ns = now_ns
        self._told_ns = now_ns
        if self._disarmed_ns is not None and now_ns - self._disarmed_ns >= _FALLS_NS:
            self._fell = self._fell or self._airborne

    def _is_worn_out(self, now_ns: int) -> bool:
        return now_ns - self._told_ns > _WORN_OUT_NS

    def stands(self, now_ns: int) -> bool | None:
        """It says that it stands on the ground; None: it says nothing of it, or has not for long."""
        return None if self.on_ground and self._is_worn_out(now_ns) else self.on_ground

    def report(self, now_ns: int) -> StatusReport:
        """As it is known now."""
        heard, counts_from = self._heard_ns, max(self._after_command_ns, self._after_gap_ns)
        landed_ns = now_ns if self._landed_ns is None or self._is_worn_out(now_ns) else self._landed_ns
        return StatusReport(
            current=heard is not None and heard >= counts_from,
            airborne=self._airborne,
            landed_for=(now_ns - landed_ns) * 1e-9,
            rebooted=self.rebooted,
            fell=self._fell,
            undecided=self._airborne and self._disarmed_ns is not None and now_ns - self._disarmed_ns < _TELLS_NS,
        )

    # -- what makes a heartbeat old ------------------------------------------------------------------------------------

    def mode_asked(self, now_ns: int) -> None:
        """A mode is asked for, for the first time."""
        self._after_command_ns = now_ns + _ANSWER_NS

    def mode_answered(self, now_ns: int) -> None:
        """The vehicle has answered that."""
        self._after_command_ns = min(self._after_command_ns, now_ns + _SETTLES_NS)

    def stood_still(self, now_ns: int) -> None:
        """The companion itself stood still until now: what queued up meanwhile comes first, and is old."""
        self.catching_up = True
        self._awake_ns = now_ns
        self._after_gap_ns = now_ns + _LONGEST_BACKLOG_NS

    def is_old(self, measured_ns: int | None, now_ns: int) -> bool:
        """Telemetry that was measured then (None: it is not known when) is from before the gap."""
        waited = now_ns - self._awake_ns
        if measured_ns is None:
            old = waited < _BACKLOG_NS
        else:
            old = waited < _LONGEST_BACKLOG_NS and measured_ns < self._awake_ns - _TOLERANCE_NS
        if not old:
            self.catching_up = False
            self._after_gap_ns = now_ns
        return old

    # -- how often -----------------------------------------------------------------------------------------------------

    def is_due(self, rate: float, now_ns: int) -> bool:
        """A heartbeat at this rate (Hz) is late, and is to be asked for now: PX4 sends one a second, and no more unless
        it is asked for each."""
        late_ns, period_ns = _LATE_PERIODS * _SECOND_NS / rate, _SECOND_NS / rate
        if self._heard_ns is None or now_ns - self._heard_ns < late_ns or now_ns - self._asked_ns < period_ns:
            return False
        self._asked_ns = now_ns
        return True
