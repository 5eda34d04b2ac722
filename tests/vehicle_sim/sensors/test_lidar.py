"""Scans and the range finders: bearings, tilt, noise, and every beam against the plain ray cast."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from protocol import frames, toml_files
from vehicle_sim.sensors.lidar import SECTORS, UNKNOWN, Lidar, LidarSettings, beam_azimuths, sector_ranges
from vehicle_sim.world import World
from vehicle_sim.world.geometry import cast_ray

Array = NDArray[np.float64]

EXACT = LidarSettings(noise_m=0.0)
NOTHING = 1501
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
NEIGHBOURHOOD = World.load(toml_files.find("worlds", "neighbourhood"))


def world_of(**obstacles: list[dict[str, Any]]) -> World:
    named = {kind: [{"name": f"{kind} {i}", **one} for i, one in enumerate(rows)] for kind, rows in obstacles.items()}
    origin = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
    return World.from_tables({"name": "test", "origin": origin, **named}, "test.toml")


def at(north: float, east: float, height: float) -> Array:
    return np.array([north, east, -height])


def turned(roll_deg: float = 0.0, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> Array:
    return frames.from_euler(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))


def exact_scan(world: World, position_ned: Array, attitude: Array) -> NDArray[np.int64]:
    return Lidar(EXACT, np.random.default_rng(0)).scan(world, position_ned, attitude).astype(np.int64)


EMPTY = world_of()
ON_THE_RIGHT = world_of(wall=[{"start": [-2.0, 4.1], "end": [1.0, 4.1], "thickness": 0.2, "height": 6.0}])


def test_a_wall_on_the_right_is_in_the_right_sectors() -> None:
    scan = exact_scan(ON_THE_RIGHT, at(0.0, 0.0, 3.0), LEVEL)
    assert scan.dtype == np.int64 and scan.shape == (72,)
    assert scan[18] == 400
    seen = np.flatnonzero(scan != NOTHING)
    # ends at atan2(4, 1) = 76.0 deg (sector 15, 72.5..77.5) and atan2(4, -2) = 116.6 deg (sector 23, 112.5..117.5)
    assert seen.tolist() == list(range(15, 24))


@pytest.mark.parametrize(("yaw_deg", "sector"), [(0.0, 18), (90.0, 0), (180.0, 54), (-90.0, 36), (45.0, 9)])
def test_the_scan_turns_with_the_vehicle(yaw_deg: float, sector: int) -> None:
    assert exact_scan(ON_THE_RIGHT, at(0.0, 0.0, 3.0), turned(yaw_deg=yaw_deg))[sector] == 400


def test_a_turn_of_five_degrees_shifts_the_scan_by_one_sector() -> None:
    place = at(40.0, -4.0, 3.0)
    scan = exact_scan(NEIGHBOURHOOD, place, turned(yaw_deg=20.0))
    right = exact_scan(NEIGHBOURHOOD, place, turned(yaw_deg=25.0))
    assert (scan < NOTHING).sum() > 20
    np.testing.assert_array_equal(right, np.roll(scan, -1))
    assert not np.array_equal(right, scan)


def test_a_mirrored_world_mirrors_the_scan() -> None:
    boxes = NEIGHBOURHOOD.boxes * [1, -1, 1, 1, 1, -1, 1, 1]  # east and the sine of the yaw
    cylinders = NEIGHBOURHOOD.cylinders * [1, -1, 1, 1, 1, 1]
    mirror = World("mirror", NEIGHBOURHOOD.origin, boxes, cylinders, NEIGHBOURHOOD.names)
    scan = exact_scan(NEIGHBOURHOOD, at(50.0, 3.0, 3.0), turned(roll_deg=4.0, pitch_deg=-3.0, yaw_deg=17.0))
    mirrored = exact_scan(mirror, at(50.0, -3.0, 3.0), turned(roll_deg=-4.0, pitch_deg=-3.0, yaw_deg=-17.0))
    assert (scan < NOTHING).sum() > 20
    np.testing.assert_array_equal(mirrored, scan[-np.arange(SECTORS) % SECTORS])


def test_tilt_shows_the_ground_at_its_range() -> None:
    nose_down = exact_scan(EMPTY, at(0.0, 0.0, 3.0), turned(pitch_deg=-20.0))
    assert nose_down[0] == round(300.0 / math.sin(math.radians(20.0)))
    assert nose_down[9] == round(300.0 / (math.sin(math.radians(20.0)) * math.cos(math.radians(43.0))))
    assert (nose_down[18:55] == NOTHING).all()
    right_down = exact_scan(EMPTY, at(0.0, 0.0, 3.0), turned(roll_deg=15.0, yaw_deg=123.0))
    assert right_down[18] == round(300.0 / math.sin(math.radians(15.0)))
    assert right_down[54] == NOTHING
    assert (exact_scan(EMPTY, at(0.0, 0.0, 3.0), LEVEL) == NOTHING).all()


def test_a_tilted_scan_passes_over_and_under_a_wall() -> None:
    wall = world_of(wall=[{"start": [8.0, -5.0], "end": [8.0, 5.0], "thickness": 0.2, "height": [2.0, 4.0]}])
    assert exact_scan(wall, at(0.0, 0.0, 3.0), LEVEL)[0] == 790
    assert exact_scan(wall, at(0.0, 0.0, 3.0), turned(pitch_deg=10.0))[0] == NOTHING  # 1.4 m above at 8 m
    # nose down by 15 degrees: under the wall (2.1 m lower at 8 m) onto the ground behind it
    assert exact_scan(wall, at(0.0, 0.0, 3.0), turned(pitch_deg=-15.0))[0] == round(300 / math.sin(math.radians(15.0)))


def test_a_thin_pole_between_two_beams_is_not_seen() -> None:
    def pole(azimuth_deg: float) -> World:
        place = [10.0 * math.cos(math.radians(azimuth_deg)), 10.0 * math.sin(math.radians(azimuth_deg))]
        return world_of(cylinder=[{"center": place, "radius": 0.02, "height": 8.0}])

    assert exact_scan(pole(31.0), at(0.0, 0.0, 3.0), LEVEL)[6] == 998  # beams at 28, 29, 30, 31, 32 degrees
    assert (exact_scan(pole(30.5), at(0.0, 0.0, 3.0), LEVEL) == NOTHING).all()


def test_beams_are_spread_evenly_about_the_sectors_centres() -> None:
    for count in (1, 4, 5):
        azimuths_deg = np.degrees(beam_azimuths(count)).reshape(SECTORS, count)
        np.testing.assert_allclose(azimuths_deg.mean(axis=1), 5.0 * np.arange(SECTORS), atol=1e-12)
        np.testing.assert_allclose(np.diff(azimuths_deg.ravel()), 5.0 / count)


def random_attitude(rng: np.random.Generator, most_tilt: float) -> Array:
    azimuth, tilt = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, most_tilt)
    lean = frames.from_rotation_vector(tilt * np.array([math.cos(azimuth), math.sin(azimuth), 0.0]))
    return frames.multiply(lean, turned(yaw_deg=rng.uniform(-180.0, 180.0)))


@pytest.mark.parametrize("most_tilt", [0.0, 0.5, 1.55, math.pi])
def test_culling_loses_no_hit(most_tilt: float) -> None:
    rng = np.random.default_rng(7)
    world, beams_per_sector, seen = NEIGHBOURHOOD, 3, 0
    azimuths = beam_azimuths(beams_per_sector)
    cos, sin = np.cos(azimuths), np.sin(azimuths)
    for _ in range(60):
        place = rng.uniform([-5.0, -20.0, -8.0], [130.0, 20.0, -0.3])
        attitude = random_attitude(rng, most_tilt)
        max_range = rng.choice([6.0, 15.0, 60.0])
        expected = np.full(SECTORS, math.inf)
        for k, (c, s) in enumerate(zip(cos, sin, strict=True)):
            direction = frames.rotate(attitude, np.array([c, s, 0.0]))
            hit = cast_ray(world.boxes, world.cylinders, place, direction, max_range)
            expected[k // beams_per_sector] = min(expected[k // beams_per_sector], hit)
        ranges = sector_ranges(world.boxes, world.cylinders, place, attitude, cos, sin, max_range)
        np.testing.assert_allclose(ranges, expected, rtol=1e-12, atol=1e-12)
        seen += int(np.isfinite(ranges).sum())
    assert seen > 500


def test_q_and_minus_q_give_the_same_scan() -> None:
    attitude = turned(7.0, -11.0, 130.0)
    place = at(60.0, 4.0, 3.0)
    np.testing.assert_array_equal(
        exact_scan(NEIGHBOURHOOD, place, attitude), exact_scan(NEIGHBOURHOOD, place, -attitude)
    )


@pytest.mark.parametrize(("view_deg", "last"), [(90.0, 9), (91.0, 9), (200.0, 20), (5.0, 0), (360.0, 36)])
def test_sectors_outside_the_field_of_view_are_unknown(view_deg: float, last: int) -> None:
    lidar = Lidar(LidarSettings(field_of_view_deg=view_deg), np.random.default_rng(1))
    scan = lidar.scan(EMPTY, at(0.0, 0.0, 3.0), LEVEL)
    known = set(range(last + 1)) | {(-k) % SECTORS for k in range(last + 1)}
    assert set(np.flatnonzero(scan != UNKNOWN).tolist()) == known


def test_ranges_are_limited() -> None:
    def ahead(face: float) -> World:
        return world_of(box=[{"center": [face + 1.0, 0.0], "size": [2.0, 4.0], "height": 6.0}])

    place = at(0.0, 0.0, 3.0)
    assert exact_scan(ahead(0.05), place, LEVEL)[0] == 20
    assert exact_scan(ahead(14.99), place, LEVEL)[0] == 1499
    assert exact_scan(ahead(15.01), place, LEVEL)[0] == NOTHING
    noisy = Lidar(LidarSettings(noise_m=0.5), np.random.default_rng(3))
    near = np.array([noisy.scan(ahead(0.3), place, LEVEL) for _ in range(300)])
    far = np.array([noisy.scan(ahead(14.8), place, LEVEL)[0] for _ in range(300)])
    assert near.min() == 20
    assert far.max() == NOTHING and far.min() < 1450


def test_dropout_is_a_share_of_the_sectors() -> None:
    lidar = Lidar(LidarSettings(dropout=0.3), np.random.default_rng(11))
    rings = np.array([lidar.scan(EMPTY, at(0.0, 0.0, 3.0), LEVEL) for _ in range(300)])
    lost = rings == UNKNOWN
    assert lost.mean() == pytest.approx(0.3, abs=0.013)  # four standard deviations of 21600 draws
    assert (abs(lost.mean(axis=0) - 0.3) < 0.12).all()  # every sector alike
    assert (rings[~lost] == NOTHING).all()


@pytest.mark.parametrize("noise_m", [0.02, 0.1])
def test_noise_has_its_sigma_and_no_bias(noise_m: float) -> None:
    world = world_of(box=[{"center": [6.503, 0.0], "size": [2.0, 8.0], "height": 6.0}])
    lidar = Lidar(LidarSettings(noise_m=noise_m), np.random.default_rng(5))
    place, count = at(0.0, 0.0, 3.0), 3000
    ranges = np.array([lidar.scan(world, place, LEVEL)[[0, 71]] for _ in range(count)]) / 100.0
    sigma = math.sqrt(noise_m**2 + 0.01**2 / 12.0)  # and the rounding to whole centimetres
    assert ranges[:, 0].std() == pytest.approx(sigma, rel=4.0 / math.sqrt(2.0 * count))
    assert ranges[:, 0].mean() == pytest.approx(5.503, abs=4.0 * sigma / math.sqrt(count))
    errors = (ranges - ranges.mean(axis=0)) / ranges.std(axis=0)
    assert abs((errors[:, 0] * errors[:, 1]).mean()) < 0.08  # sectors are independent
    finder = np.array([lidar.beam(world, place, np.array([1.0, 0.0, 0.0]), LEVEL) for _ in range(count)])
    assert finder.std() == pytest.approx(noise_m, rel=4.0 / math.sqrt(2.0 * count))
    assert finder.mean() == pytest.approx(5.503, abs=4.0 * noise_m / math.sqrt(count))


def test_runs_repeat_by_seed_and_what_is_seen_does_not_shift_the_noise() -> None:
    settings = LidarSettings(dropout=0.1)
    place = at(40.0, 0.0, 3.0)

    def scans(seed: int, first: World) -> list[bytes]:
        lidar = Lidar(settings, np.random.default_rng(seed))
        before = lidar.scan(first, at(30.0, -9.0, 3.0), LEVEL)
        lidar.beam(first, place, np.array([1.0, 0.0, 0.0]), LEVEL)
        return [before.tobytes(), lidar.scan(NEIGHBOURHOOD, at(30.0, -9.0, 3.0), LEVEL).tobytes()]

    assert scans(1, NEIGHBOURHOOD) == scans(1, NEIGHBOURHOOD)
    assert scans(1, NEIGHBOURHOOD)[1] != scans(2, NEIGHBOURHOOD)[1]
    assert scans(1, NEIGHBOURHOOD)[0] != scans(1, EMPTY)[0]
    assert scans(1, NEIGHBOURHOOD)[1] == scans(1, EMPTY)[1]


def test_range_finders_follow_the_body() -> None:
    lidar = Lidar(EXACT, np.random.default_rng(0))
    forward, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    place = at(0.0, 0.0, 3.0)
    assert lidar.beam(EMPTY, place, down, LEVEL) == pytest.approx(3.0)
    assert lidar.beam(EMPTY, place, down, turned(roll_deg=30.0)) == pytest.approx(3.0 / math.cos(math.radians(30.0)))
    assert lidar.beam(EMPTY, place, forward, LEVEL) == math.inf
    assert lidar.beam(EMPTY, place, forward, turned(pitch_deg=-30.0)) == pytest.approx(6.0)
    assert lidar.beam(EMPTY, place, forward, turned(pitch_deg=30.0)) == math.inf
    assert lidar.beam(ON_THE_RIGHT, place, forward, turned(yaw_deg=90.0)) == pytest.approx(4.0)
    assert lidar.beam(ON_THE_RIGHT, place, forward, turned(yaw_deg=-90.0)) == math.inf
    assert lidar.beam(EMPTY, at(0.0, 0.0, 0.1), down, LEVEL) == 0.2
    assert lidar.beam(EMPTY, at(0.0, 0.0, 15.1), down, LEVEL) == math.inf


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("min_range_m", 0.0),
        ("max_range_m", 0.1),
        ("max_range_m", 656.0),
        ("rate_hz", 0.0),
        ("noise_m", -0.1),
        ("field_of_view_deg", 361.0),
        ("dropout", 1.1),
        ("beams_per_sector", 0),
        ("latency_s", -0.01),
        ("noise_m", math.nan),
        ("sectors", 36),
    ],
)
def test_impossible_settings_are_refused(key: str, value: float) -> None:
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert({key: value}, LidarSettings)
