"""Dryden turbulence against the standard's spectra and against scipy's exact discretisation of the same filters."""

import itertools
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from numpy.typing import NDArray

from protocol.arrays import Vector
from protocol.jit import compiled
from vehicle_sim.physics.rigid_body import STATES, VELOCITY
from vehicle_sim.timing import TICK_NS
from vehicle_sim.world.wind import COMPONENTS, Wind, WindSettings, dryden_length, dryden_sigma, gust

Array = NDArray[np.float64]

FOOT = 0.3048
HEIGHT = 10.0 * FOOT
DT = TICK_NS * 1e-9


@compiled
def blown(noise: Array, dt: float, height: float, airspeed: float, w20: float) -> Array:
    """Gusts (n, 3) for noise (n, 5), from the stationary distribution on."""
    states, out = np.zeros(COMPONENTS), np.zeros((len(noise), 3))
    gust(states, noise[0], 1e6, height, airspeed, w20, out[0])
    for i in range(1, len(noise)):
        gust(states, noise[i], dt, height, airspeed, w20, out[i])
    return out


def series(ticks: int, dt: float, airspeed: float, w20: float = 6.0, seed: int = 1) -> Array:
    noise = np.random.default_rng(seed).standard_normal((ticks, COMPONENTS))
    return blown(noise, dt, HEIGHT, airspeed, w20)


def steady_wind(settings: WindSettings, velocity_ned: Vector, ticks: int, seed: int = 0) -> Array:
    """Winds (ticks, 3) at a vehicle 3 m above the ground that keeps its velocity."""
    wind_ned, state = np.zeros(3), np.zeros(STATES)
    state[2], state[VELOCITY] = -HEIGHT, velocity_ned
    wind = Wind(settings, wind_ned, np.random.default_rng(seed))
    result = np.empty((ticks, 3))
    for row in result:
        wind.advance(state)
        row[:] = wind_ned
    return result


# --- the standard -----------------------------------------------------------------------------------------------------


def test_intensities_and_lengths_at_its_heights() -> None:
    """At 1000 feet turbulence is isotropic; at 20 feet a tenth of the wind, and what a pocket calculator says."""
    assert dryden_sigma(1000.0 * FOOT, 10.0) == pytest.approx((1.0, 1.0))
    assert dryden_length(1000.0 * FOOT) == pytest.approx((1000.0 * FOOT, 1000.0 * FOOT))
    assert dryden_sigma(20.0 * FOOT, 10.0) == pytest.approx((1.930, 1.0), rel=1e-3)
    assert dryden_length(20.0 * FOOT) == pytest.approx((143.59 * FOOT, 20.0 * FOOT), rel=1e-3)


def test_heights_are_limited_to_the_standards_range() -> None:
    for far, near in ((-1.0, 10.0 * FOOT), (0.0, 10.0 * FOOT), (2000.0, 1000.0 * FOOT)):
        assert dryden_sigma(far, 5.0) == dryden_sigma(near, 5.0)
        assert dryden_length(far) == dryden_length(near)


@pytest.mark.parametrize(("dt", "airspeed"), [(DT, 40.0), (0.1, 10.0), (5.0, 6.0)])
def test_variance_is_that_of_the_standard_at_any_step(dt: float, airspeed: float) -> None:
    gusts = series(1_000_000, dt, airspeed)
    sideways, down = dryden_sigma(HEIGHT, 6.0)
    assert gusts.std(axis=0) == pytest.approx((sideways, sideways, down), rel=0.02)
    assert gusts.mean(axis=0) == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert np.abs(np.corrcoef(gusts.T) - np.eye(3)).max() < 0.03


def test_spectrum_has_the_standards_shape() -> None:
    """Welch's estimate in bands of half an octave, well below the sampling rate where nothing is folded back."""
    airspeed, dt = 12.0, 0.02
    gusts = series(1 << 21, dt, airspeed)
    hertz, power = scipy.signal.welch(gusts, fs=1.0 / dt, nperseg=1 << 13, axis=0)
    w = 2.0 * math.pi * hertz
    sideways, down = dryden_sigma(HEIGHT, 6.0)
    long, short = (length / airspeed for length in dryden_length(HEIGHT))
    along = sideways**2 * (2.0 * long / math.pi) / (1.0 + (long * w) ** 2)
    across = sideways**2 * (long / math.pi) * (1.0 + 3.0 * (long * w) ** 2) / (1.0 + (long * w) ** 2) ** 2
    vertical = down**2 * (short / math.pi) * (1.0 + 3.0 * (short * w) ** 2) / (1.0 + (short * w) ** 2) ** 2
    expected = 2.0 * math.pi * np.stack([along, across, vertical], axis=1)  # a hertz has 2 pi rad/s
    edges = 0.04 * 2.0 ** np.arange(0.0, 6.0, 0.5)  # to 1.8 Hz
    for low, high in itertools.pairwise(edges):
        band = (hertz >= low) & (hertz < high)
        assert power[band].mean(axis=0) == pytest.approx(expected[band].mean(axis=0), rel=0.1)


@pytest.mark.parametrize("passed", [1e-5, 1e-3, 0.3, 4.0])
def test_filters_are_discretised_as_van_loan_does(passed: float) -> None:
    """Transition and covariance of the noise of one step, against the exponential of the continuous system's matrix."""
    airspeed = 10.0
    lengths = dryden_length(HEIGHT)
    for rows, length in ((slice(0, 1), lengths[0]), (slice(1, 3), lengths[0]), (slice(3, 5), lengths[1])):
        size = rows.stop - rows.start
        dt = passed * length / airspeed
        transition, spread = np.zeros((size, size)), np.zeros((size, size))
        for column in range(size):
            states = np.zeros(COMPONENTS)
            states[rows.start + column] = 1.0
            gust(states, np.zeros(COMPONENTS), dt, HEIGHT, airspeed, 1.0, np.zeros(3))
            transition[:, column] = states[rows]
            states, noise = np.zeros(COMPONENTS), np.zeros(COMPONENTS)
            noise[rows.start + column] = 1.0
            gust(states, noise, dt, HEIGHT, airspeed, 1.0, np.zeros(3))
            spread[:, column] = states[rows]
        # white noise of the density that gives the output unit variance, in time constants: 2 for u, 1 for v and w
        system = -np.eye(size) + np.eye(size, k=-1)
        density = np.zeros((size, size))
        density[0, 0] = 2.0 if size == 1 else 1.0
        block = np.block([[-system, density], [np.zeros((size, size)), system.T]]) * passed
        whole = scipy.linalg.expm(block)
        exact = whole[size:, size:].T
        assert transition == pytest.approx(exact, rel=1e-9, abs=1e-13)
        assert spread @ spread.T == pytest.approx(exact @ whole[:size, size:], rel=1e-5, abs=1e-22)


# --- what blows at a vehicle ------------------------------------------------------------------------------------------


def test_without_turbulence_the_wind_is_its_mean() -> None:
    winds = steady_wind(WindSettings(mean_ned=(3.0, -2.0, 0.5)), (1.0, 2.0, 3.0), 10)
    assert (winds == (3.0, -2.0, 0.5)).all()


def test_turbulence_is_stationary_from_the_first_tick_on() -> None:
    settings = WindSettings(mean_ned=(0.0, 6.0, 0.0), turbulence_m_s=6.0)
    first = np.array([steady_wind(settings, (0.0, 0.0, 0.0), 1, seed)[0] for seed in range(1500)])
    sideways, down = dryden_sigma(HEIGHT, 6.0)
    assert first.std(axis=0) == pytest.approx((sideways, sideways, down), rel=0.08)
    assert first.mean(axis=0) == pytest.approx((0.0, 6.0, 0.0), abs=0.12)


def test_gusts_along_the_mean_wind_last_longer_than_across() -> None:
    """At a lag of one time constant the correlation is exp(-1) along and half of that across."""
    settings = WindSettings(mean_ned=(0.0, 12.0, 0.0), turbulence_m_s=6.0)
    winds = steady_wind(settings, (0.0, -20.0, 0.0), 300_000)
    lag = round(dryden_length(HEIGHT)[0] / 32.0 / DT)
    deviations = (winds - winds.mean(axis=0)) / winds.std(axis=0)
    north, east, _ = (deviations[lag:] * deviations[:-lag]).mean(axis=0)
    assert east == pytest.approx(math.exp(-1.0), abs=0.08)
    assert north == pytest.approx(0.5 * math.exp(-1.0), abs=0.08)


def test_turbulence_turns_with_the_mean_wind() -> None:
    """The same noise in a mean wind of another direction is the same turbulence, turned."""
    north, turned = (
        steady_wind(WindSettings(mean_ned=mean, turbulence_m_s=6.0), (0.0, 0.0, 0.0), 100) - mean
        for mean in ((6.0, 0.0, 0.0), (3.6, 4.8, 0.0))
    )
    along, across = (0.6, 0.8), (-0.8, 0.6)
    assert turned[:, :2] @ along == pytest.approx(north[:, 0])
    assert turned[:, :2] @ across == pytest.approx(north[:, 1])
    assert turned[:, 2] == pytest.approx(north[:, 2])


def test_repeats_with_its_seed() -> None:
    settings = WindSettings(turbulence_m_s=4.0)
    first, again, other = (steady_wind(settings, (1.0, 0.0, 0.0), 3000, seed) for seed in (7, 7, 8))
    assert (first == again).all()
    assert (first != other).all()
