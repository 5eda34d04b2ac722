"""A spinning LiDAR and two range finders, as OBSTACLE_DISTANCE and DISTANCE_SENSOR report them.

A scan is OBSTACLE_DISTANCE in MAV_FRAME_BODY_FRD: 72 sectors of 5 degrees, sector 0 centred on forward, clockwise seen
from above. The scan plane is the body's, so it tilts with the vehicle and may meet the ground.
"""

import math
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from protocol import frames
from protocol.arrays import Array
from protocol.jit import compiled
from protocol.vehicle_parameters import NotNegative, Positive
from vehicle_sim.world import World
from vehicle_sim.world.geometry import cast_ray, ray_box, ray_cylinder, ray_ground

SECTORS = 72
SECTOR_DEG = 5.0
UNKNOWN = 65535
"""OBSTACLE_DISTANCE's UINT16_MAX: no measurement in this sector."""

_SECTOR = math.radians(SECTOR_DEG)
_UPRIGHT = 0.1
"""Cosine of the tilt below which the scan plane is too steep for culling by bearing."""


class LidarSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[lidar]` table of a vehicle file."""

    min_range_m: Annotated[float, msgspec.Meta(ge=0.01)] = 0.2
    max_range_m: Annotated[float, msgspec.Meta(gt=0, le=655.0)] = 15.0
    rate_hz: Positive = 15.0
    noise_m: NotNegative = 0.02
    """Standard deviation of a reported range."""
    field_of_view_deg: Annotated[float, msgspec.Meta(gt=0, le=360)] = 360.0
    """Centred on forward; sectors with their centre outside it are unknown."""
    dropout: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0
    """Probability that a sector of a scan is unknown."""
    beams_per_sector: Annotated[int, msgspec.Meta(ge=1, le=100)] = 5
    """Evenly spread over a sector, which reports their nearest return."""
    latency_s: NotNegative = 0.02
    """Age of a scan when it is sent."""

    def __post_init__(self) -> None:
        if not self.min_range_m < self.max_range_m:
            raise ValueError(f"max_range_m: {self.max_range_m} is not above min_range_m {self.min_range_m}")

    @property
    def min_range_cm(self) -> int:
        return round(self.min_range_m * 100.0)

    @property
    def max_range_cm(self) -> int:
        """A reported distance one above it means that there was no return."""
        return round(self.max_range_m * 100.0)


class Lidar:
    """The sensor with its noise.

    Each scan and each beam draws the same amount of noise whatever it meets, so that a change in the world leaves the
    noise of later scans as it was.
    """

    def __init__(self, settings: LidarSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        azimuths = beam_azimuths(settings.beams_per_sector)
        self._cos, self._sin = np.cos(azimuths), np.sin(azimuths)
        centres_deg = np.arange(SECTORS) * SECTOR_DEG
        self._out_of_view = np.minimum(centres_deg, 360.0 - centres_deg) > 0.5 * settings.field_of_view_deg + 1e-9

    def scan(self, world: World, position_ned: Array, attitude_ned_frd: Array) -> NDArray[np.uint16]:
        """One scan from a position (3,) and attitude (4,): distances (72,) in cm as in OBSTACLE_DISTANCE.

        They are at least `min_range_cm`; `max_range_cm + 1` means no return, 65535 unknown (out of view, dropped out).
        """
        s = self.settings
        ranges = sector_ranges(
            world.boxes, world.cylinders, position_ned, attitude_ned_frd, self._cos, self._sin, s.max_range_m
        )
        noise = self._rng.standard_normal(SECTORS)
        dropped = self._rng.random(SECTORS) < s.dropout
        # inf (no return) and a range that noise pushes out of range both become max_range_cm + 1
        distances_cm = np.rint(100.0 * (ranges + s.noise_m * noise))
        result = np.clip(distances_cm, s.min_range_cm, s.max_range_cm + 1).astype(np.uint16)
        result[dropped | self._out_of_view] = UNKNOWN
        return result

    def beam(self, world: World, position_ned: Array, direction_frd: Array, attitude_ned_frd: Array) -> float:
        """One range (m) from a position (3,) along a unit vector (3,) in body axes.

        It is at least `min_range_m`, and inf without a return within `max_range_m`.
        """
        s = self.settings
        noise = s.noise_m * self._rng.standard_normal()
        distance = beam_range(
            world.boxes, world.cylinders, position_ned, attitude_ned_frd, direction_frd, s.max_range_m
        )
        measured = max(distance + noise, s.min_range_m)
        return measured if measured <= s.max_range_m else math.inf


def beam_azimuths(beams_per_sector: int) -> Array:
    """Azimuths (rad, clockwise from forward) of a scan's beams, (72 * beams_per_sector,), sector by sector."""
    step = _SECTOR / beams_per_sector
    return step * np.arange(0.5, SECTORS * beams_per_sector, dtype=np.float64) - 0.5 * _SECTOR


@compiled
def beam_range(
    boxes: Array, cylinders: Array, position_ned: Array, attitude_ned_frd: Array, direction_frd: Array, max_range: float
) -> float:
    """Range (m) from a position (3,) along a unit vector (3,) in body axes, without noise; inf beyond `max_range`."""
    return cast_ray(boxes, cylinders, position_ned, frames.rotate(attitude_ned_frd, direction_frd), max_range)


@compiled
def sector_ranges(
    boxes: Array,
    cylinders: Array,
    position_ned: Array,
    attitude_ned_frd: Array,
    cos_azimuth: Array,
    sin_azimuth: Array,
    max_range: float,
) -> Array:
    """Nearest range (72,) (m) in each sector without noise; inf where nothing is within `max_range` (m).

    The beams are given by cosine and sine (n,) of their azimuths, see `beam_azimuths`. Each is cast only at obstacles
    whose bounding circles it can pass over, see `_beams_at`.
    """
    forward = frames.rotate(attitude_ned_frd, np.array([1.0, 0.0, 0.0]))
    right = frames.rotate(attitude_ned_frd, np.array([0.0, 1.0, 0.0]))
    beams = cos_azimuth.shape[0]
    ranges = np.empty(beams)
    for k in range(beams):
        down = cos_azimuth[k] * forward[2] + sin_azimuth[k] * right[2]
        ranges[k] = ray_ground(position_ned, down)
    for i in range(boxes.shape[0] + cylinders.shape[0]):
        is_box = i < boxes.shape[0]
        solid = boxes[i] if is_box else cylinders[i - boxes.shape[0]]
        radius = math.sqrt(solid[2] * solid[2] + solid[3] * solid[3]) if is_box else solid[2]
        north, east = solid[0] - position_ned[0], solid[1] - position_ned[1]
        reach = max_range + radius
        if north * north + east * east > reach * reach:
            continue
        first, count = _beams_at(north, east, radius, forward, right, beams)
        for j in range(first, first + count):
            k = j % beams
            dn = cos_azimuth[k] * forward[0] + sin_azimuth[k] * right[0]
            de = cos_azimuth[k] * forward[1] + sin_azimuth[k] * right[1]
            dd = cos_azimuth[k] * forward[2] + sin_azimuth[k] * right[2]
            hit = ray_box(solid, position_ned, dn, de, dd) if is_box else ray_cylinder(solid, position_ned, dn, de, dd)
            ranges[k] = min(ranges[k], hit)
    nearest = np.full(SECTORS, math.inf)
    for k in range(beams):
        if ranges[k] <= max_range:
            sector = k * SECTORS // beams
            nearest[sector] = min(nearest[sector], ranges[k])
    return nearest


@compiled
def _beams_at(north: float, east: float, radius: float, forward: Array, right: Array, beams: int) -> tuple[int, int]:
    """First beam, and number of beams, that can pass over a circle seen from above.

    The circle's centre is relative to the sensor (m); `forward` (3,) and `right` (3,) are the body's axes in the world.
    A beam's course over ground is cos(a) forward + sin(a) right. This linear map of the azimuth's unit vector keeps the
    sense of rotation while the vehicle is upright. So its inverse takes the circle's two tangents to the azimuths
    between which all beams over the circle lie. A steeper vehicle, or one inside the circle, gets all beams.
    """
    square = north * north + east * east
    determinant = forward[0] * right[1] - forward[1] * right[0]
    if square <= radius * radius or determinant < _UPRIGHT:
        return 0, beams
    tangent = math.sqrt(square - radius * radius)
    left_n, left_e = north * tangent + east * radius, east * tangent - north * radius
    right_n, right_e = north * tangent - east * radius, east * tangent + north * radius
    start = math.atan2(forward[0] * left_e - forward[1] * left_n, right[1] * left_n - right[0] * left_e)
    end = math.atan2(forward[0] * right_e - forward[1] * right_n, right[1] * right_n - right[0] * right_e)
    width = (end - start) % (2.0 * math.pi)
    per_radian = beams / (2.0 * math.pi)
    # one more beam on each side than needed, so that rounding can't lose a grazing hit
    first = math.floor((start + 0.5 * _SECTOR) * per_radian - 0.5)
    return first % beams, min(math.ceil(width * per_radian) + 2, beams)
