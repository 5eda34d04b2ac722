"""What speaks for and against a flight with the vehicle that was found: its version, its parameters, and what it says
of itself."""

from typing import Any

from companion.config import Settings
from companion.link.audit import Audit
from companion.link.firmware.firmware import Firmware, Terms
from companion.link.stamps import OddStamps
from companion.link.vehicle_texts import Said, VehicleTexts
from companion.state import NO_FENCE, Announcement, Output, OwnFence, Severity
from protocol.messages import dialect
from protocol.peer import Peer

_COMPLAINT_NS = 5_000_000_000
"""A warning of the vehicle explains what happens within this time after it."""
_REASON_NS = 40_000_000_000
"""A failed check stands for so long; ArduPilot repeats it each 30 s."""
_DOUBLE_NS = 3_500_000_000
"""Another companion's heartbeat, which comes once a second, stands for so long."""
_CHECKS = ("PreArm", "Preflight", "Arm: ")
"""How the texts of failed checks begin."""
_FLAGS = {
    dialect.EKF_ATTITUDE: "attitude",
    dialect.EKF_VELOCITY_HORIZ: "velocity",
    dialect.EKF_POS_VERT_ABS: "height",
    dialect.EKF_POS_HORIZ_ABS: "position",
}
"""Words for the flags of EKF_STATUS_REPORT, and of ESTIMATOR_STATUS, which has the same."""


class Readiness:
    """The readiness of one vehicle; its messages go in, and sentences come out."""

    def __init__(self, settings: Settings, output: Output | None) -> None:
        self.version: int | None = None
        """AUTOPILOT_VERSION.flight_sw_version."""
        self.audit: Audit | None = None
        """The audit of its parameters, once a vehicle was found."""
        self.kind: int | None = None
        """MAV_TYPE, once a vehicle was found."""
        self.answers = False
        """It has answered something."""
        self.prearm_ok = True
        self.emergency = ""
        """The first text of an emergency since arming."""
        self._settings = settings
        self._asked_output = output
        self._firmware: Firmware | None = None
        self._estimator: int | None = None
        self._had_position = False
        self._texts = VehicleTexts()
        self._complaint = 0, ""
        """When the vehicle warned of something last (ns), and the text."""
        self._failed_check = 0, ""
        """The same of its checks before arming."""
        self._double: str | None = None
        """Another companion, in words."""
        self._double_flew_ns: int | None = None
        """When it said last that it flies the vehicle, or is about to."""
        self._odd_stamps = OddStamps()
        self._twin: str | None = None
        """Another vehicle, in words."""

    def begin(self, firmware: Firmware, own_system: int) -> None:
        """A vehicle was found, or has started anew."""
        settings = self._settings
        terms = Terms(self._asked_output, own_system, settings.limits.tilt_deg, settings.supervision.gap)
        self._firmware, self._estimator, self._had_position = firmware, None, False
        self.audit = Audit(firmware, terms, self._settings.supervision)

    # -- the vehicle's messages ----------------------------------------------------------------------------------------

    def on_version(self, message: Any, now_ns: int) -> None:
        """AUTOPILOT_VERSION (148)."""
        self.version = message.flight_sw_version

    def on_parameter(self, message: Any, now_ns: int) -> None:
        """PARAM_VALUE (22)."""
        self.answers = True
        if self.audit is not None:
            self.audit.take(message)

    def on_parameter_error(self, message: Any, now_ns: int) -> None:
        """PARAM_ERROR (345)."""
        if self.audit is not None:
            self.audit.refuse(message)

    def on_sys_status(self, message: Any, now_ns: int) -> None:
        """SYS_STATUS (1)."""
        bit = dialect.MAV_SYS_STATUS_PREARM_CHECK
        if message.onboard_control_sensors_present & bit:
            self.prearm_ok = bool(message.onboard_control_sensors_health & bit)

    def on_estimator(self, message: Any, now_ns: int) -> None:
        """EKF_STATUS_REPORT (193) or ESTIMATOR_STATUS (230)."""
        self._estimator = message.flags
        self._had_position |= self._has_position

    def on_statustext(self, message: Any, now_ns: int) -> Announcement | None:
        """STATUSTEXT (253). A text in pieces counts from the first one on, and is said once it is whole."""
        said = self._texts.take(message, now_ns)
        if said is None:
            return None
        if said.severity <= Severity.WARNING and said.text:
            self._complaint = now_ns, f" ({said.text})"
            if said.text.startswith(_CHECKS):
                self._failed_check = self._complaint
        if said.severity <= Severity.ALERT and said.text.startswith(self.emergency):
            self.emergency = said.text
        return _announced(said) if said.whole else None

    def cut_short(self, now_ns: int) -> list[Announcement]:
        """What the vehicle said, and never to its end."""
        return [_announced(said) for said in self._texts.cut_short(now_ns)]

    def on_double(self, message: Any, own: tuple[int, int], now_ns: int) -> list[str]:
        """HEARTBEAT (0) of another companion that uses this one's own (system, component); what is to be said the first
        time."""
        if message.system_status == dialect.MAV_STATE_ACTIVE:
            self._double_flew_ns = now_ns
        if self._double is not None:
            return []
        system, component = own
        self._double = (
            f"another companion speaks as system {system}, component {component} on this link: end one of the two, "
            "or give one another identity.component"
        )
        return [self._double]

    def on_odd_stamp(self, vehicle: Peer, now_ns: int) -> list[str]:
        """An attitude or a position with a stamp that the vehicle's clock can't have, or after a reboot; what is to be
        said the first time that they come on and on."""
        self._odd_stamps.add(now_ns)
        if self._twin is not None or not self._odd_stamps.go_on(now_ns):
            return []
        self._twin = (
            f"two clocks speak as system {vehicle.system}, component {vehicle.component} on this link: two vehicles "
            "with the same id? Both would obey: give one another (MAV_SYS_ID, SYSID_THISMAV)"
        )
        return [self._twin]

    # -- what follows from them ----------------------------------------------------------------------------------------

    @property
    def output(self) -> Output:
        """What the flight commands; not fixed before the audit is through."""
        return self._asked_output or Output.ATTITUDE if self.audit is None else self.audit.output

    @property
    def fence(self) -> OwnFence:
        """The vehicle's own; none before the audit is through."""
        return NO_FENCE if self.audit is None else self.audit.vehicle.fence

    @property
    def refusal(self) -> str | None:
        """Why this vehicle is not flown, whatever one waits for."""
        if self._firmware is None or self.audit is None:
            return None
        if self.kind is not None and self.kind not in self._firmware.kinds:
            return f"it is no copter, but {_name_of(self.kind)}"
        refusal = None if self.version is None else self._firmware.refusal(self.output, self.version)
        return refusal or self.audit.refusal

    def rival(self, now_ns: int) -> str | None:
        """Another companion that flies the vehicle just now, in words; None if there is none."""
        flew_ns = self._double_flew_ns
        return self._double if flew_ns is not None and now_ns - flew_ns < _DOUBLE_NS else None

    def shortcoming(self, now_ns: int) -> str | None:
        """What one waits for, in words; None if nothing."""
        if self.rival(now_ns) is not None:
            return self.rival(now_ns)
        if self._odd_stamps.go_on(now_ns):
            return self._twin
        if self.audit is None:
            return "no heartbeat of a vehicle has come"
        return self.unversioned or self.audit.progress or self._estimator_lacks(now_ns)

    @property
    def unversioned(self) -> str | None:
        """Why the version is not known, in words; None if it is. A vehicle that answers nothing at all may not hear."""
        if self.version is not None:
            return None
        if not self.answers:
            return "the vehicle has answered nothing yet: does what is sent reach it (wiring, MAVLink 2)?"
        return "the vehicle does not say its version (AUTOPILOT_VERSION)"

    def complaint(self, now_ns: int, *, refused: bool = False) -> str:
        """What the vehicle warned of just now, to stand behind a sentence; empty if nothing. Where it has `refused` a
        command without a word, where it tells why."""
        said = self._complaint[1] if now_ns - self._complaint[0] < _COMPLAINT_NS else ""
        return self._firmware.reasons if refused and not said and self._firmware is not None else said

    def failed_check(self, now_ns: int) -> str:
        """What the vehicle says is wrong before arming, to stand behind a sentence; empty if nothing."""
        stands = not self.prearm_ok and now_ns - self._failed_check[0] < _REASON_NS
        return self._failed_check[1] if stands else self.complaint(now_ns)

    @property
    def position_lost(self) -> bool:
        """The vehicle's estimator had a position, and says that it has none now. PX4 goes on to send
        LOCAL_POSITION_NED then."""
        return self._had_position and not self._has_position

    @property
    def _has_position(self) -> bool:
        if self._estimator is None or self._firmware is None:
            return False
        return bool(self._estimator & self._firmware.position_flags)

    def _estimator_lacks(self, now_ns: int) -> str | None:
        """None once the estimator has a position, or if it does not report."""
        if self._estimator is None or self._firmware is None or self._has_position:
            return None
        lacking = [name for flag, name in _FLAGS.items() if not self._estimator & flag]
        return f"the vehicle's estimator has no {', '.join(lacking)} yet{self.failed_check(now_ns)}"


def _announced(said: Said) -> Announcement:
    return Announcement(Severity(min(said.severity, 6)), f"vehicle: {said.text}")


def _name_of(kind: int) -> str:
    """A MAV_TYPE in words."""
    entry = dialect.enums["MAV_TYPE"].get(kind)
    return f"type {kind}" if entry is None else entry.name.removeprefix("MAV_TYPE_").replace("_", " ").lower()
