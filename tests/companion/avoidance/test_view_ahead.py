"""How far a leaning scan sees."""

import math

import numpy as np
import pytest

from companion.avoidance.view_ahead import ViewAhead
from protocol.frames import from_euler, to_world
from protocol.vehicle_parameters import GRAVITY

ABOVE, RING_NS = 1.5, 66_666_667
AHEAD = np.array((1.0, 0.0))


def looked(
    attitude: np.ndarray,
    rings: int = 100,
    above: float = ABOVE,
    seconds: float = 1.0,
    acceleration: tuple[float, float] = (0.0, 0.0),
) -> ViewAhead:
    """From 5 m/s to the north and east on, with an acceleration (m/s2)."""
    view = ViewAhead(seconds)
    for ring in range(rings):
        velocity = 5.0 + np.array(acceleration) * ring * RING_NS * 1e-9
        view.look(attitude, velocity, above, ring * RING_NS)
    return view


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sight_ends_where_a_beam_meets_the_ground(yaw: float, sign: float) -> None:
    """Against the beam itself, turned by the attitude: to all sides, for q and -q."""
    attitude = sign * from_euler(0.2, -0.4, yaw)
    ahead = looked(attitude)
    for bearing in np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False):
        beam = np.array(to_world(attitude, np.array((math.cos(bearing), math.sin(bearing), 0.0))))
        met = ABOVE * math.hypot(beam[0], beam[1]) / beam[2] if beam[2] > 0.0 else math.inf
        assert ahead.distance(3.0 * beam[:2]) == pytest.approx(met, rel=1e-2)


def test_a_level_scan_sees_to_its_end_and_who_stands_looks_nowhere() -> None:
    assert looked(from_euler(0.0, 0.0, 1.0)).distance(AHEAD) == math.inf
    assert looked(from_euler(0.0, -0.4, 0.0)).distance(np.zeros(2)) == math.inf
    assert ViewAhead(1.0).distance(AHEAD) == math.inf


def test_the_lean_is_averaged_over_a_second() -> None:
    leaning = from_euler(0.0, -0.4, 0.0)
    settled = ABOVE / math.tan(0.4)
    assert looked(leaning, rings=16).distance(AHEAD) == pytest.approx(settled / (1.0 - math.exp(-1.0)), rel=0.03)
    assert looked(leaning, seconds=0.0).distance(AHEAD) == math.inf


@pytest.mark.parametrize("forward", [4.0, -4.0])
@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_the_lean_of_an_acceleration_does_not_count(forward: float, yaw: float) -> None:
    """The vehicle leans by what accelerates it and by a drag of 2 m/s2, which is what counts, from the start."""
    ahead = np.array((math.cos(yaw), math.sin(yaw)))
    for rings in (20, 100):
        leaning = from_euler(0.0, -math.atan2(forward + 2.0, GRAVITY), yaw)
        view = looked(leaning, rings, acceleration=tuple(forward * ahead), seconds=0.3)
        assert view.distance(ahead) == pytest.approx(ABOVE / (2.0 / GRAVITY), rel=0.1)
        assert view.distance(-ahead) == math.inf


def test_what_is_below_the_ground_sees_nothing_and_without_a_ground_all_is_seen() -> None:
    leaning = from_euler(0.0, -0.4, 0.0)
    assert looked(leaning, above=-0.2).distance(AHEAD) == 0.0
    assert looked(leaning, above=math.inf).distance(AHEAD) == math.inf
