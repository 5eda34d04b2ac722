"""Flights between posts with eight sectors as ArduPilot fills them from a LiDAR that turns ten times a second.

Each sector is as old as the beam's last visit, up to a turn, and carries the time of sending. One that is entered from
an empty sector is empty until the beam leaves it; the one that became empty keeps its last return for a second. Source:
AP_Proximity_RPLidarA2.cpp and AP_Proximity_Boundary_3D.cpp of ArduPilot 4.7, flown in its own simulation.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from protocol.arrays import Array
from protocol.frames import to_world
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined
from studies.worlds import Site
from tests.flights.short import landing
from vehicle_sim.timing import TICK_NS

RADIUS, REACH, KEPT_MS, REPORT_MS = 1.0, 16.0, 1000, 65
POSTS = np.array([(north, east) for north in range(-15, 46, 10) for east in (-20, -10, 0, 10, 20)], float)
"""m; a row of them stands on the way."""
REPLACED = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE


def seen(north: float, east: float, bearing: float) -> float:
    """m to the nearest post along a bearing (rad); inf if there is none."""
    to_north, to_east = POSTS[:, 0] - north, POSTS[:, 1] - east
    along = to_north * math.cos(bearing) + to_east * math.sin(bearing)
    aside = to_north**2 + to_east**2 - along**2
    met = (along > 0.0) & (aside < RADIUS**2)
    return float(np.min(along[met] - np.sqrt(RADIUS**2 - aside[met]), initial=math.inf))


class Driver:
    """The sectors, and the beam that fills them."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._beam_deg = self._rng.uniform(0.0, 360.0)
        self._sector, self._nearest = 0, math.inf
        self.ranges = np.full(8, math.inf)
        self._filled_ms = np.zeros(8)

    def turn(self, state: Array, now_ms: int) -> None:
        """3.6 degrees a millisecond, for a tick; `state` (17,) is the vehicle's."""
        ahead = to_world(state[6:10], (1.0, 0.0, 0.0))
        yaw = math.atan2(ahead[1], ahead[0])
        for _ in range(TICK_NS // 1_000_000):
            self._beam_deg = (self._beam_deg + 3.6) % 360.0
            sector = int((self._beam_deg + 22.5) % 360.0 / 45.0)
            if sector != self._sector:
                if self._nearest < REACH:
                    self.ranges[self._sector], self._filled_ms[self._sector] = self._nearest, now_ms
                else:
                    self.ranges[sector] = math.inf  # the wrong one, as there
                self._sector, self._nearest = sector, math.inf
            at = seen(float(state[0]), float(state[1]), yaw + math.radians(self._beam_deg))
            self._nearest = min(self._nearest, at + self._rng.normal(0.0, 0.01))
        self.ranges[now_ms - self._filled_ms > KEPT_MS] = math.inf


class Spinning:
    """A meddler that hands rings on as these sectors."""

    def __init__(self, seed: int) -> None:
        self._encoder, self._driver = Encoder(1, 1), Driver(seed)
        self.joined: Joined | None = None
        self._next_ms, self._now_ms = 0, -1
        self._ever = np.zeros(8, bool)
        self.vanished = 0
        """Times that a sector in which something stands was empty."""

    def __call__(self, time_ns: int, data: bytes) -> bytes:
        parts = []
        for frame in Framer().datagram(data):
            if frame.message_id == dialect.MAVLINK_MSG_ID_SYS_STATUS:
                message = decode(frame)
                for name in ("present", "enabled", "health"):
                    bits = getattr(message, f"onboard_control_sensors_{name}")
                    setattr(message, f"onboard_control_sensors_{name}", bits | dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY)
                parts.append(self._encoder.encode(message))
            elif frame.message_id not in REPLACED:
                parts.append(frame.raw)
        return b"".join(parts) + self._report(time_ns // 1_000_000)

    def _report(self, now_ms: int) -> bytes:
        assert self.joined is not None
        if now_ms == self._now_ms:
            return b""
        self._now_ms, state = now_ms, self.joined.vehicle.state
        self._driver.turn(state, now_ms)
        there = self._driver.ranges < REACH
        if now_ms < self._next_ms or not there.any():
            return b""
        self._next_ms = now_ms + REPORT_MS
        self._ever |= there
        self.vanished += int(np.sum(self._ever & ~there))
        return b"".join(
            self._encoder.encode_fields(
                dialect.MAVLink_distance_sensor_message,
                *(now_ms, 20, 1600, round(100.0 * min(self._driver.ranges[k], REACH)), 0, 10 + k, k, 0),
                *(0.0, 0.0, (0.0,) * 4, 0),
            )
            for k in range(8)
            if self._ever[k]
        )


def site() -> Site:
    """Along the row."""
    posts = [
        {"name": f"post {k}", "center": place.tolist(), "radius": RADIUS, "height": 8.0}
        for k, place in enumerate(POSTS)
    ]
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 500.0}
    return Site("posts", {"name": "posts", "origin": origin, "cylinder": posts}, ((20.0, 0.0),))


@pytest.mark.parametrize(("speed", "seed"), [(4.0, 3), (2.0, 4)])
def test_posts_on_the_way_are_kept_clear_of(speed: float, seed: int, tmp_path: Path) -> None:
    """At 4 m/s they were hit, as long as an empty sector was believed at once and at its stamp."""
    meddle = Spinning(seed)
    mission = site().mission(speed, site().save(tmp_path)[0])
    overrides = ("avoidance.map.cells=192",)
    joined = Joined(mission, None, overrides, meddle=meddle, seed=seed, remembers=False)
    meddle.joined = joined
    joined.fly(limit_s=5.0, until=lambda each: each.autopilot.link.firmware is not None)
    joined.autopilot.link.telemetry.rings.silent_when_free = True
    joined.fly(limit_s=120.0, until=landing)
    track = np.array(joined.truths)
    gaps = np.hypot(*(track[:, None, :2] - POSTS).transpose(2, 0, 1)).min(axis=1) - RADIUS
    assert joined.vehicle.summary().contacts == 0 and landing(joined)
    assert math.dist(track[-1, :2], site().goal) < 0.5 and joined.autopilot.supervisor.fault is None
    assert gaps.min() > 0.8 and meddle.vanished > 20
