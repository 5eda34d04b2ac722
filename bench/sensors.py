"""The sensors' Allan deviations in an hour at rest beside those of their files.

    python bench/sensors.py [--sensors gnss] [--seed 1] [--json]

Of white noise of density N the Allan deviation is N / sqrt(t), of a Gauss-Markov process of deviation s and time T

    s sqrt(2 T / t (1 - T / (2 t) (3 - 4 exp(-t / T) + exp(-2 t / T))))

(IEEE Std 952-1997, annex B). Each sensor is measured at a short time, at which the noise counts for most, and at a
longer one, at which the wander does.
"""

import argparse
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled
from protocol.toml_files import find, load
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.settings import SensorSettings, Wander
from vehicle_sim.sensors.suite import SensorSuite, as_row, read
from vehicle_sim.timing import TICK_NS, TICK_S

HOUR_S = 3600.0
TIMES_S = (0.4, 10.0)
BLOCK = 50_000


def rest() -> Motion:
    """Level, 3 m up."""
    none = (0.0, 0.0, 0.0)
    return Motion(0, (0.0, 0.0, -3.0), none, (1.0, 0.0, 0.0, 0.0), none, (0.0,) * 4, False, 0.0, none, none, 0.0)


@compiled
def hour_of(row: Array, errors: Array, walk: Array, noise: Array, white: Array, rates: Array, wandering: Array) -> None:
    """Read the inertial unit at rest for as many ticks as `noise` (n, 19) has rows: its rates (n, 6), and the errors
    (n, 13) after each tick. `white` (6,): its noise, as angle and speed of a tick."""
    for tick in range(len(noise)):
        read(row, row, errors, walk, noise[tick], rates[tick])
        for i in range(6):
            rates[tick, i] = (rates[tick, i] + white[i] * noise[tick, 13 + i]) / TICK_S
        wandering[tick] = errors


def allan(samples: Array, every: int) -> float:
    """Allan deviation of samples (n, axes) at so many of them, over all axes."""
    means = samples[: len(samples) // every * every].reshape(-1, every, samples.shape[1]).mean(axis=1)
    return float(np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean()))


def expected(density: float, wander: Wander, t: float) -> float:
    """Allan deviation at a time (s)."""
    T = wander.time_s
    walked = 2.0 * T / t * (1.0 - T / (2.0 * t) * (3.0 - 4.0 * math.exp(-t / T) + math.exp(-2.0 * t / T)))
    return math.sqrt(density**2 / t + wander.deviation**2 * walked)


def measured(settings: SensorSettings, seed: int) -> dict[str, tuple[float, Array, float, Wander]]:
    """What each sensor does: its period (s), what it reads in an hour (n, axes), its density and its wander."""
    start, rng = rest(), np.random.default_rng(seed)
    suite, inertial, gnss = SensorSuite(settings, start, rng), settings.inertial, settings.gnss
    ticks = round(HOUR_S / TICK_S)
    rates, wandering = np.empty((ticks, 6)), np.empty((ticks, 13))
    white = np.repeat((inertial.gyro_noise, inertial.accelerometer_noise), 3) * math.sqrt(TICK_S)
    for begin in range(0, ticks, BLOCK):
        part = slice(begin, begin + BLOCK)
        noise = rng.standard_normal((len(rates[part]), 19))
        hour_of(as_row(start), suite.errors, suite.walk, noise, white, rates[part], wandering[part])

    def sampled(rate_hz: float, take: Callable[[int], Array]) -> tuple[float, Array]:
        """With the errors of the time of each sample."""
        every, found = max(1, round(1.0 / (rate_hz * TICK_S))), []
        for tick in range(every - 1, ticks, every):
            suite.errors[:] = wandering[tick]
            found.append(take(tick * TICK_NS))
        return every * TICK_S, np.array(found)

    heights = sampled(settings.barometer.rate_hz, lambda now: np.array((suite.height(now),)))
    fields = sampled(settings.magnetometer.rate_hz, lambda now: np.array(suite.field_frd(now)))
    if gnss is None:
        raise SystemExit("the drift of an odometry is one of the way, and nothing moves here")
    fixes = sampled(gnss.rate_hz, lambda now: np.array(getattr(suite.fix(now), "position_ned", np.full(3, math.nan))))
    level, up = gnss.position_noise
    return {
        "gyroscope": (TICK_S, rates[:, :3], inertial.gyro_noise, inertial.gyro_bias),
        "accelerometer": (TICK_S, rates[:, 3:], inertial.accelerometer_noise, inertial.accelerometer_bias),
        "barometer": (*heights, settings.barometer.noise * math.sqrt(heights[0]), settings.barometer.bias),
        "magnetometer": (*fields, settings.magnetometer.noise * math.sqrt(fields[0]), settings.magnetometer.hard_iron),
        "gnss, level": (fixes[0], fixes[1][:, :2], level * math.sqrt(fixes[0]), gnss.horizontal_error),
        "gnss, up": (fixes[0], fixes[1][:, 2:], up * math.sqrt(fixes[0]), gnss.vertical_error),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", default="gnss")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    settings = load(find("vehicles/sensors", options.sensors), SensorSettings)
    rows: list[dict[str, Any]] = []
    for name, (period, samples, density, wander) in measured(settings, options.seed).items():
        for t in TIMES_S:
            every = max(1, round(t / period))
            found, wanted = allan(samples, every), expected(density, wander, every * period)
            rows.append({"sensor": name, "time_s": every * period, "allan": found, "configured": wanted})
    if options.json:
        print(json.dumps(rows))
        return
    for row in rows:
        found, wanted = row["allan"], row["configured"]
        beside = f"{found:.3e}  configured {wanted:.3e}  {found / wanted - 1:+.1%}"
        print(f"{row['sensor']:14} {row['time_s']:5.1f} s  {beside}")


if __name__ == "__main__":
    main()
