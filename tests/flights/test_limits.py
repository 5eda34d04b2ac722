"""Whole flights at their limits: batteries that do not suffice."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from companion.mission.plan import Mission, Phase, Waypoint
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined, mission_of
from vehicle_sim.physics.battery import battery_state

ERRAND = mission_of("errand")
QUICK = ('avoidance.method="paper"',)
STRAIGHT = Mission(name="straight", waypoints=[Waypoint(75.0, 0.0, 5.0), Waypoint(75.0, 75.0, 5.0)], speed=5.0)
FREE = ('avoidance.method="none"',)


def charge_of(joined: Joined) -> float:
    return battery_state(joined.vehicle.airframe, joined.vehicle.motion).remaining


def words(joined: Joined, text: str) -> int:
    return sum(text in each for each in joined.said)


def reporting(change: Callable[[int, Any], bool]) -> Callable[[int, bytes], bytes]:
    """A meddler that changes what is said of the battery; False: it is not said."""
    encoder = Encoder(1, 1)

    def meddle(time_ns: int, data: bytes) -> bytes:
        out = b""
        for frame in Framer().datagram(data):
            if frame.message_id not in (
                dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
                dialect.MAVLINK_MSG_ID_SYS_STATUS,
            ):
                out += frame.raw
                continue
            message: Any = decode(frame)
            if change(time_ns, message):
                encoder.sequence = frame.sequence
                out += encoder.encode(message)
        return out

    return meddle


def test_a_courier_whose_battery_does_not_suffice_comes_home_with_the_parcel() -> None:
    vehicle = ("battery.charge=0.17", "battery.capacity_wh=20")
    joined = Joined(ERRAND, overrides=QUICK, vehicle_overrides=vehicle).fly()
    summary, fault = joined.vehicle.summary(), joined.autopilot.supervisor.fault
    assert fault == "returned: battery at 14 %" and not joined.autopilot.navigator.released
    assert summary.outcome == "landed" and summary.contacts == 0
    assert np.hypot(*summary.final_position_ned[:2]) < 0.3
    assert words(joined, "returning") == 1


def test_with_less_it_lands_before_the_battery_is_empty() -> None:
    vehicle = ("battery.charge=0.25", "battery.capacity_wh=12")
    settings = (*FREE, "battery.way_home_margin=0.0")
    joined = Joined(STRAIGHT, overrides=settings, vehicle_overrides=vehicle).fly()
    summary, fault = joined.vehicle.summary(), joined.autopilot.supervisor.fault
    assert summary.outcome == "landed" and charge_of(joined) > 0.0
    assert fault is not None and fault.startswith("returned: battery at 1"), "the first one counts"
    assert words(joined, "%: returning") == 1 and words(joined, "%: landing") == 1
    assert np.hypot(*summary.final_position_ned[:2]) > 5.0


def test_it_turns_back_in_time_for_the_way_home() -> None:
    """Far above any threshold; without the estimate it would have to land on the way."""
    vehicle = ("battery.charge=0.6", "battery.capacity_wh=7.5")
    joined = Joined(STRAIGHT, overrides=FREE, vehicle_overrides=vehicle).fly()
    summary, fault = joined.vehicle.summary(), joined.autopilot.supervisor.fault
    assert fault is not None and "needed for the way home" in fault
    assert summary.outcome == "landed" and np.hypot(*summary.final_position_ned[:2]) < 0.3
    assert 0.05 < charge_of(joined) < 0.25


def test_a_low_battery_on_the_way_home_is_said_and_cuts_nothing() -> None:
    vehicle = ("battery.charge=0.17", "battery.capacity_wh=40")
    joined = Joined(ERRAND, overrides=QUICK, vehicle_overrides=vehicle).fly()
    assert joined.autopilot.supervisor.fault is None and joined.autopilot.navigator.released
    assert words(joined, "battery at 14 %") == 1 and words(joined, "returning") == 0


def test_from_low_at_the_delivery_it_climbs_first() -> None:
    """The battery says that it is in a critical state as soon as the descent has begun."""
    seen: list[float] = []

    def critical(time_ns: int, message: Any) -> bool:
        if seen and message.get_type() == "BATTERY_STATUS":
            message.charge_state = dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL
        return True

    joined = Joined(ERRAND, overrides=QUICK, meddle=reporting(critical))
    joined.fly(until=lambda flight: flight.autopilot.navigator.phase is Phase.DESCEND)
    seen.append(joined.vehicle.time_ns)
    joined.fly(until=lambda flight: flight.autopilot.navigator.phase is Phase.RETURN)
    assert -joined.vehicle.motion.position_ned[2] > 2.5, "it is at the route's height again"
    joined.fly()
    assert joined.autopilot.supervisor.fault == "returned: battery critical"
    assert not joined.autopilot.navigator.released
    assert np.hypot(*joined.vehicle.summary().final_position_ned[:2]) < 0.3


def test_a_track_is_left_for_the_way_home() -> None:
    joined = Joined(
        mission_of("circle"), overrides=FREE, vehicle_overrides=("battery.charge=0.17", "battery.capacity_wh=20")
    ).fly()
    assert joined.autopilot.supervisor.fault == "returned: battery at 14 %"
    assert joined.vehicle.summary().outcome == "landed"
    assert np.hypot(*joined.vehicle.summary().final_position_ned[:2]) < 0.3


def test_no_flight_begins_with_a_low_battery() -> None:
    soon = (*QUICK, "supervision.ready_timeout=5.0")
    joined = Joined(ERRAND, overrides=soon, vehicle_overrides=("battery.charge=0.12",)).fly()
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and "battery at 12 %" in fault and joined.vehicle.flight.airborne_ns == 0


@pytest.mark.parametrize("required", ["true", "false"])
def test_a_vehicle_that_says_nothing_of_its_battery(required: str) -> None:
    settings = (*FREE, "supervision.ready_timeout=5.0", f"battery.required={required}")
    joined = Joined(mission_of("hover"), overrides=settings, meddle=reporting(lambda now, message: False)).fly()
    fault = joined.autopilot.supervisor.fault
    if required == "true":
        assert fault == "not started: not ready: no battery reports its charge"
    else:
        assert fault is None and words(joined, "no battery reports its charge") == 1


def test_a_recovering_battery_does_not_call_the_return_off() -> None:
    """It recovers by a fifth as soon as it is on the way home."""
    returns: list[int] = []

    def recovering(time_ns: int, message: Any) -> bool:
        message.battery_remaining = 40 if returns else 14 if time_ns > 7e9 else 80
        return True

    joined = Joined(ERRAND, overrides=QUICK, meddle=reporting(recovering))
    joined.fly(until=lambda flight: words(flight, "returning") > 0)
    returns.append(joined.vehicle.time_ns)
    joined.fly()
    assert joined.autopilot.supervisor.fault == "returned: battery at 14 %"
    assert np.hypot(*joined.vehicle.summary().final_position_ned[:2]) < 0.3
