"""The beam downward in the filter: where the ground is, and nothing else."""

import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from scipy.stats import chi2

from protocol.arrays import Array
from protocol.frames import rotate
from tests.vehicle_sim.estimation.flown_paths import hover, lemniscate, settings_of
from vehicle_sim.estimation import kalman
from vehicle_sim.estimation.estimator import GATE, Estimator
from vehicle_sim.estimation.ground import WALK, RangeFinder
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.suite import SensorSuite

LATE_TICKS = 5
NOISE_M = 0.02
FLAT: Callable[[Motion], float] = lambda motion: 0.0  # noqa: E731


def true_range(motion: Motion, ground_m: float) -> float:
    """m, to ground so high (m)."""
    upright = rotate(np.array(motion.attitude_ned_frd), np.array((0.0, 0.0, 1.0)))[2]
    return float((-motion.position_ned[2] - ground_m) / upright)


class Flight:
    """An estimator on a path, with a beam to ground of a height (m) that depends on the motion; None: no beam."""

    def __init__(
        self, motions: Iterable[Motion], seed: int, ground: Callable[[Motion], float] | None, level: str = "gnss"
    ) -> None:
        self._motions, self._past = iter(motions), [next(iter(motions))]
        noise, alignment, beam = np.random.default_rng(seed).spawn(3)

        def read() -> tuple[int, float]:
            then = self._past[max(len(self._past) - 1 - LATE_TICKS, 0)]
            assert ground is not None
            return then.time_ns, true_range(then, ground(then)) + NOISE_M * beam.standard_normal()

        finder = None if ground is None else RangeFinder(read, 15.0, NOISE_M, 0.2)
        suite = SensorSuite(settings_of(level), self._past[0], noise)
        self.estimator = Estimator(suite, 0.0, self._past[0], alignment, finder)

    def fly(self) -> "Flight":
        for _ in self.steps():
            pass
        return self

    def steps(self) -> Iterable[Motion]:
        for motion in self._motions:
            if motion.time_ns:
                self._past.append(motion)
                self.estimator.update(motion)
                yield motion

    @property
    def wrong(self) -> Array:
        """From the estimate to the truth: attitude, velocity, position, and the ground's height if it is 0."""
        error = self.estimator.error
        turned = 2.0 * math.copysign(1.0, error[6]) * error[7:10]
        return -np.concatenate((turned, error[3:6], error[:3], self.estimator.nominal[1 + kalman.GROUND :]))


@pytest.mark.parametrize("path", [hover, lemniscate])
def test_with_the_beam_it_is_as_wrong_as_it_says(path: Callable[[float], Iterable[Motion]]) -> None:
    """Attitude, velocity, position and the ground, over ten vehicles; the ground is even."""
    motions, known = tuple(path(15.0)), [0, 1, 2, 3, 4, 5, 6, 7, 8, kalman.GROUND]
    total = 0.0
    for seed in range(10):
        flight = Flight(motions, seed, FLAT).fly()
        P = flight.estimator.covariance[np.ix_(known, known)]
        total += float(flight.wrong @ np.linalg.solve(P, flight.wrong))
        below = flight.estimator.ground_m
        assert below == pytest.approx(-motions[-1].position_ned[2], abs=0.1)
    assert total < chi2.ppf(0.99, 100), "the walk of the ground is for uneven ones: it may be better than it says"


def climb(duration_s: float, speed: float) -> Iterable[Motion]:
    """Straight up, from 8 s on at 2 m/s2 up to a speed (m/s)."""
    for motion in hover(duration_s):
        since = max(0.0, motion.time_ns * 1e-9 - 8.0)
        now = min(speed, 2.0 * since)
        up = now * since - now**2 / 4.0
        yield motion._replace(position_ned=(0.0, 0.0, -3.0 - up), velocity_ned=(0.0, 0.0, -now))


def test_in_a_climb_the_beam_is_of_where_the_vehicle_was() -> None:
    """20 ms late at 3 m/s are 6 cm."""
    flight = Flight(climb(11.0, 3.0), 3, FLAT).fly()
    assert flight.estimator.ground_m == pytest.approx(3.0 + 3.0 * 3.0 - 2.25, abs=0.03)


def ahead(motions: Iterable[Motion], speed: float) -> Iterable[Motion]:
    """The same paths, at a level speed to the north (m/s) from 8 s on."""
    for motion in motions:
        north = speed * max(0.0, motion.time_ns * 1e-9 - 8.0)
        x, y, z = motion.position_ned
        yield motion._replace(position_ned=(x + north, y, z), velocity_ned=(speed * (north > 0.0), 0.0, 0.0))


def test_a_roof_is_refused_for_a_second_and_then_believed() -> None:
    """And says nothing of the height meanwhile."""
    roof: Callable[[Motion], float] = lambda motion: 2.0 * (motion.position_ned[0] > 4.0)  # noqa: E731
    flights = [Flight(ahead(hover(12.0), 3.0), 2, ground) for ground in (roof, FLAT)]
    below = []
    for motion, _ in zip(flights[0].steps(), flights[1].steps(), strict=True):
        over, even = (flight.estimator for flight in flights)
        assert over.nominal[9] == pytest.approx(even.nominal[9], abs=1e-9)
        since = motion.position_ned[0] / 3.0 - 4.0 / 3.0
        if since > 0.05:
            below.append((since, over.ground_m))
    on_roof = [since for since, found in below if found == pytest.approx(1.0, abs=0.1)]
    assert 0.9 < on_roof[0] < 1.2
    assert all(found == pytest.approx(1.0, abs=0.15) for since, found in below if since >= on_roof[0])


def test_a_beam_that_is_stuck_in_a_climb_does_not_hold_the_height() -> None:
    """Nothing of the estimate but the ground is the beam's, and its test ratio says that something is wrong."""

    stuck: Callable[[Motion], float] = lambda motion: -motion.position_ned[2] - 3.0  # noqa: E731
    flights, ratios = [Flight(climb(16.0, 0.3), 4, ground) for ground in (stuck, None)], []
    for motion, _ in zip(flights[0].steps(), flights[1].steps(), strict=True):
        held, alone = (flight.estimator for flight in flights)
        assert held.nominal[: kalman.GROUND + 1] == pytest.approx(alone.nominal[: kalman.GROUND + 1], abs=1e-9)
        if motion.time_ns > 8_000_000_000:
            assert held.ground is not None
            ratios.append(held.ground.ratio)
    assert max(ratios) > GATE**2


def test_nothing_is_told_by_a_beam_that_is_steep_or_meets_nothing_or_is_too_near() -> None:
    for reading in (math.inf, 0.1):
        flight = Flight(hover(3.0), 1, lambda motion, reading=reading: 3.0 - reading)  # type: ignore[misc]
        assert flight.fly().estimator.ground_m is None
    half = math.radians(50.0) / 2.0
    steep = (motion._replace(attitude_ned_frd=(math.cos(half), math.sin(half), 0.0, 0.0)) for motion in hover(3.0))
    assert Flight(tuple(steep), 1, FLAT).fly().estimator.ground_m is None


def test_a_late_beam_is_taken_back_to_the_attitude_of_then() -> None:
    """`depth` beside the geometry, and its slopes beside differences."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        q = np.array((1.0, *(0.25 * rng.standard_normal(3))))
        q /= np.linalg.norm(q)
        nominal, rates, late, distance = np.zeros(kalman.NOMINAL), 0.5 * rng.standard_normal(3), 0.02, 4.0
        nominal[:4] = q
        then = nominal.copy()
        kalman.turn(then, *(-late * rates).tolist())
        below, by_roll, by_pitch, _ = kalman.depth(nominal, rates, late, distance)
        down = np.array((0.0, 0.0, 1.0))
        assert below == pytest.approx(distance * rotate(then[:4], down)[2], abs=0.002)
        for axis, slope in ((0, by_roll), (1, by_pitch)):
            turned, step = nominal.copy(), np.zeros(3)
            step[axis] = 1e-6
            kalman.turn(turned, *step.tolist())
            gained = distance * (rotate(turned[:4], down)[2] - rotate(nominal[:4], down)[2]) / 1e-6
            assert slope == pytest.approx(-gained, abs=1e-4), (
                "the truth is turned by the error: what is measured is less"
            )


def test_where_the_ground_is_grows_uncertain_with_the_way() -> None:
    flight = Flight(lemniscate(5.0), 1, FLAT)
    way, last = 0.0, None
    for motion in flight.steps():
        if motion.time_ns == 3_000_000_000:
            flight.estimator.ground, last = None, motion
            known = flight.estimator.covariance[kalman.GROUND, kalman.GROUND]
        if last is not None:
            way, last = way + math.dist(motion.position_ned, last.position_ned), motion
    grown = flight.estimator.covariance[kalman.GROUND, kalman.GROUND] - known
    assert grown == pytest.approx(WALK**2 * way, rel=0.05)
