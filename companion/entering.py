"""What happens when a state of the flight is left and another one is entered."""

from companion.guidance import Guidance
from companion.link.vehicle_link import VehicleLink
from companion.mission.navigator import Navigator
from companion.sensing import Sensing
from companion.state import Announcement
from companion.supervision.states import AWAY, COMMANDED, State


def entered(
    old: State, new: State, now: int, link: VehicleLink, navigator: Navigator, guidance: Guidance, sensing: Sensing
) -> Announcement | None:
    """Tell link, navigator and guidance; what is to be said of it."""
    if old is State.FLY:
        guidance.halt(now)
    if new in AWAY:
        navigator.pause(now)
    if new is State.ADOPT:
        guidance.begin(sensing.present)
        said = navigator.adopt(link.said.home, sensing.present.position_ned, now)
        sensing.begin(navigator.lowest_return)
        return said
    if old in AWAY and new is State.HOLD:
        guidance.brake_from(sensing.present, now)
        navigator.resume(now)
    elif new is State.CHECK:
        link.request_rates()
    elif new is State.STREAM:
        navigator.begin(sensing.present.position_ned)
        guidance.begin(sensing.present)
        sensing.begin(navigator.lowest_return)
    elif new is State.FLY and old is State.ARM:
        navigator.start_step(now)
    elif new is State.FLY and old is State.FLY:
        said = navigator.go_home(sensing.present.position_ned, now)
        guidance.begin_leg(navigator.leg(sensing.present.position_ned), now)
        return said
    elif new is State.ENDED:
        navigator.end()
    elif new in COMMANDED:
        link.requests.forget_mode()
    return None
