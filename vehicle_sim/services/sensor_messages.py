"""The messages of the LiDAR and the range finders. Each has the time at which it was measured."""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Array
from protocol.messages import Encoder, dialect
from vehicle_sim.estimation.delayed_truth import DelayedTruth
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.faults import Fault
from vehicle_sim.sensors.lidar import SECTORS, UNKNOWN, Lidar
from vehicle_sim.services.snapshot import NOTHING, Snapshot
from vehicle_sim.world import Scene

_FORWARD_DOWN = (  # DISTANCE_SENSOR: id, orientation, direction in the body
    (0, dialect.MAV_SENSOR_ROTATION_NONE, np.array([1.0, 0.0, 0.0])),
    (1, dialect.MAV_SENSOR_ROTATION_PITCH_270, np.array([0.0, 0.0, 1.0])),
)


_WRONG_RANGE_M = 3.0
"""By how much a failed LiDAR is wrong."""


class Scans:
    """The measurements at the latest time that was asked for: the same for all links."""

    def __init__(self, lidar: Lidar, scene: Scene, rng: np.random.Generator) -> None:
        self.settings = lidar.settings
        self._lidar = lidar
        self._scene = scene
        self._ring: tuple[int, list[int] | None] = (-1, None)
        self._beams: tuple[int, tuple[float, ...]] = (-1, ())
        self.faults = Fault(np.full(SECTORS, 100.0 * _WRONG_RANGE_M), rng), Fault(np.full(2, _WRONG_RANGE_M), rng)
        """What is wrong with the scan, and with the two beams."""

    @property
    def silent(self) -> bool:
        """There was nothing to tell the last time."""
        return self._ring[0] >= 0 and self._ring[1] is None

    def ring(self, pose: Motion) -> list[int] | None:
        """The scan around the vehicle (cm); None: there is none."""
        if self._ring[0] != pose.time_ns:
            world = self._scene.at(pose.time_ns)
            scan = self._lidar.scan(world, np.array(pose.position_ned), np.array(pose.attitude_ned_frd))
            read = self.faults[0].read(scan.astype(float), pose.time_ns)
            self._ring = (pose.time_ns, None if read is None else self._told(read))
        return self._ring[1]

    def _told(self, scan_cm: Array) -> list[int]:
        """Within what the message can say."""
        s = self.settings
        clipped = np.clip(np.rint(scan_cm), s.min_range_cm, s.max_range_cm + 1)
        told: list[int] = np.where(scan_cm >= UNKNOWN, UNKNOWN, clipped).astype(int).tolist()
        return told

    def beams(self, pose: Motion) -> tuple[float, ...]:
        """The distances (m) forward and down; empty: there are none."""
        if self._beams[0] != pose.time_ns:
            position, attitude = np.array(pose.position_ned), np.array(pose.attitude_ned_frd)
            world = self._scene.at(pose.time_ns)
            found = (self._lidar.beam(world, position, direction, attitude) for _, _, direction in _FORWARD_DOWN)
            read = self.faults[1].read(np.array(tuple(found)), pose.time_ns)
            self._beams = (pose.time_ns, () if read is None else tuple(read.tolist()))
        return self._beams[1]

    def down(self, pose: Motion) -> tuple[int, float]:
        """The time (ns) of the beam downward and its distance (m); inf without a return or without the sensor."""
        return pose.time_ns, (self.beams(pose) or (math.inf,))[-1]


class Senses(NamedTuple):
    """What the vehicle knows of itself and of its surroundings."""

    scans: Scans
    estimator: DelayedTruth | Estimator


class SensorMessages:
    """Encoders, one a message."""

    def __init__(self, encoder: Encoder, scans: Scans) -> None:
        self._encode = encoder.encode_fields
        self._scans = scans

    def obstacle_distance(self, now: Snapshot) -> bytes:
        """The latest scan that is as old as the LiDAR's latency."""
        pose, settings = now.scanned, self._scans.settings
        ring = self._scans.ring(pose)
        if ring is None:
            return NOTHING
        return self._encode(
            dialect.MAVLink_obstacle_distance_message,
            pose.time_ns // 1000,
            dialect.MAV_DISTANCE_SENSOR_LASER,
            ring,
            5,
            settings.min_range_cm,
            settings.max_range_cm,
            5.0,
            0.0,
            dialect.MAV_FRAME_BODY_FRD,
        )

    def distance_sensor(self, now: Snapshot) -> bytes:
        """Two frames: forward, then downward; none of a sensor that is off. Without a return the distance is the
        maximum plus one."""
        pose, settings = now.scanned, self._scans.settings
        both = b""
        for (number, orientation, _), distance in zip(_FORWARD_DOWN, self._scans.beams(pose), strict=False):
            near, far = settings.min_range_cm, settings.max_range_cm
            both += self._encode(
                dialect.MAVLink_distance_sensor_message,
                pose.time_ns // 1_000_000 & 0xFFFFFFFF,
                near,
                far,
                min(max(round(distance * 100.0), near), far) if math.isfinite(distance) else far + 1,
                dialect.MAV_DISTANCE_SENSOR_LASER,
                number,
                orientation,
                255,
                0.0,
                0.0,
                (0.0,) * 4,
                0,
            )
        return both
