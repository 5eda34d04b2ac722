"""Mean wind and Gaussian turbulence with Dryden spectra, after MIL-F-8785C 3.7 at low altitude.

With h the height in feet within 10 to 1000, W20 the wind at 20 feet and V the speed through the air:

    sigma_w = 0.1 W20    sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    L_w = h              L_u = L_v = h / (0.177 + 0.000823 h)^1.2
    PSD_u(w) = sigma_u^2 (2 T / pi) / (1 + (T w)^2)                              T = L / V, w in rad/s, one-sided
    PSD_v,w(w) = sigma^2 (T / pi) (1 + 3 (T w)^2) / (1 + (T w)^2)^2

(MIL-HDBK-1797 defines the lengths of v and w as half of these and writes the same spectra in them.) u is along the
mean wind's horizontal direction, v across it to the right, w down. The spectra are those of white noise through
1 / (1 + T s) and (1 + sqrt(3) T s) / (1 + T s)^2. Both filters are sampled exactly: by the transition F over a tick and
by the covariance P - F P F' of the noise gathered in it, with P the stationary covariance. So the variance is sigma^2
and the correlation that of the continuous process at any T.
"""

import math
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from protocol.jit import compiled
from vehicle_sim.integrate import TICK_NS
from vehicle_sim.rigid_body import Array

Vector = tuple[float, float, float]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]

COMPONENTS = 5
"""Filter states: one of u, two of v, two of w."""

_FOOT_M = 0.3048
_LOWEST_FT, _HIGHEST_FT = 10.0, 1000.0
_SLOWEST_M_S = 1.0  # eddies change even if the vehicle drifts with the air and nothing carries them past it
_LONG_S = 1e6  # many time constants
_SQRT_3 = math.sqrt(3.0)
_BLOCK = 2500  # ticks of noise drawn at once: 10 s


class WindSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[wind]` table of a world file."""

    mean_ned: Vector = (0.0, 0.0, 0.0)
    """m/s, at all heights: where the air goes to."""
    turbulence_m_s: NotNegative = 0.0
    """W20: turbulence as it is where the wind at 20 feet (6 m) blows so fast; 0: none."""


@compiled
def dryden_sigma(height_m: float, w20_m_s: float) -> tuple[float, float]:
    """Standard deviations (m/s) along and across (the same), and down."""
    feet = min(max(height_m / _FOOT_M, _LOWEST_FT), _HIGHEST_FT)
    down = 0.1 * w20_m_s
    return down / (0.177 + 0.000823 * feet) ** 0.4, down


@compiled
def dryden_length(height_m: float) -> tuple[float, float]:
    """Lengths (m) along and across (the same), and down."""
    feet = min(max(height_m / _FOOT_M, _LOWEST_FT), _HIGHEST_FT)
    return _FOOT_M * feet / (0.177 + 0.000823 * feet) ** 1.2, _FOOT_M * feet


@compiled
def _first_order(x: float, ticks: float, noise: float) -> float:
    """A state of unit variance, a number of time constants later."""
    return math.exp(-ticks) * x + math.sqrt(-math.expm1(-2.0 * ticks)) * noise


@compiled
def _second_order(states: Array, passed: float, noise: Array) -> float:
    """Advance two states by `passed` time constants, in place; the output, of unit variance.

    x1 is white noise through 1 / (1 + T s), x2 is x1 through the same again. The output sqrt(3) x1 + (1 - sqrt(3)) x2
    has variance 1 if their stationary covariance is [[2, 1], [1, 1]] / 4.
    """
    decay = math.exp(-passed)
    gone = -math.expm1(-2.0 * passed)  # 1 - decay^2
    left = decay * decay
    q11 = 0.5 * gone
    q12 = 0.5 * (0.5 * gone - left * passed)
    q22 = 0.5 * (0.5 * gone - left * passed - left * passed * passed)
    a = math.sqrt(q11)
    b = q12 / a
    c = math.sqrt(max(0.0, q22 - b * b))
    x1: float = decay * states[0] + a * noise[0]
    x2: float = decay * (states[1] + passed * states[0]) + b * noise[0] + c * noise[1]
    states[0], states[1] = x1, x2
    return _SQRT_3 * x1 + (1.0 - _SQRT_3) * x2


@compiled
def gust(
    states: Array, noise: Array, dt: float, height_m: float, airspeed_m_s: float, w20_m_s: float, out: Array
) -> None:
    """Advance the filters (5,) by dt (s), in place; turbulence along, across, down (m/s) into `out` (3,).

    `noise` (5,): independent standard normals. A dt of many time constants draws from the stationary distribution.
    """
    speed = max(airspeed_m_s, _SLOWEST_M_S)
    sideways_length, down_length = dryden_length(height_m)
    sideways_sigma, down_sigma = dryden_sigma(height_m, w20_m_s)
    sideways, down = dt * speed / sideways_length, dt * speed / down_length
    states[0] = _first_order(states[0], sideways, noise[0])
    out[0] = sideways_sigma * states[0]
    out[1] = sideways_sigma * _second_order(states[1:3], sideways, noise[1:3])
    out[2] = down_sigma * _second_order(states[3:5], down, noise[3:5])


@compiled
def _turn(gust_: Array, mean: Array, cos_course: float, sin_course: float, out_ned: Array) -> None:
    out_ned[0] = mean[0] + cos_course * gust_[0] - sin_course * gust_[1]
    out_ned[1] = mean[1] + sin_course * gust_[0] + cos_course * gust_[1]
    out_ned[2] = mean[2] + gust_[2]


@compiled
def _blow(
    state: Array, filters: Array, noise: Array, mean: Array, course: Array, w20: float, gusts: Array, out_ned: Array
) -> None:
    """The wind (3,) of the next tick at a vehicle's state (17,)."""
    dn, de, dd = state[3] - mean[0], state[4] - mean[1], state[5] - mean[2]
    airspeed = math.sqrt(dn * dn + de * de + dd * dd)
    gust(filters, noise, TICK_NS * 1e-9, -state[2], airspeed, w20, gusts)
    _turn(gusts, mean, course[0], course[1], out_ned)


class Wind:
    """What blows at the vehicle, kept in `wind_ned` (3,), one tick after the other."""

    def __init__(self, settings: WindSettings, wind_ned: Array, rng: np.random.Generator) -> None:
        self._settings = settings
        self._wind_ned = wind_ned
        self._rng = rng
        self._mean = np.array(settings.mean_ned)
        course = math.atan2(settings.mean_ned[1], settings.mean_ned[0])
        self._course = np.array([math.cos(course), math.sin(course)])
        self._filters: Array = np.zeros(COMPONENTS)
        self._gusts: Array = np.zeros(3)
        self._noise: NDArray[np.float64] = np.empty((0, COMPONENTS))
        self._used = 0
        wind_ned[:] = self._mean
        if settings.turbulence_m_s > 0.0:
            gust(self._filters, rng.standard_normal(COMPONENTS), _LONG_S, 0.0, 0.0, 0.0, self._gusts)

    def blow(self, state: Array) -> None:
        """On to the next tick, for a vehicle in this state (17,) at its start. Without turbulence nothing changes."""
        if self._settings.turbulence_m_s == 0.0:
            return
        if self._used == len(self._noise):
            self._noise = self._rng.standard_normal((_BLOCK, COMPONENTS))
            self._used = 0
        _blow(
            state,
            self._filters,
            self._noise[self._used],
            self._mean,
            self._course,
            self._settings.turbulence_m_s,
            self._gusts,
            self._wind_ned,
        )
        self._used += 1
