"""What stands below, by a range finder that looks down: believed once it has shown the ground."""

import math

import numpy as np
import pytest

from companion.perception.surface_below import SurfaceBelow
from companion.reports import RangeBelow
from companion.state import Pose

LOWEST = -0.5
"""m, NED: what is lower is the ground, at 0."""
PERIOD_NS = 100_000_000


def pose(down: float, roll_deg: float = 0.0) -> Pose:
    half = math.radians(roll_deg) / 2.0
    return np.array((0.0, 0.0, down)), np.array((math.cos(half), math.sin(half), 0.0, 0.0))


def begun(*, proven: bool = True) -> SurfaceBelow:
    """In the air, with two readings of the ground if it is `proven`."""
    below = SurfaceBelow()
    below.begin()
    below.lowest = LOWEST
    for k in range(2 * proven):
        below.take(RangeBelow(0, 3.0), pose(-3.0), k * PERIOD_NS)
    return below


def test_the_ground_does_not_stand() -> None:
    assert begun().standing(PERIOD_NS) is None


def test_two_readings_show_what_stands_and_one_does_not() -> None:
    below = begun()
    below.take(RangeBelow(0, 2.0), pose(-3.0), 2 * PERIOD_NS)
    assert below.standing(2 * PERIOD_NS) is None
    below.take(RangeBelow(0, 1.5), pose(-2.4), 3 * PERIOD_NS)
    assert below.standing(3 * PERIOD_NS) == pytest.approx(-0.9), "the lower of both"
    assert below.standing(3 * PERIOD_NS + 600_000_000) is None, "stale"


def test_a_tilted_beam_is_projected_and_a_steep_one_ignored() -> None:
    below = begun()
    for k, roll_deg in enumerate((20.0, 20.0, 40.0)):
        below.take(RangeBelow(0, 2.0 / math.cos(math.radians(20.0))), pose(-3.0, roll_deg), (2 + k) * PERIOD_NS)
    assert below.standing(4 * PERIOD_NS) == pytest.approx(-1.0)


def test_a_beam_that_meets_the_vehicle_itself_is_never_believed() -> None:
    """A parcel that hangs 0.3 m below, in a climb and a descent; nor a sensor that never meets anything."""
    for distance in (0.3, math.inf):
        below = begun(proven=False)
        for k, down in enumerate((*np.arange(0.0, -3.0, -0.1), *np.arange(-3.0, -1.0, 0.1))):
            below.take(RangeBelow(0, distance), pose(float(down)), k * PERIOD_NS)
            assert below.standing(k * PERIOD_NS) is None


def test_on_the_ground_a_reading_proves_nothing() -> None:
    below = begun(proven=False)
    below.take(RangeBelow(0, 1.2), pose(-1.2), 0)
    for k in (1, 2):
        below.take(RangeBelow(0, 0.3), pose(-1.2), k * PERIOD_NS)
    assert below.standing(2 * PERIOD_NS) is None


def test_nothing_within_reach_is_nothing_that_stands() -> None:
    below = begun()
    for k in (2, 3):
        below.take(RangeBelow(0, math.inf), pose(-30.0), k * PERIOD_NS)
    assert below.standing(3 * PERIOD_NS) is None


def test_without_a_pose_or_before_a_flight_nothing_is_known() -> None:
    below = begun()
    below.take(RangeBelow(0, 1.0), None, 2 * PERIOD_NS)
    assert below.standing(2 * PERIOD_NS) is None
    below = SurfaceBelow()
    for k in (0, 1):
        below.take(RangeBelow(0, 1.0), pose(-3.0), k * PERIOD_NS)
    assert below.standing(PERIOD_NS) is None
