"""Tracks: the filter against a reference and its own consistency, association, status, start and deletion."""

import math

import numpy as np
import pytest

from companion.config_avoidance import AvoidanceTracks
from companion.perception.free_space import MOVER_COLUMNS
from companion.perception.tracks import (
    TRACK,
    Tracker,
    Tracks,
    associate,
    correct,
    mahalanobis_squared,
    predict,
    start_track,
    update_status,
)
from companion.state import Scan
from protocol import toml_files
from protocol.arrays import Array
from protocol.frames import from_euler
from studies.worlds import forest
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import CylinderTable, OriginTable, WallTable, World, WorldTable

SETTINGS = AvoidanceTracks(
    range_gap=0.2,
    max_extent=1.2,
    acceleration_noise=1.5,
    confirm_hits=4,
    delete_misses=4,
    min_speed=0.4,
    min_speed_sigmas=3.0,
    moving_scans=5,
    stopped_scans=15,
)
LEVEL = from_euler(0.0, 0.0, 0.0)
PERIOD_NS = 66_666_667
BEARINGS: Array = np.radians(5.0 * np.arange(72))


def ring(lidar: Lidar, world: World, pose: tuple[Array, Array], time_ns: int) -> Scan:
    distances = lidar.scan(world, *pose).astype(np.float64)
    hit, known = distances <= 1500.0, distances != 65535.0
    return Scan(time_ns, 0, BEARINGS, np.minimum(distances, 1500.0) * 0.01, hit, known)


class Scene:
    """Moving cylinders and walls, seen by the simulator's LiDAR."""

    def __init__(self, seed: int = 1, walls: tuple[WallTable, ...] = (), noise_m: float = 0.02) -> None:
        self._lidar = Lidar(LidarSettings(noise_m=noise_m), np.random.default_rng(seed))
        self._walls = walls
        self.tracker = Tracker(SETTINGS)
        self.time_ns = 0

    def see(
        self,
        places: list[tuple[float, float]],
        position: Array | None = None,
        yaw: float = 0.0,
        pitch: float = 0.0,
    ) -> Scan:
        """Add one scan; cylinders of 0.3 m at these places."""
        here = np.array([0.0, 0.0, -2.0]) if position is None else position
        cylinders = tuple(CylinderTable(name=f"{k}", center=p, radius=0.3, height=4.0) for k, p in enumerate(places))
        origin = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
        world = World.build(WorldTable(name="scene", origin=origin, cylinder=cylinders, wall=self._walls))
        attitude = from_euler(0.0, pitch, yaw)
        scan = ring(self._lidar, world, (here, attitude), self.time_ns)
        self.moving = self.tracker.add(scan, here, attitude, -0.3)
        self.time_ns += PERIOD_NS
        return scan


def track_of(mean: Array, covariance: Array) -> Tracks:
    tracks = np.zeros(1, TRACK)
    tracks["mean"], tracks["covariance"], tracks["hits"] = mean, covariance, 1
    return tracks


def test_filter_against_the_information_form() -> None:
    """Prediction and correction against the same written as inverse covariances."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4))
    mean, covariance = rng.normal(size=4), root @ root.T + np.eye(4)
    tracks = track_of(mean, covariance)
    noise_root = rng.normal(size=(2, 2))
    middle, noise = rng.normal(size=2), noise_root @ noise_root.T + np.eye(2)
    predict(tracks, 0.2, 1.5)
    step = np.eye(4)
    step[:2, 2:] = 0.2 * np.eye(2)
    shape = np.vstack([0.02 * np.eye(2), 0.2 * np.eye(2)])
    mean, covariance = step @ mean, step @ covariance @ step.T + 1.5**2 * shape @ shape.T
    assert np.allclose(tracks["mean"], mean)
    assert np.allclose(tracks["covariance"], covariance)
    spread, offset = covariance[:2, :2] + noise, middle - mean[:2]
    assert mahalanobis_squared(spread, offset) == pytest.approx(offset @ np.linalg.inv(spread) @ offset)
    correct(tracks[0], middle, noise, 0.3)
    seen = np.eye(2, 4)
    information = np.linalg.inv(covariance) + seen.T @ np.linalg.inv(noise) @ seen
    expected = np.linalg.solve(information, np.linalg.solve(covariance, mean) + seen.T @ np.linalg.solve(noise, middle))
    assert np.allclose(tracks["covariance"], np.linalg.inv(information)) and np.allclose(tracks["mean"], expected)
    assert tracks["hits"] == 2


def test_two_measurements_of_a_straight_flight_give_its_velocity() -> None:
    """With little noise the velocity is the difference of places over time: to the right is east."""
    noise = 1e-8 * np.eye(2)
    tracks = np.zeros(1, TRACK)
    start_track(tracks[0], 7, np.array([3.0, 1.0]), noise, 0.3, np.zeros(3))
    predict(tracks, 0.5, 0.0)
    correct(tracks[0], np.array([3.2, 1.6]), noise, 0.3)
    assert np.allclose(tracks["mean"], [3.2, 1.6, 0.4, 1.2], atol=1e-5)
    assert tracks["number"] == 7


@pytest.mark.parametrize("bearing", [0.0, 0.7, -2.0])
def test_of_a_new_track_less_speed_is_expected_across_the_line_of_sight(bearing: float) -> None:
    tracks, here = np.zeros(1, TRACK), np.array([2.0, -1.0, -2.0])
    ahead, aside = np.array([math.cos(bearing), math.sin(bearing)]), np.array([-math.sin(bearing), math.cos(bearing)])
    start_track(tracks[0], 0, here[:2] + 6.0 * ahead, 0.01 * np.eye(2), 0.3, here)
    speeds = tracks["covariance"][0][2:, 2:]
    assert [ahead @ speeds @ ahead, aside @ speeds @ aside, ahead @ speeds @ aside] == pytest.approx([6.25, 0.64, 0.0])


def test_a_track_that_is_slow_for_so_many_scans_stands() -> None:
    """After `stopped_scans` slow scans in a row, and no later; a fast one in between restarts the count."""
    tracker = Tracker(SETTINGS)
    tracks = track_of(np.zeros(4), 1e-4 * np.eye(4))
    tracks["hits"], tracks["moving"] = 10, True

    def moves(speed: float) -> bool:
        tracks["mean"][0, 2] = speed
        update_status(tracks[0], tracker._rules[0], np.zeros(2), True)
        return bool(tracks["moving"][0])

    assert all(moves(0.0) for _ in range(SETTINGS.stopped_scans - 1)) and moves(1.5)
    assert all(moves(0.0) for _ in range(SETTINGS.stopped_scans - 1)) and not moves(0.0)


@pytest.mark.parametrize("covariance", [0.01, 0.5])
def test_what_goes_along_with_the_vehicle_is_not_known_to_move(covariance: float) -> None:
    """It may be the place where a beam meets a long wall. What comes, crosses or falls behind is none, and what is
    known to move stays so."""
    rules = Tracker(SETTINGS)._rules[0]

    def begins(own: tuple[float, float], *, known: bool = False) -> bool:
        tracks = track_of(np.array([9.0, 2.0, 3.0, 0.0]), covariance * np.eye(4))
        tracks["hits"], tracks["left"], tracks["fast_scans"], tracks["moving"] = 10, True, 9, known
        update_status(tracks[0], rules, np.array(own), True)
        return bool(tracks["moving"][0])

    assert not begins((3.0, 0.0)) and begins((3.0, 0.0), known=True)
    assert begins((0.0, 0.0)) and begins((-4.0, 0.0)) and begins((1.0, 3.0)) and begins((7.0, 0.0))


@pytest.mark.parametrize(("own", "moving"), [(3.0, 0), (0.0, 1), (-3.0, 1)])
def test_the_vehicle_s_velocity_is_that_between_two_scans(own: float, moving: int) -> None:
    scene = Scene()
    for k in range(12):
        way = k / 15.0
        scene.see([(5.0 + 3.0 * way, 1.0)], np.array([own * way, 0.0, -2.0]))
    assert scene.tracker.moving.size == moving


def test_the_nearest_pair_is_taken_first() -> None:
    """Each track continues with one cluster and each cluster with one track; beyond the gate there is no pair."""
    tracks = np.concatenate([track_of(np.array([place, 0.0, 0.0, 0.0]), 0.01 * np.eye(4)) for place in (0.0, 0.3, 9.0)])
    clusters = np.array([[0.2, 0.0], [0.5, 0.0], [20.0, 0.0]])
    noises = np.broadcast_to(0.01 * np.eye(2), (3, 2, 2)).copy()
    whole = np.zeros(3, np.bool_)
    assert associate(tracks, clusters, noises, whole).tolist() == [
        -1,
        0,
        -1,
    ]  # the first is farther from the second than the gate
    assert associate(tracks, clusters[:1], noises[:1], whole[:1]).tolist() == [-1, 0, -1]
    assert associate(tracks[:1], clusters, noises, whole).tolist() == [0]
    # Within the gate by the uncertainty of the track and of the cluster together, by neither alone.
    assert associate(tracks[:1], np.array([[0.0, 0.45]]), noises[:1], whole[:1]).tolist() == [0]
    assert associate(tracks[:0], clusters, noises, whole).tolist() == []
    assert associate(tracks, clusters[:0], noises[:0], whole[:0]).tolist() == [-1] * 3


def test_what_is_seen_whole_is_taken_before_what_something_hides_a_part_of() -> None:
    """Though that is nearer; alone it is taken."""
    tracks = track_of(np.zeros(4), 0.01 * np.eye(4))
    clusters, noises = np.array([[0.1, 0.0], [0.2, 0.0]]), np.broadcast_to(0.01 * np.eye(2), (2, 2, 2)).copy()
    hidden = np.array([True, False])
    assert associate(tracks, clusters, noises, hidden).tolist() == [1]
    assert associate(tracks, clusters[:1], noises[:1], hidden[:1]).tolist() == [0]


def test_the_filter_is_consistent() -> None:
    """Squared errors in standard deviations (NEES) of 300 simulated tracks: 4 on average."""
    rng = np.random.default_rng(2)
    noise = np.diag([0.01, 0.04])
    values = []
    for _ in range(300):
        truth = np.array([5.0, 0.0, *rng.normal(0.0, 1.5, 2)])
        tracks = np.zeros(1, TRACK)
        start_track(tracks[0], 0, truth[:2] + rng.multivariate_normal([0, 0], noise), noise, 0.3, np.zeros(3))
        for _ in range(20):
            push = rng.normal(0.0, 1.5, 2)
            truth[:2] += 0.1 * truth[2:] + 0.005 * push
            truth[2:] += 0.1 * push
            predict(tracks, 0.1, 1.5)
            correct(tracks[0], truth[:2] + rng.multivariate_normal([0, 0], noise), noise, 0.3)
        error = tracks["mean"][0] - truth
        values.append(error @ np.linalg.solve(tracks["covariance"][0], error))
    assert np.mean(values) == pytest.approx(4.0, abs=0.5)


def test_a_walker_is_tracked_with_its_velocity() -> None:
    """The walker goes from left to right, 5 m ahead of a vehicle that heads east: north is on its left."""
    scene = Scene()
    for k in range(40):
        scene.see([(2.0 - 1.4 * k / 15.0, 5.0)], yaw=math.pi / 2)
    (track,) = scene.tracker.moving
    assert track["mean"][2] == pytest.approx(-1.4, abs=0.35) and abs(track["mean"][3]) < 0.35
    assert math.hypot(track["mean"][0] - (2.0 - 1.4 * 39 / 15.0), track["mean"][1] - 5.0) < 0.4
    bearings = BEARINGS[scene.moving] + math.pi / 2
    assert scene.moving.sum() >= 1
    assert np.allclose(
        np.hypot(*(5.0 * np.array([np.cos(bearings), np.sin(bearings)]) - track["mean"][:2, None])), 0, atol=0.9
    )
    (point,) = scene.tracker.points(0.5, 0.6)
    assert np.allclose(point[:2], track["mean"][:2] + 0.5 * track["mean"][2:])
    assert np.allclose(point[2:4], track["mean"][2:])
    assert point[4] == pytest.approx(track["radius"] + 0.6)


def test_trees_and_walls_do_not_move() -> None:
    """Flown past at 5 m/s, seen 150 times: less than 1 % of the returns of a wood and a wall count as moving."""
    rng = np.random.default_rng(3)
    wall = WallTable(name="wall", start=(-20.0, 9.0), end=(80.0, 9.0), thickness=0.3, height=4.0)
    trees = [(float(n), float(e)) for n, e in zip(rng.uniform(-10, 60, 60), rng.uniform(-10, 6, 60), strict=True)]
    trees = [tree for tree in trees if abs(tree[1]) > 1.2]
    scene = Scene(walls=(wall,))
    moving = returns = 0
    for k in range(150):
        scan = scene.see(trees, np.array([5.0 * k / 15.0, 0.0, -2.0]))
        moving += int(scene.moving.sum())
        returns += int(scan.hit.sum())
    assert moving < 0.01 * returns


@pytest.mark.parametrize(("back", "turn"), [(0.3, 0.0), (0.5, 0.4), (1.5, -0.7)])
def test_a_shaft_around_the_vehicle_does_not_move(back: float, turn: float) -> None:
    """Three walls 1.15 m apart, open behind, which the vehicle leaves at 0.6 m/s: the ends of what it sees of them are
    near to each other and travel with it."""
    ends = [(0.9, -0.675), (-back, -0.675), (0.9, 0.675), (-back, 0.675)]
    a, b, c, d = ((n * math.cos(turn) - e * math.sin(turn), n * math.sin(turn) + e * math.cos(turn)) for n, e in ends)
    walls = tuple(
        WallTable(name=f"{k}", start=start, end=end, thickness=0.2, height=4.0)
        for k, (start, end) in enumerate([(a, b), (c, d), (a, c)])
    )
    scene, way = Scene(walls=walls), np.array([-math.cos(turn), -math.sin(turn), 0.0])
    for k in range(75):
        scene.see([], 0.04 * k * way - [0.0, 0.0, 2.0], yaw=turn)
        assert len(scene.tracker.moving) == 0, k


@pytest.mark.parametrize(("seed", "density"), [(1, 1 / 25), (2, 1 / 25), (1, 1 / 12), (2, 1 / 12)])
def test_no_ring_in_a_still_forest_has_a_mover(seed: int, density: float) -> None:
    """Flown through at 5 m/s: sectors blur the trunks, and trunks hide each other."""
    trunks = [tuple(trunk["center"]) for trunk in forest(seed, density).tables["cylinder"]]
    scene = Scene(seed)
    for k in range(120):
        scene.see(trunks, np.array([k / 3.0, 0.3 * math.sin(0.1 * k), -2.0]), yaw=0.1 * math.sin(0.3 * k))
        assert len(scene.tracker.moving) == 0, k


@pytest.mark.parametrize(
    ("start", "velocity", "own_speed", "scans"),
    [
        ((5.0, -4.0), (0.0, 1.5), 0.0, 20),
        ((8.0, -9.0), (0.0, 4.0), 0.0, 12),
        ((10.0, 0.2), (-1.5, 0.0), 0.0, 12),
        ((20.0, 0.2), (-4.0, 0.0), 3.0, 12),
        ((2.0, 0.0), (1.5, 0.0), 0.0, 12),
        ((9.0, -5.0), (-1.4, 1.4), 0.0, 20),
    ],
)
def test_what_moves_is_found_whichever_way_it_goes(
    start: tuple[float, float], velocity: tuple[float, float], own_speed: float, scans: int
) -> None:
    """Across, towards the vehicle, away from it: within so many scans of its first return."""
    scene, seen = Scene(), 0
    for k in range(60):
        t = k / 15.0
        place = start[0] + velocity[0] * t, start[1] + velocity[1] * t
        seen += bool(scene.see([place], np.array([own_speed * t, 0.0, -2.0])).hit.any())
        if len(scene.tracker.moving):
            break
    (track,) = scene.tracker.moving
    assert seen <= scans
    assert np.hypot(*(track["mean"][2:] - velocity)) < 0.3 * np.hypot(*velocity) + 0.6


@pytest.mark.parametrize("speed", [0.7, 0.0])
def test_who_comes_straight_on_moves_though_a_tilted_vehicle_saw_him_first(speed: float) -> None:
    """Nose down, the vehicle met his feet; when it hovers, he hides the place where he was then."""
    scene, step = Scene(), PERIOD_NS * 1e-9
    for k in range(40):
        north, pitch = (0.8 * k, math.radians(-10.0)) if k < 5 else (4.0, 0.0)
        scene.see([(8.2 - speed * step * k, 0.0)], np.array([north, 0.0, -2.0]), pitch=pitch)
    assert scene.tracker.moving.size == (speed > 0.0)
    (track,) = scene.tracker.tracks
    assert track["start"][0] == pytest.approx(7.9, abs=0.3), "the map forgets the way from there"
    assert track["place"][0, 2] == pytest.approx(-2.0, abs=0.1)


NOSE_DOWN = math.radians(-40.0)
"""The beams ahead meet the ground 2.4 m away."""


def test_a_tilted_vehicle_expects_what_moves_to_go_on() -> None:
    """It accelerates, and its scan meets the ground before a walker whom it has seen. He is where he should be when the
    scan shows him again, as the same track."""
    scene, step = Scene(), PERIOD_NS * 1e-9

    def walker(k: int) -> tuple[float, float]:
        return 9.0, -4.0 + 1.5 * step * k

    for k in range(55):
        scene.see([walker(k)], pitch=NOSE_DOWN if 25 <= k < 45 else 0.0)
        if k >= 25:
            (track,) = scene.tracker.moving
            assert math.dist(track["mean"][:2], walker(k)) < 0.5
            assert track["number"] == 0 and (track["hidden"] > 0) == (k < 45) and track["misses"] == 0


@pytest.mark.parametrize("hidden", [0, 5, SETTINGS.hidden_scans])
def test_what_moves_and_is_not_where_the_scan_shows_its_place_is_gone(hidden: int) -> None:
    """However long it was hidden before, and in any case after so many scans that could not show it."""
    scene, step = Scene(), PERIOD_NS * 1e-9
    for k in range(25):
        scene.see([(9.0, -4.0 + 1.5 * step * k)])
    assert len(scene.tracker.moving) == 1
    for _ in range(hidden):
        scene.see([], pitch=NOSE_DOWN)
        assert len(scene.tracker.moving) == 1
    for k in range(SETTINGS.delete_misses):
        assert len(scene.tracker.moving) == 1, k
        scene.see([], pitch=NOSE_DOWN if hidden == SETTINGS.hidden_scans else 0.0)
    assert 0 not in scene.tracker.tracks["number"]


def test_what_stands_is_not_expected_where_it_is_not_seen() -> None:
    """The map knows it."""
    scene = Scene()
    for _ in range(25):
        scene.see([(9.0, 1.0)])
    for _ in range(SETTINGS.delete_misses):
        scene.see([], pitch=NOSE_DOWN)
    assert 0 not in scene.tracker.tracks["number"]


@pytest.mark.parametrize(("speed", "ahead", "aside", "own"), [(1.6, 8.0, -2.0, 6.0), (0.8, 12.0, -2.0, 4.0)])
def test_a_walker_is_seen_to_have_left_from_nearer(speed: float, ahead: float, aside: float, own: float) -> None:
    """He crosses ahead of a vehicle that flies nose down: beside the first ring, from so far that he fills two sectors,
    it is never seen that he has left, as the scan rises over his place there."""
    scene, step = Scene(noise_m=0.0), PERIOD_NS * 1e-9
    for k in range(int(ahead / own / step) - 2):
        scene.see([(ahead, aside + speed * step * k)], np.array([own * step * k, 0.0, -2.0]), pitch=-0.21)
    (track,) = scene.tracker.moving
    assert track["mean"][3] == pytest.approx(speed, abs=0.4)


def test_two_walkers_that_pass_each_other_keep_their_tracks() -> None:
    scene = Scene()
    numbers = []
    for k in range(60):
        t = k / 15.0
        scene.see([(6.0, -3.0 + 1.5 * t), (3.5, 3.0 - 1.5 * t)])
        if k == 15:
            numbers = sorted(track["number"] for track in scene.tracker.moving)
    assert len(numbers) == 2
    last = {track["number"]: track["mean"][3] for track in scene.tracker.moving}
    assert any(number in last for number in numbers)
    assert all((track["mean"][0] > 4.75) == (track["mean"][3] > 0.0) for track in scene.tracker.moving)


def test_a_track_starts_at_once_and_is_deleted_after_some_misses() -> None:
    scene = Scene()
    scene.see([(4.0, 0.0)])
    assert len(scene.tracker.tracks) == 1 and len(scene.tracker.moving) == 0
    for _ in range(5):
        scene.see([(4.0, 0.0)])
    assert len(scene.tracker.tracks) == 1
    for left in range(SETTINGS.delete_misses - 1):
        scene.see([])
        assert len(scene.tracker.tracks) == 1, left
    scene.see([])
    assert len(scene.tracker.tracks) == 0
    assert scene.tracker.points(0.0, 0.6).shape == (0, MOVER_COLUMNS)


def test_an_unconfirmed_track_is_deleted_at_its_first_miss() -> None:
    scene = Scene()
    scene.see([(4.0, 0.0)])
    scene.see([])
    assert len(scene.tracker.tracks) == 0


def test_a_walker_that_turns_back_is_still_moving() -> None:
    """Back and forth on a line, slow for a moment at each turn; after a stop the track no longer moves."""
    scene = Scene()
    moved = []
    for k in range(150):
        north = math.cos(0.09 * k)
        scene.see([(north, 5.0)], yaw=math.pi / 2)
        moved.append(len(scene.tracker.moving))
    assert all(moved[40:])
    for _ in range(40):
        scene.see([(north, 5.0)], yaw=math.pi / 2)
    assert len(scene.tracker.moving) == 0


def test_who_turns_back_at_once_is_followed_within_a_few_scans() -> None:
    """At 1.4 m/s, without being slow for a moment: it is the same track all the time, and never lost."""
    scene, step = Scene(), 1.4 * PERIOD_NS * 1e-9
    for k in range(60):
        north = -2.0 + step * (k if k <= 40 else 80 - k)
        scene.see([(north, 4.0)], yaw=math.pi / 2)
        if k >= 30:
            (track,) = scene.tracker.moving
            assert track["number"] == 0 and abs(track["mean"][0] - north) < 0.3
            if k >= 46:
                assert track["mean"][2] < -1.0
    assert track["mean"][2] == pytest.approx(-1.4, abs=0.3)


def test_who_comes_along_a_hallway_is_not_taken_for_its_walls() -> None:
    """In 2 m between walls, which are nearer on both sides than he is: he is seen to move at 3.3 m."""
    walls = tuple(
        WallTable(name=f"{e}", start=(-5.0, e), end=(20.0, e), thickness=0.2, height=4.0) for e in (-1.1, 1.1)
    )
    scene, step = Scene(walls=walls), 1.2 * PERIOD_NS * 1e-9
    for k in range(75):
        scene.see([(9.0 - step * k, 0.35)])
        if 9.0 - step * k < 3.3:
            (track,) = scene.tracker.moving
            assert track["mean"][:2] == pytest.approx([9.0 - step * k, 0.35], abs=0.45)
            assert track["mean"][2:] == pytest.approx([-1.2, 0.0], abs=0.4)


def test_the_wall_beside_which_somebody_went_does_not_go_on_with_the_vehicle() -> None:
    """He comes along a hallway and passes; the vehicle flies on, and sees pieces of the wall where he was expected."""
    walls = tuple(
        WallTable(name=f"{e}", start=(-20.0, e), end=(60.0, e), thickness=0.2, height=4.0) for e in (-1.7, 1.7)
    )
    scene, step, elsewhere = Scene(walls=walls), PERIOD_NS * 1e-9, 0
    for k in range(150):
        place = 10.0 - step * k, 1.2
        scene.see([place], np.array([2.0 * step * k, 0.0, -2.0]))
        elsewhere += any(math.dist(track["mean"][:2], place) > 1.0 for track in scene.tracker.moving)
    assert elsewhere <= SETTINGS.delete_misses


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("east", [-6.0, 6.0])
def test_no_ring_along_a_still_street_has_a_mover(seed: int, east: float) -> None:
    """Vans, kiosks, a billboard and crowns end above and below the tilted rings, which pass over and under them."""
    world, rng = World.load(toml_files.find("worlds", "neighbourhood")), np.random.default_rng(seed)
    lidar, tracker = Lidar(LidarSettings(noise_m=0.02), rng), Tracker(AvoidanceTracks())
    phases = rng.uniform(0.0, 6.0, 3)
    for k in range(450):
        t = 0.064 * k
        here = np.array([4.0 * t, east + 1.5 * math.sin(0.4 * t + phases[0]), -3.1])
        roll, pitch = 0.2 * math.sin(1.3 * t + phases[1]), 0.2 * math.sin(1.7 * t + phases[2]) - 0.1
        attitude = from_euler(roll, pitch, 0.2 * math.sin(0.5 * t))
        tracker.add(ring(lidar, world, (here, attitude), 64_000_000 * k), here, attitude, -0.6)
        assert tracker.moving.size == 0, k
