"""Mean wind and Gaussian turbulence with Dryden spectra, after MIL-F-8785C 3.7 at low altitude.

h is the height in feet, limited to 10 to 1000, W20 the wind at 20 feet, V the airspeed:

    sigma_w = 0.1 W20    sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    L_w = h              L_u = L_v = h / (0.177 + 0.000823 h)^1.2
    PSD_u(w) = sigma_u^2 (2 T / pi) / (1 + (T w)^2)                              T = L / V, w in rad/s, one-sided
    PSD_v,w(w) = sigma^2 (T / pi) (1 + 3 (T w)^2) / (1 + (T w)^2)^2

(MIL-HDBK-1797 defines the lengths of v and w as half of these and writes the same spectra with them.) u is along the
horizontal direction of the mean wind, v across it to the right, w down. White noise through 1 / (1 + T s) and
(1 + sqrt(3) T s) / (1 + T s)^2 has these spectra. Both filters are discretised exactly: by the transition F over a tick
and by the covariance P - F P F' of the noise in a tick, P being the stationary covariance. So the variance is sigma^2
and the correlation is that of the continuous process for every T.
"""

import math
from typing import Annotated

import msgspec
import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled
from vehicle_sim.timing import TICK_S

COMPONENTS = 5
"""Filter states: one of u, two of v, two of w."""

_FOOT_M = 0.3048
_MIN_HEIGHT_FT, _MAX_HEIGHT_FT = 10.0, 1000.0
_MIN_AIRSPEED_M_S = 1.0
"""Eddies change even for a vehicle that drifts with the air, which nothing carries past it."""
_SETTLING_S = 1e6
"""Many time constants of every filter."""
_SQRT_3 = math.sqrt(3.0)
_BLOCK_TICKS = 2500
"""Ticks of noise that are drawn at once: 10 s."""


Speed = Annotated[float, msgspec.Meta(ge=-100, le=100)]
"""m/s; no storm is faster for long."""


class WindSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[wind]` table of a world file."""

    mean_ned: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    """Velocity of the air (m/s), the same at all heights."""
    turbulence_m_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    """W20: the turbulence is that of a wind of this speed at 20 feet (6 m); 0: no turbulence."""


@compiled
def dryden_sigma(height_m: float, w20_m_s: float) -> tuple[float, float]:
    """Standard deviations (m/s): horizontal (along and across), vertical."""
    feet = min(max(height_m / _FOOT_M, _MIN_HEIGHT_FT), _MAX_HEIGHT_FT)
    down = 0.1 * w20_m_s
    return down / (0.177 + 0.000823 * feet) ** 0.4, down


@compiled
def dryden_length(height_m: float) -> tuple[float, float]:
    """Length scales (m): horizontal (along and across), vertical."""
    feet = min(max(height_m / _FOOT_M, _MIN_HEIGHT_FT), _MAX_HEIGHT_FT)
    return _FOOT_M * feet / (0.177 + 0.000823 * feet) ** 1.2, _FOOT_M * feet


@compiled
def _first_order(x: float, steps: float, noise: float) -> float:
    """A state of unit variance, `steps` time constants later."""
    return math.exp(-steps) * x + math.sqrt(-math.expm1(-2.0 * steps)) * noise


@compiled
def _second_order(states: Array, steps: float, noise: Array) -> float:
    """Advance two states (2,) by `steps` time constants, in place, with noise (2,); the output has unit variance.

    x1 is white noise through 1 / (1 + T s), x2 is x1 through the same filter. The output sqrt(3) x1 + (1 - sqrt(3)) x2
    has variance 1 if their stationary covariance is [[2, 1], [1, 1]] / 4.
    """
    decay = math.exp(-steps)
    gained = -math.expm1(-2.0 * steps)  # 1 - decay^2
    kept = decay * decay
    q11 = 0.5 * gained
    q12 = 0.5 * (0.5 * gained - kept * steps)
    q22 = 0.5 * (0.5 * gained - kept * steps - kept * steps * steps)
    a = math.sqrt(q11)
    b = q12 / a
    c = math.sqrt(max(0.0, q22 - b * b))
    x1: float = decay * states[0] + a * noise[0]
    x2: float = decay * (states[1] + steps * states[0]) + b * noise[0] + c * noise[1]
    states[0], states[1] = x1, x2
    return _SQRT_3 * x1 + (1.0 - _SQRT_3) * x2


@compiled
def gust(
    states: Array, noise: Array, dt: float, height_m: float, airspeed_m_s: float, w20_m_s: float, out: Array
) -> None:
    """Advance the filter states (5,) by dt (s), in place; turbulence along, across, down (m/s) into `out` (3,).

    `noise` (5,) holds independent standard normals. A dt of many time constants draws from the stationary distribution.
    """
    speed = max(airspeed_m_s, _MIN_AIRSPEED_M_S)
    horizontal_length, vertical_length = dryden_length(height_m)
    horizontal_sigma, vertical_sigma = dryden_sigma(height_m, w20_m_s)
    horizontal, vertical = dt * speed / horizontal_length, dt * speed / vertical_length
    states[0] = _first_order(states[0], horizontal, noise[0])
    out[0] = horizontal_sigma * states[0]
    out[1] = horizontal_sigma * _second_order(states[1:3], horizontal, noise[1:3])
    out[2] = vertical_sigma * _second_order(states[3:5], vertical, noise[3:5])


@compiled
def _advance(
    state: Array, filters: Array, noise: Array, mean_ned: Array, course: Array, w20_m_s: float, wind_ned: Array
) -> None:
    """The wind (3,) (m/s) of the next tick at a vehicle's state (17,).

    `course` (2,) is the cosine and sine of the mean wind's course. `filters` (5,) and `noise` (5,) are those of `gust`.
    """
    dn, de, dd = state[3] - mean_ned[0], state[4] - mean_ned[1], state[5] - mean_ned[2]
    airspeed = math.sqrt(dn * dn + de * de + dd * dd)
    gust(filters, noise, TICK_S, -state[2], airspeed, w20_m_s, wind_ned)
    along, across, down = wind_ned[0], wind_ned[1], wind_ned[2]
    wind_ned[0] = mean_ned[0] + course[0] * along - course[1] * across
    wind_ned[1] = mean_ned[1] + course[1] * along + course[0] * across
    wind_ned[2] = mean_ned[2] + down


class Wind:
    """The wind at the vehicle, kept in `wind_ned` (3,) (m/s)."""

    def __init__(self, settings: WindSettings, wind_ned: Array, rng: np.random.Generator) -> None:
        self._settings = settings
        self._wind_ned = wind_ned
        self._rng = rng
        self._mean_ned = np.array(settings.mean_ned)
        course = math.atan2(settings.mean_ned[1], settings.mean_ned[0])
        self._course = np.array([math.cos(course), math.sin(course)])
        self._filters: Array = np.zeros(COMPONENTS)
        self._noise: Array = np.empty((0, COMPONENTS))
        self._used = 0
        wind_ned[:] = self._mean_ned
        if settings.turbulence_m_s > 0.0:
            gust(self._filters, rng.standard_normal(COMPONENTS), _SETTLING_S, 0.0, 0.0, 0.0, np.zeros(3))

    def advance(self, state: Array) -> None:
        """Go to the next tick, at whose start the vehicle has this state (17,). Without turbulence nothing changes."""
        if self._settings.turbulence_m_s == 0.0:
            return
        if self._used == len(self._noise):
            self._noise = self._rng.standard_normal((_BLOCK_TICKS, COMPONENTS))
            self._used = 0
        _advance(
            state,
            self._filters,
            self._noise[self._used],
            self._mean_ned,
            self._course,
            self._settings.turbulence_m_s,
            self._wind_ned,
        )
        self._used += 1
