"""Who the vehicle is on the MAVLink network, and what it says that it is."""

from dataclasses import dataclass

from protocol.routing import Sender

COMPONENT = 1

_LAST_WITH_ACTUATOR_CONTROLS = (1, 13)
_RELEASE = 255


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of one vehicle. `firmware`: the release of PX4 that it behaves as."""

    system: int = 1
    firmware: tuple[int, int] = (1, 16)

    @property
    def version(self) -> int:
        """AUTOPILOT_VERSION's flight_sw_version."""
        major, minor = self.firmware
        return major << 24 | minor << 16 | _RELEASE

    @property
    def takes_actuator_controls(self) -> bool:
        """PX4 dropped SET_ACTUATOR_CONTROL_TARGET after 1.13."""
        return self.firmware <= _LAST_WITH_ACTUATOR_CONTROLS

    def is_meant(self, target: Sender) -> bool:
        """A message for this target is for this vehicle, or for everybody."""
        return target[0] in (0, self.system) and target[1] in (0, COMPONENT)


FIRST = Identity()
"""The vehicle that is alone."""
