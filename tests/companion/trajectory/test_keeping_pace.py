"""The reference waits for a vehicle that does not keep up with it."""

from collections.abc import Callable

import numpy as np
import pytest

from companion.config import Trajectory
from companion.curves import Shape
from companion.state import Reference
from companion.trajectory import ReferenceGenerator, track_of

SETTINGS = Trajectory()
TICK = 4_000_000
SOMEWHERE = np.array([60.0, -80.0, -5.0])
CIRCLE = track_of(Shape(shape="circle", radius=3.0, speed=2.0, heading="along"), SETTINGS, np.radians(45.0))


def straight() -> ReferenceGenerator:
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(np.zeros(3), 0.0)
    generator.move_to(0, SOMEWHERE, 8.0, 1.5)
    return generator


def round_about() -> ReferenceGenerator:
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(CIRCLE.start_ned, 0.0)
    generator.follow(0, CIRCLE)
    return generator


def flown(generator: ReferenceGenerator, lead: Callable[[float], float], seconds: float) -> list[Reference]:
    """References at 250 Hz; `lead` (m) by time (s)."""
    found = []
    for now in range(0, round(seconds * 1e9), TICK):
        found.append(generator.at(now))
        generator.keep_pace(now, lead(now * 1e-9))
    return found


def places(references: list[Reference]) -> np.ndarray:
    return np.array([each.position_ned for each in references])


@pytest.mark.parametrize("motion", [straight, round_about])
def test_who_keeps_up_to_half_of_the_lead_is_not_waited_for(motion: Callable[[], ReferenceGenerator]) -> None:
    free, near = motion(), motion()
    for now in range(0, 6_000_000_000, TICK):
        assert near.keep_pace(now, 0.5 * SETTINGS.max_lead) == 1.0
        assert (near.at(now).rows == free.at(now).rows).all()


@pytest.mark.parametrize(("lead", "share"), [(1.25, 0.75), (1.5, 0.5), (1.9, 0.1)])
@pytest.mark.parametrize("motion", [straight, round_about])
def test_it_passes_through_the_same_places_so_much_slower(
    motion: Callable[[], ReferenceGenerator], lead: float, share: float
) -> None:
    slow, free = flown(motion(), lambda _: lead, 6.0), motion()
    assert motion().keep_pace(0, lead) == pytest.approx(share)
    for number in range(0, len(slow), 50):
        assert slow[number].position_ned == pytest.approx(free.at(round(share * number * TICK)).position_ned, abs=1e-6)


@pytest.mark.parametrize("motion", [straight, round_about])
def test_its_derivatives_are_those_of_the_slower_motion(motion: Callable[[], ReferenceGenerator]) -> None:
    rows = np.array([each.rows for each in flown(motion(), lambda _: 1.4, 6.0)])
    step = 10 * TICK * 1e-9
    for derivative in range(3):
        quotients = (rows[20:, derivative] - rows[:-20, derivative]) / (2.0 * step)
        assert np.percentile(np.abs(quotients - rows[10:-10, derivative + 1]), 95) < 0.05
    turned = (np.unwrap(rows[:, 5, 0])[20:] - np.unwrap(rows[:, 5, 0])[:-20]) / (2.0 * step)
    assert np.abs(turned - rows[10:-10, 5, 1]).max() < 0.01
    assert motion is straight or np.abs(rows[:, 5, 1]).max() > 0.3


@pytest.mark.parametrize("motion", [straight, round_about])
def test_it_stands_where_the_vehicle_is_farther_away_and_goes_on_afterwards(
    motion: Callable[[], ReferenceGenerator],
) -> None:
    waiting = places(flown(motion(), lambda time: 5.0 if 2.0 <= time < 4.0 else 0.0, 8.0))
    assert (waiting[510:1000] == waiting[510]).all()
    assert waiting[1100] != pytest.approx(waiting[510], abs=0.1)
    free = places(flown(motion(), lambda _: 0.0, 8.0))
    assert waiting[1500] == pytest.approx(free[1000], abs=0.05)


def test_it_is_at_the_goal_later_and_at_rest_only_then() -> None:
    generator = straight()
    flown(generator, lambda _: 1.5, 20.0)
    assert not generator.at_rest(20_000_000_000) and straight().at_rest(20_000_000_000)
    for now in range(20_000_000_000, 40_000_000_000, TICK):
        generator.keep_pace(now, 0.0)
    assert generator.at_rest(40_000_000_000)
    assert generator.at(40_000_000_000).position_ned == pytest.approx(SOMEWHERE)


def test_a_stop_begins_with_the_motion_as_it_was() -> None:
    """From 4 of 8 m/s it takes a quarter of the way."""
    generator = straight()
    flown(generator, lambda _: 1.5, 10.0)
    now = 10_000_000_000
    before = generator.at(now)
    assert np.linalg.norm(before.velocity_ned) == pytest.approx(4.0, rel=0.01)
    generator.brake(now)
    assert generator.at(now).velocity_ned == pytest.approx(before.velocity_ned, abs=1e-6)
    assert generator.keep_pace(now + TICK, 1.5) == 1.0
    speeds = [np.linalg.norm(generator.at(now + number * TICK).velocity_ned) for number in range(500)]
    assert np.abs(np.diff(speeds)).max() < 2.0 * SETTINGS.acceleration * TICK * 1e-9, "nor does it jump on the way"
    way = np.linalg.norm(generator.at(now + 10_000_000_000).position_ned - before.position_ned)
    assert 0.7 < way / (4.0**2 / (2.0 * SETTINGS.acceleration)) < 1.3


def test_another_goal_on_the_way_makes_no_jump() -> None:
    generator = straight()
    flown(generator, lambda _: 1.5, 10.0)
    now = 10_000_000_000
    before = generator.at(now)
    generator.move_to(now, np.array([60.0, 20.0, -5.0]), 8.0, 1.5)
    after = generator.at(now)
    assert after.rows[:3] == pytest.approx(before.rows[:3], abs=1e-6)


def test_almost_the_same_goal_changes_nothing_while_there_is_some_way_left() -> None:
    """Also where the motion would have been there if it had not waited."""
    generator = straight()
    flown(generator, lambda _: 1.5, 20.0)
    now = 20_000_000_000
    generator.move_to(now, SOMEWHERE + np.array([0.3, 0.0, 0.0]), 8.0, 1.5)
    generator.keep_pace(now, 0.0)
    assert generator.at(2 * now).position_ned == pytest.approx(SOMEWHERE)


def test_a_track_begins_at_its_beginning_after_the_motion_has_waited() -> None:
    generator = straight()
    flown(generator, lambda _: 1.5, 4.0)
    now = 4_000_000_000
    generator.keep_pace(now, 0.0)
    generator.hold_at(CIRCLE.start_ned, 0.0)
    generator.follow(now, CIRCLE)
    for later in range(0, 4_000_000_000, 50 * TICK):
        assert generator.at(now + later).rows == pytest.approx(round_about().at(later).rows)


def test_what_is_no_distance_makes_it_wait() -> None:
    assert straight().keep_pace(TICK, np.nan) == 0.0
