"""What happens when a state of the flight is left and another one is entered, when the link becomes later, and when an
order comes."""

from companion.control.controller import Controller
from companion.guidance import Guidance
from companion.link.delays import Delays
from companion.link.vehicle_link import VehicleLink
from companion.mission.navigator import Navigator
from companion.mission.orders import OrderError, obey
from companion.sensing import Sensing
from companion.state import Announcement, Severity
from companion.supervision.operations import Operation, OrderRequest
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
        home, fence = link.said.home, link.readiness.fence
        guidance.begin(sensing.present, home, fence)
        said = navigator.adopt(home, sensing.present.position_ned, fence, now)
        sensing.begin(navigator.lowest_return, stands=False)
        return said
    if old in AWAY and new is State.HOLD:
        guidance.brake_from(sensing.present, now)
        navigator.resume(now)
    elif new is State.CHECK:
        link.request_rates()
    elif new is State.STREAM:
        home, fence = sensing.present.position_ned, link.readiness.fence
        navigator.begin(home, fence)
        guidance.begin(sensing.present, home, fence)
        sensing.begin(navigator.lowest_return, stands=True)
    elif new is State.FLY and old is State.ARM:
        link.readiness.emergency = ""
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


def follow_delay(
    delays: Delays, controller: Controller, guidance: Guidance, navigator: Navigator, sensing: Sensing
) -> Announcement | None:
    """Tell whatever depends on how late the link is of a change; what is to be said of it."""
    if delays.known is controller.delay:
        return None
    pace = controller.follow(delays.known)
    guidance.follow(delays.known, pace.share)
    navigator.slow_down(delays.known.total)
    sensing.plausibility.late_s = delays.known.total
    return delays.words(*pace)


def ordered(event: Operation, navigator: Navigator, guidance: Guidance, sensing: Sensing) -> Announcement | None:
    """Follow an order, if the event is one; what is to be said of it."""
    if not isinstance(event, OrderRequest):
        return None
    try:
        if sensing.state is None:
            raise OrderError("where the vehicle is is not known")
        here, now = sensing.state.position_ned, event.time_ns
        said = obey(event.text, navigator, here, guidance.fence, now)
    except OrderError as error:
        return Announcement(Severity.WARNING, f"order refused: {error}")
    guidance.begin_leg(navigator.leg(here), now)
    return said
