"""The clearance monitor against a measurement at every tick."""

import numpy as np
import pytest

from tests.vehicle_sim.foreign_pilot import world_with_wall
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import STATES
from vehicle_sim.world.clearance import ClearanceMonitor

WALL = world_with_wall(8.0)
HULL_M = 0.36


@pytest.mark.parametrize("seed", range(5))
def test_the_least_clearance_is_that_of_a_measurement_at_each_tick(seed: int) -> None:
    rng = np.random.default_rng(seed)
    monitor = ClearanceMonitor(HULL_M)
    state, least, collision = np.zeros(STATES), np.inf, None
    state[2], state[6] = -2.0, 1.0
    before = Motion.of(0, state, np.zeros(1, FEEDBACK))
    velocity = np.zeros(3)
    for tick in range(3000):
        velocity += rng.normal(0.0, 0.01, 3) - 0.01 * (velocity + 0.01 * (state[:3] - (6.0, 0.0, -2.0)))
        state[:3] += velocity
        now = Motion.of(tick, state, np.zeros(1, FEEDBACK))
        clearance = WALL.clearance(state[:3]) - HULL_M
        least = min(least, clearance)
        monitor.move(before, now)
        collision = monitor.collision(WALL, state[:3])
        assert monitor.least_m == pytest.approx(least, abs=1e-9)
        assert (collision is not None) == (clearance <= 0.0)
        if collision is not None:
            assert collision == "wall"
            break
        before = now


def test_a_changed_world_is_measured_at_once() -> None:
    """The vehicle has been near the wall and is far from it now, so that it would not measure soon."""
    monitor = ClearanceMonitor(HULL_M)
    near, far = np.array([5.0, 0.0, -2.0]), np.array([0.0, 0.0, -2.0])
    assert monitor.collision(WALL, near) is None
    assert monitor.collision(WALL, far) is None
    assert monitor.least_m == pytest.approx(2.5 - HULL_M)
    assert monitor.collision(world_with_wall(0.4), far) is None
    monitor.invalidate()
    assert monitor.collision(world_with_wall(0.4), far) == "wall"
