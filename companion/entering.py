"""What happens when a state of the flight is left and another one is entered, when the link becomes later, and when an
order or a plan comes."""

from dataclasses import replace

import numpy as np

from companion.avoidance.planner import PlanResult
from companion.config_avoidance import Avoidance
from companion.control.controller import Controller
from companion.guidance import Guidance
from companion.link.vehicle_link import VehicleLink
from companion.mission.navigator import Arrival, Navigator
from companion.mission.orders import OrderError, obey
from companion.mission.plan import Phase
from companion.sensing import Sensing
from companion.state import Announcement, Output, Severity, VehicleRequest, VehicleState
from companion.supervision.operations import LandRequest, Operation, OrderRequest
from companion.supervision.states import AWAY, COMMANDED, ENDING, State
from companion.supervision.supervisor import Supervisor

_SHORT_M = 0.1
"""m by which a descent is cut short, at least."""


def entered(
    change: tuple[State, State],
    now: int,
    link: VehicleLink,
    controller: Controller,
    navigator: Navigator,
    guidance: Guidance,
    sensing: Sensing,
) -> Announcement | None:
    """Tell link, controller, navigator and guidance; what is to be said of it. `change`: the state that was left, and
    the one that was entered."""
    old, new = change
    if old is State.FLY:
        guidance.halt(now)
    if new in AWAY:
        navigator.pause(now)
    if new in ENDING:
        navigator.lands = True
    if new is State.ADOPT:
        link.requests.forget_mode()  # an attempt before this one may have asked already
        home, fence = link.said.home, link.readiness.fence
        guidance.begin(sensing.present, home, fence)
        said = navigator.adopt(home, sensing.present.position_ned, fence, now)
        sensing.begin(navigator.lowest_return, stands=False)
        return said
    if old in AWAY and new is State.HOLD:
        flown = old is not State.GAP and link.said.report(now).airborne
        controller.given_back(sensing.present, airborne=flown)
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
        controller.take_off()
        navigator.start_step(now)
    elif new is State.FLY and old is State.FLY:
        said = navigator.go_home(sensing.present.position_ned, now)
        guidance.begin_leg(navigator.leg(sensing.present.position_ned), now)
        return said
    elif new is State.ENDED:
        late = _released_at_last(link, navigator)
        navigator.end()
        return late
    elif new in COMMANDED:
        link.requests.forget_mode()
    return None


def follow_output(link: VehicleLink, controller: Controller, now: int, *, airborne: bool) -> None:
    """Command the flight's output, or attitudes in its place."""
    instead = link.outbox.carries_any and link.delays.asks_for_attitudes(now, airborne=airborne)
    output = Output.ATTITUDE if instead else link.readiness.output
    if output is not controller.output:
        controller.use(output)
    if output is not link.outbox.output:
        link.outbox.use(output)


def follow_delay(
    now: int, link: VehicleLink, controller: Controller, navigator: Navigator, guidance: Guidance, sensing: Sensing
) -> Announcement | None:
    """Tell whatever depends on how late the link is of a change; what is to be said of it."""
    delays = link.delays
    if delays.known is not controller.delay:
        follow_output(link, controller, now, airborne=False)
        controller.follow(delays.known)
        guidance.follow(delays.known, controller.pace.share)
        navigator.slow_down(delays.known.total)
        sensing.plausibility.late_s = delays.known.total
    return delays.words(now, *controller.pace, instead=controller.output is not link.readiness.output)


def heed_below(
    state: VehicleState, now: int, settings: Avoidance, navigator: Navigator, guidance: Guidance, sensing: Sensing
) -> Announcement | None:
    """The mission rises and falls with the ground below, or a descent ends above what stands there; what is to be said
    of it."""
    said = navigator.follow(sensing.ground.ground(now), state.position_ned, now)
    sensing.ground_at(navigator.lowest_return, settings.ground_slope)
    if said is not None or settings.ground_slope:
        return said
    return _stopped_short(state, now, settings.keep_out_below, navigator, guidance, sensing)


def _stopped_short(
    state: VehicleState, now: int, keep_out: float, navigator: Navigator, guidance: Guidance, sensing: Sensing
) -> Announcement | None:
    """The descent to where a parcel is released ends so far (m) above what stands there, and the mission goes on from
    there. Not if there are curves in what follows."""
    step = navigator.step
    if step.phase is not Phase.DESCEND or not keep_out:  # almost always
        return None
    standing, rest = sensing.below.standing(now), navigator.steps[navigator.step_index + 1 :]
    if standing is None or any(each.curve for each in rest):
        return None
    assert step.target_ned is not None
    north, east, wanted = step.target_ned.tolist()
    down = max(standing - keep_out, float(state.position_ned[2]))
    if wanted - down < _SHORT_M:
        return None
    short = replace(step, target_ned=navigator.planned(np.array((north, east, down))))
    navigator.fly((short, *rest), now, state.position_ned)
    guidance.begin_leg(navigator.leg(state.position_ned), now)
    return Announcement(Severity.WARNING, f"something stands below: the descent ends {standing - down:.1f} m above it")


def ordered(
    event: Operation, link: VehicleLink, navigator: Navigator, guidance: Guidance, sensing: Sensing
) -> Announcement | None:
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
    link.requests.forget(VehicleRequest.RELEASE)  # what came of an earlier delivery says nothing of the next one
    guidance.begin_leg(navigator.leg(here), now)
    return said


def unheeded(event: Operation, state: State) -> Announcement | None:
    """What is to be said of a request to land, in a state, that nothing follows from."""
    if not isinstance(event, LandRequest) or state is not State.WATCH:
        return None
    text = "its own failsafe has the vehicle, which is left to it (interrupt again to abandon)"
    return Announcement(Severity.NOTICE, text)


def released(link: VehicleLink, navigator: Navigator, now: int) -> tuple[Arrival, Announcement | None]:
    """Ask the vehicle to release the parcel: what has come of it, and what is to be said of that."""
    link.request(VehicleRequest.RELEASE, now)
    arrival, said = navigator.release(link.requests.answer(VehicleRequest.RELEASE))
    if arrival is Arrival.DONE:  # which says nothing of the next parcel
        link.requests.forget(VehicleRequest.RELEASE)
    return arrival, said


def _released_at_last(link: VehicleLink, navigator: Navigator) -> Announcement | None:
    """A release that was asked for when something else ended the mission may have been answered since; what is to be
    said of it."""
    if navigator.phase is not Phase.RELEASE:
        return None
    answer = link.requests.answer(VehicleRequest.RELEASE)
    return navigator.release(answer)[1] if answer.accepted else None


def taken_up(
    plan: PlanResult, state: VehicleState, now: int, navigator: Navigator, guidance: Guidance, supervisor: Supervisor
) -> tuple[Announcement, ...]:
    """Fly along a plan, or give the step up that it comes no nearer to the end of; what is to be said of it."""
    leg = navigator.leg(state.position_ned)
    guidance.take_up(plan, leg, now)
    if not guidance.over_map or not leg.step.avoids or supervisor.state is not State.FLY:
        return ()
    judgement = navigator.judge(state.position_ned, plan.path.detour, now)
    if judgement.failure is not None:
        supervisor.failed(judgement.failure)
        guidance.begin_leg(navigator.leg(state.position_ned), now)
    return judgement.announcements
