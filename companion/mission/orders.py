"""Orders: what a vehicle that waits in the air does next, from a program that commands it step by step."""

from dataclasses import replace
from typing import Literal

import msgspec
import numpy as np

from companion.config_types import Table
from companion.fence import Fence, first_beyond
from companion.mission.navigator import Navigator
from companion.mission.plan import Delivery, Mission, Phase, Step, delivery, steps, wait
from companion.state import Announcement
from protocol.arrays import Array


class Order(Table, frozen=True):
    """What is to be flown in place of the rest of the mission."""

    do: Literal["fly", "deliver", "hold", "land"]
    mission: Mission | None = None
    """What "fly" flies: its waypoints, as from the take-off, and what it does after them. The take-off is not flown
    again."""
    delivery: Delivery = Delivery()
    """What "deliver" does, below where the vehicle is."""


class OrderError(ValueError):
    """An order that can't be obeyed."""


def obey(text: str, navigator: Navigator, here_ned: Array, fence: Fence | None, now_ns: int) -> Announcement:
    """Let the navigator fly an order, which is an `Order` as JSON, from a place (3,), within the fence; what is to be
    said of it. Raises OrderError."""
    try:
        order = msgspec.json.decode(text, type=Order)
    except msgspec.MsgspecError as error:
        raise OrderError(str(error)) from None
    if not navigator.mission.waits:
        raise OrderError("this mission takes none")
    if navigator.phase in (Phase.PREPARE, Phase.TAKEOFF):
        raise OrderError("the take-off is not done")
    too_late = navigator.lands and order.do != "land"
    if too_late or navigator.cut_short or navigator.phase in (Phase.LAND, Phase.DONE):
        raise OrderError("the flight is ending")
    rest = _steps(order, navigator, here_ned)
    if any(step.curve is not None for step in rest):
        raise OrderError("a curve is flown from the take-off on alone")
    if fence is not None:
        places = ((step.phase.name.lower(), step.target_ned) for step in rest if step.target_ned is not None)
        beyond = first_beyond(fence, places)
        if beyond is not None:
            raise OrderError(beyond)
    return navigator.fly(rest, now_ns, here_ned)


def _steps(order: Order, navigator: Navigator, here_ned: Array) -> list[Step]:
    if order.do == "land":
        return [Step(Phase.LAND)]
    home = navigator.steps[0].target_ned
    assert home is not None
    start = np.array([*home[:2], navigator.ground_down])
    if order.do == "fly":
        if order.mission is None:
            raise OrderError("there is no mission to fly")
        speed = order.mission.speed
        return [replace(step, speed=step.speed or speed) for step in steps(order.mission, start)[1:]]
    waits_at = navigator.step.target_ned if navigator.phase is Phase.WAIT else None
    here = navigator.planned(here_ned if waits_at is None else waits_at)
    low = delivery(order.delivery, here, start) if order.do == "deliver" else []
    return [*low, wait(here), Step(Phase.LAND)]
