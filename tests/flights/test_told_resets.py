"""Joined hovers in which the vehicle's estimate is reset, and ODOMETRY says so: nothing in the world has moved."""

import math
from typing import Any

import numpy as np
import pytest

from companion.mission.plan import Mission, Waypoint
from protocol.messages import dialect
from studies.faults.changes import edited
from studies.faults.injector import Change
from studies.joined import Joined

AT_NS = 8_010_000_000
TOLD_TICKS = 10
"""Later the vehicle's next ODOMETRY has come, and a position after it."""
ALONE = 'avoidance.method="none"'


def reset(north: float, speed: float) -> Change:
    """From then on the vehicle's estimate is elsewhere (m), and as much faster (m/s), which its filter takes a second
    to forget."""

    def edit(message: Any, now_ns: int) -> bool:
        if now_ns >= AT_NS:
            left = math.exp(-(now_ns - AT_NS) * 1e-9)
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_ODOMETRY:
                message.reset_counter += 1
            else:
                message.x += north + speed * (1.0 - left)
                message.vx += speed * left
        return True

    return edited(edit, (dialect.MAVLINK_MSG_ID_ODOMETRY, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED))


def hovered(change: Change, *overrides: str) -> tuple[float, float, float]:
    """How far the vehicle went (m) and tilted (rad) in the second after the reset, and the greatest disturbance (m/s2)
    that was estimated from when it was told."""
    mission = Mission("hover", waypoints=[Waypoint(0.0, 0.0, 3.0, 20.0)], takeoff_height=3.0)
    joined = Joined(mission, overrides=(ALONE, *overrides), meddle=change, remembers=False)
    joined.fly(limit_s=AT_NS * 1e-9 + 1.0)
    truth, since = np.array(joined.truths), AT_NS // 4_000_000
    tilt = 2.0 * np.arcsin(np.hypot(truth[since:, 7], truth[since:, 8]))
    estimated = np.abs(joined.trace()["disturbance_ned"][np.array(joined.trace_ticks) > since + TOLD_TICKS])
    return float(np.linalg.norm(truth[since:, :3] - truth[since, :3], axis=1).max()), tilt.max(), estimated.max()


def test_a_small_reset_of_the_position_moves_and_tilts_nothing() -> None:
    moved, tilted, _ = hovered(reset(0.5, 0.0))
    assert moved < 0.05 and tilted < math.radians(6.0)
    moved, tilted, _ = hovered(reset(0.5, 0.0), "rates.odometry=0")
    assert moved > 0.3 and tilted > math.radians(15.0), "without the count it is flown after"


@pytest.mark.parametrize("speed", [1.0, -4.0])
def test_a_reset_of_the_velocity_is_no_wind(speed: float) -> None:
    """The vehicle has to fly by the new velocity; the disturbance is not taken for another one."""
    _, _, told = hovered(reset(0.0, speed))
    _, _, untold = hovered(reset(0.0, speed), "rates.odometry=0")
    assert told < 1.3 and told < 0.3 * untold
