"""The messages of the LiDAR and the range finders. Each has the time at which it was measured."""

import math

import numpy as np

from protocol.messages import Encoder, dialect
from vehicle_sim.sensors.lidar import Lidar
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.world import Scene

_FORWARD_DOWN = (  # DISTANCE_SENSOR: id, orientation, direction in the body
    (0, dialect.MAV_SENSOR_ROTATION_NONE, np.array([1.0, 0.0, 0.0])),
    (1, dialect.MAV_SENSOR_ROTATION_PITCH_270, np.array([0.0, 0.0, 1.0])),
)


class SensorMessages:
    """Encoders, one a message."""

    def __init__(self, encoder: Encoder, lidar: Lidar, scene: Scene) -> None:
        self._encode = encoder.encode_fields
        self._lidar = lidar
        self._scene = scene

    def obstacle_distance(self, now: Snapshot) -> bytes:
        """The latest scan that is as old as the LiDAR's latency."""
        pose, settings = now.scanned, self._lidar.settings
        world = self._scene.at(pose.time_ns)
        scan = self._lidar.scan(world, np.array(pose.position_ned), np.array(pose.attitude_ned_frd))
        return self._encode(
            dialect.MAVLink_obstacle_distance_message,
            pose.time_ns // 1000,
            dialect.MAV_DISTANCE_SENSOR_LASER,
            scan.tolist(),
            5,
            settings.min_range_cm,
            settings.max_range_cm,
            5.0,
            0.0,
            dialect.MAV_FRAME_BODY_FRD,
        )

    def distance_sensor(self, now: Snapshot) -> bytes:
        """Two frames: forward, then downward. Without a return the distance is the maximum plus one."""
        pose, settings = now.scanned, self._lidar.settings
        position, attitude = np.array(pose.position_ned), np.array(pose.attitude_ned_frd)
        world = self._scene.at(pose.time_ns)
        both = b""
        for number, orientation, direction in _FORWARD_DOWN:
            distance = self._lidar.beam(world, position, direction, attitude)
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
