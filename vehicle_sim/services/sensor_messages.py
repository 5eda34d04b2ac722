"""The messages of the LiDAR and the range finders. Each has the time at which it was measured."""

import math

import numpy as np

from protocol.messages import Encoder, dialect
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.lidar import Lidar
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.world import Scene

_FORWARD_DOWN = (  # DISTANCE_SENSOR: id, orientation, direction in the body
    (0, dialect.MAV_SENSOR_ROTATION_NONE, np.array([1.0, 0.0, 0.0])),
    (1, dialect.MAV_SENSOR_ROTATION_PITCH_270, np.array([0.0, 0.0, 1.0])),
)


class Scans:
    """The measurements at the latest time that was asked for: the same for all links."""

    def __init__(self, lidar: Lidar, scene: Scene) -> None:
        self.settings = lidar.settings
        self._lidar = lidar
        self._scene = scene
        self._ring: tuple[int, list[int]] = (-1, [])
        self._beams: tuple[int, tuple[float, ...]] = (-1, ())

    def ring(self, pose: Motion) -> list[int]:
        """The scan around the vehicle (cm)."""
        if self._ring[0] != pose.time_ns:
            world = self._scene.at(pose.time_ns)
            scan = self._lidar.scan(world, np.array(pose.position_ned), np.array(pose.attitude_ned_frd))
            self._ring = (pose.time_ns, scan.tolist())
        return self._ring[1]

    def beams(self, pose: Motion) -> tuple[float, ...]:
        """The distances (m) forward and down."""
        if self._beams[0] != pose.time_ns:
            position, attitude = np.array(pose.position_ned), np.array(pose.attitude_ned_frd)
            world = self._scene.at(pose.time_ns)
            found = (self._lidar.beam(world, position, direction, attitude) for _, _, direction in _FORWARD_DOWN)
            self._beams = (pose.time_ns, tuple(found))
        return self._beams[1]


class SensorMessages:
    """Encoders, one a message."""

    def __init__(self, encoder: Encoder, scans: Scans) -> None:
        self._encode = encoder.encode_fields
        self._scans = scans

    def obstacle_distance(self, now: Snapshot) -> bytes:
        """The latest scan that is as old as the LiDAR's latency."""
        pose, settings = now.scanned, self._scans.settings
        return self._encode(
            dialect.MAVLink_obstacle_distance_message,
            pose.time_ns // 1000,
            dialect.MAV_DISTANCE_SENSOR_LASER,
            self._scans.ring(pose),
            5,
            settings.min_range_cm,
            settings.max_range_cm,
            5.0,
            0.0,
            dialect.MAV_FRAME_BODY_FRD,
        )

    def distance_sensor(self, now: Snapshot) -> bytes:
        """Two frames: forward, then downward. Without a return the distance is the maximum plus one."""
        pose, settings = now.scanned, self._scans.settings
        both = b""
        for (number, orientation, _), distance in zip(_FORWARD_DOWN, self._scans.beams(pose), strict=True):
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
