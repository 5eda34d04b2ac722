"""Telemetry -> VehicleState: ages, order, the carry of the position, and poses of the past."""

import random
from itertools import pairwise

import numpy as np
import pytest

from companion.estimate import Estimator
from companion.reports import AttitudeReport, OdometryReport, PositionReport
from protocol.frames import from_euler

MS = 1_000_000


def attitude(boot_ms: int, yaw: float = 0.0) -> AttitudeReport:
    return AttitudeReport(boot_ms, from_euler(0.0, 0.0, yaw), np.zeros(3))


def position(boot_ms: int, north: float, speed: float = 2.0) -> PositionReport:
    return PositionReport(boot_ms, np.array([north, 0.0, -3.0]), np.array([speed, 0.0, 0.0]))


def test_nothing_is_known_before_both_have_come() -> None:
    estimator = Estimator()
    assert estimator.state() is None and estimator.age_ns(0) is None
    estimator.attitude(attitude(0), 0)
    assert estimator.state() is None
    estimator.position(position(0, 1.0), 0)
    assert estimator.state() is not None


def test_position_is_carried_to_the_attitudes_time() -> None:
    estimator = Estimator()
    estimator.position(position(1000, 1.0), 1000 * MS)
    estimator.attitude(attitude(1050), 1050 * MS)
    state = estimator.state()
    assert state is not None
    assert state.position_ned[0] == pytest.approx(1.1)
    assert state.position_age_ns == 50 * MS and state.time_ns == 1050 * MS
    estimator.attitude(attitude(9000), 9000 * MS)  # far too old to be carried all the way
    state = estimator.state()
    assert state is not None and state.position_ned[0] <= 2.0


def test_an_older_report_is_never_applied() -> None:
    estimator = Estimator()
    assert estimator.position(position(1000, 1.0), 0) and estimator.attitude(attitude(1000, 0.5), 0)
    assert not estimator.position(position(990, 5.0), 10 * MS)
    assert not estimator.attitude(attitude(990, 2.0), 10 * MS)
    state = estimator.state()
    assert state is not None and state.position_ned[0] == 1.0
    assert estimator.age_ns(20 * MS) == 20 * MS
    estimator.restart()
    assert estimator.attitude(attitude(5), 30 * MS)


def test_what_comes_once_more_is_as_old_as_it_was() -> None:
    """Something else of the same moment is news."""
    estimator = Estimator()
    assert estimator.position(position(1000, 1.0), 0) and estimator.attitude(attitude(1000), 0)
    for ms in range(10, 200, 10):
        assert not estimator.position(position(1000, 1.0), ms * MS)
        assert not estimator.attitude(attitude(1000), ms * MS)
    assert estimator.age_ns(200 * MS) == 200 * MS and estimator.lacks_position(200 * MS)
    assert estimator.position(position(1000, 1.1), 200 * MS) and estimator.attitude(attitude(1000, 0.1), 200 * MS)
    assert estimator.age_ns(200 * MS) == 0


def test_age_is_that_of_the_older_part() -> None:
    estimator = Estimator()
    estimator.attitude(attitude(0), 100 * MS)
    estimator.position(position(0, 0.0), 40 * MS)
    assert estimator.age_ns(140 * MS) == 100 * MS


def test_a_position_that_queued_up_is_as_old_as_its_stamp() -> None:
    """However often one comes."""
    estimator = Estimator()
    for ms in range(0, 2000, 20):
        estimator.attitude(attitude(ms), ms * MS)
        estimator.position(position(ms // 2, 0.001 * ms), ms * MS)
    assert estimator.age_ns(2000 * MS) == (20 + 990) * MS


def test_pose_of_a_scans_own_time() -> None:
    estimator = Estimator()
    assert estimator.pose_at(0) is None
    for boot_ms in range(0, 2000, 4):
        estimator.attitude(attitude(boot_ms), boot_ms * MS)
        estimator.position(position(boot_ms, boot_ms * 0.002), boot_ms * MS)
        estimator.state()
    for wanted_ms in (1000, 1501, 1996):
        pose = estimator.pose_at(wanted_ms * 1000)
        assert pose is not None and pose[0][0] == pytest.approx(wanted_ms * 0.002, abs=0.005)
    newest = estimator.pose_at(10**15)  # a sensor with a clock of its own
    assert newest is not None and newest[0][0] == pytest.approx(1996 * 0.002)


def test_the_clock_wraps_and_a_far_future_is_refused() -> None:
    estimator = Estimator()
    top = 0xFFFFFFFF
    estimator.attitude(attitude(top), 0)
    estimator.position(position(top, 1.0), 0)
    assert estimator.attitude(attitude(3), 4 * MS) and estimator.position(position(3, 1.01), 4 * MS)
    state = estimator.state()
    assert state is not None and state.position_age_ns == 0
    assert not estimator.position(position(1_000_000, 9.0), 8 * MS)
    assert estimator.position(position(7, 1.02), 8 * MS)


@pytest.mark.parametrize("by_ms", [-175, 160, 175])
def test_a_clock_that_is_set_is_no_lack_of_the_velocity(by_ms: int) -> None:
    estimator = Estimator(velocity_settling=0.5)
    estimator.begin(stands=False)
    for tick in range(100):
        if tick == 50:
            estimator.clock_set(by_ms)
        boot_ms = 1000 + 20 * tick + by_ms * (tick >= 50)
        assert estimator.attitude(attitude(boot_ms), 20_000_000 * tick)
        assert estimator.position(position(boot_ms, 0.01 * tick, 0.5), 20_000_000 * tick)
        state = estimator.state()
        assert state is not None and state.velocity_ned[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("interval_ms", "limit_ms"), [(4, 100), (20, 100), (33, 132), (50, 200), (100, 400), (200, 400)]
)
def test_a_position_is_late_by_its_usual_interval(interval_ms: int, limit_ms: int) -> None:
    estimator = Estimator()
    assert not estimator.lacks_position(10**10), "nothing is lost that never came"
    for ms in range(0, 200 * interval_ms, interval_ms):
        estimator.position(position(ms, 0.0), ms * MS)
    assert not estimator.lacks_position((ms + limit_ms - 1) * MS)
    assert estimator.lacks_position((ms + limit_ms + 1) * MS)


@pytest.mark.parametrize("hz", [10, 30, 50])
def test_losses_and_jitter_alone_make_no_position_late(hz: int) -> None:
    estimator, generator = Estimator(), random.Random(18)
    arrivals = sorted(
        1000 * n // hz + 50 + generator.randrange(-20, 21) for n in range(20 * hz) if generator.random() > 0.1
    )
    late = 0
    for ms, following in pairwise(arrivals):
        estimator.position(position(ms, 0.0), ms * MS)
        late += ms > 3000 and estimator.lacks_position((following - 1) * MS)
    assert late <= (1 if hz > 10 else 3), "where three in a row were lost"


def told(estimator: Estimator, counter: int, variance: float | None = None) -> bool:
    return estimator.odometry(OdometryReport(None if variance is None else np.full(3, variance), counter))


def resets(estimator: Estimator) -> int:
    state = estimator.state()
    assert state is not None
    return state.certainty.resets


def begun() -> Estimator:
    estimator = Estimator()
    estimator.attitude(attitude(0), 0)
    estimator.position(position(0, 0.0), 0)
    return estimator


def test_the_vehicles_certainty_is_that_of_the_state_and_the_same_until_it_says_more() -> None:
    estimator = begun()
    first = estimator.state()
    assert first is not None and not first.certainty.velocity_variance.any()
    told(estimator, 13, 0.01)
    second, third = estimator.state(), estimator.state()
    assert second is not None and third is not None and second.certainty is third.certainty
    assert second.certainty.velocity_variance.tolist() == [0.01] * 3
    told(estimator, 13)
    last = estimator.state()
    assert last is not None and not last.certainty.velocity_variance.any(), "it does not say it any more"


def test_a_reset_shows_at_once_and_at_the_next_position_which_may_be_the_first_after_it() -> None:
    estimator = begun()
    assert not told(estimator, 255) and resets(estimator) == 0, "the first count tells of none"
    assert told(estimator, 0) and resets(estimator) == 1
    estimator.position(position(4, 0.0), 4 * MS)
    assert resets(estimator) == 2
    estimator.position(position(8, 0.0), 8 * MS)
    assert not told(estimator, 0) and resets(estimator) == 2


def test_a_count_that_counts_on_and_on_says_nothing() -> None:
    estimator = begun()
    told(estimator, 0)
    assert [told(estimator, counter) for counter in range(1, 10)] == [True] * 3 + [False] * 6
    assert not told(estimator, 9) and told(estimator, 10)
