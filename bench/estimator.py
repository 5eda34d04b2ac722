"""The simulated vehicle's filter beside PX4's EKF2, on the sensors that PX4 recorded in a flight of its SIH.

    python bench/estimator.py FLIGHT.ulg [FLIGHT.ulg ...] [--sensors px4_sih] [--json]

Fly with SDLOG_PROFILE 3, so that each reading is in the log. Our filter is told the noises that SIH has, and in another
run those that EKF2 believes by its parameters, which the log tells: a better accelerometer, a worse receiver and a far
worse barometer. The errors are root mean squares against the truth of the simulation while the vehicle is in the air.
"""

import argparse
import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from pyulog import ULog

from protocol.arrays import Array
from protocol.frames import conjugate, multiply, rotate
from protocol.toml_files import find, load
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.sensors.suite import Fix, SensorSuite
from vehicle_sim.timing import TICK_NS, TICK_S

ASKED_HZ = 50.0
"""How often each sensor is looked at; most often there is nothing new."""
IN_THE_AIR_M = 0.5
_EARTH_M = 6_371_000.0
_JITTER_S = 1e-4
DOWN = np.array((0.0, 0.0, 1.0))
_UPWARD = 1.5
"""EKF2 believes a receiver's height, and its climb, so much less than the rest."""
OURS = "ours"
ERRORS = ("level (m)", "up (m)", "velocity (m/s)", "tilt (deg)", "heading (deg)")


class Log:
    """Topics of a log as arrays, with times in s."""

    def __init__(self, path: Path) -> None:
        self._log = ULog(str(path))

    def times(self, topic: str) -> Array:
        found: Array = self._data(topic)["timestamp"] * 1e-6
        return found

    def columns(self, topic: str, *names: str) -> Array:
        """(n, names)"""
        data = self._data(topic)
        return np.stack([np.asarray(data[name], float) for name in names], axis=1)

    def vectors(self, topic: str, name: str, size: int = 3) -> Array:
        """(n, size)"""
        return self.columns(topic, *(f"{name}[{k}]" for k in range(size)))

    def parameter(self, name: str) -> float:
        return float(self._log.initial_parameters[name])

    def _data(self, topic: str) -> dict[str, Any]:
        for found in self._log.data_list:
            if found.name == topic and found.multi_id == 0:
                data: dict[str, Any] = found.data
                return data
        raise SystemExit(f"the log has no {topic}: SDLOG_PROFILE=3, and PX4's SIH")


@dataclass(frozen=True, slots=True)
class Track:
    """What somebody says of the motion."""

    times: Array
    """(n,) s"""
    position_ned: Array
    velocity_ned: Array
    attitude_times: Array
    """(m,) s"""
    attitude_ned_frd: Array
    """(m, 4)"""


class Recorded(SensorSuite):
    """The sensors of a log, read as they came."""

    def __init__(self, log: Log, settings: SensorSettings, origin: Array, start: Motion) -> None:
        """`origin`: latitude and longitude (deg) and height (m) of the truth's frame."""
        super().__init__(settings, start, np.random.default_rng(1))
        inertial = "sensor_combined"
        self.times = log.times(inertial)
        if np.abs(np.diff(self.times) - TICK_S).max() > _JITTER_S:
            raise SystemExit(f"{inertial} is not in the log every {1e3 * TICK_S:g} ms: SDLOG_PROFILE=3, and PX4's SIH")
        self._all = np.hstack((log.vectors(inertial, "gyro_rad"), log.vectors(inertial, "accelerometer_m_s2"))) * TICK_S
        heights = log.columns("vehicle_air_data", "baro_alt_meter")
        self._heights = _Queue(log.times("vehicle_air_data"), heights - heights[0])
        self._fields = _Queue(log.times("vehicle_magnetometer"), log.vectors("vehicle_magnetometer", "magnetometer_ga"))
        gps = "vehicle_gps_position"
        places = log.columns(gps, "latitude_deg", "longitude_deg", "altitude_msl_m")
        told = np.hstack((_from(origin, places), log.columns(gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")))
        assert settings.gnss is not None
        self._fixes = _Queue(log.times(gps) - settings.gnss.delay_s, told)
        self.at = 0

    def advance(self, now: Array, rotor_speeds: Any = ()) -> None:
        """The next reading of the inertial unit; the truth is not looked at."""
        self.gained[:] = self._all[self.at]
        self.at += 1

    def height(self, time_ns: int) -> float | None:
        read = self._heights.latest(self._now)
        return None if read is None else float(read[0])

    def field_frd(self, time_ns: int) -> Array | None:
        return self._fields.latest(self._now)

    def fix(self, time_ns: int) -> Fix | None:
        read = self._fixes.latest(self._now)
        return None if read is None else Fix(time_ns, read[:3], read[3:])

    @property
    def _now(self) -> float:
        return float(self.times[self.at - 1])


def _from(origin: Array, places: Array) -> Array:
    """North, east and down (n, 3) in m from a place to others: latitude and longitude (deg) and height (m). By PX4's
    sphere, on which its truth moves, and not by the ellipsoid of protocol.frames: 2 cm on a circle of 3 m."""
    turned = np.radians(places[:, :2] - origin[:2]) * _EARTH_M * (1.0, math.cos(math.radians(origin[0])))
    return np.hstack((turned, origin[2:] - places[:, 2:]))


class _Queue:
    """Readings of which each is taken once."""

    def __init__(self, times: Array, rows: Array) -> None:
        self._times, self._rows, self._next = times, rows, 0

    def latest(self, now: float) -> Array | None:
        """What came last, if it has not been taken."""
        upto = int(np.searchsorted(self._times, now, side="right"))
        if upto <= self._next:
            return None
        self._next = upto
        row: Array = self._rows[upto - 1]
        return row


def truth_of(log: Log) -> Track:
    place, attitude = "vehicle_local_position_groundtruth", "vehicle_attitude_groundtruth"
    columns = log.columns(place, "x", "y", "z", "vx", "vy", "vz")
    times, turned = log.times(attitude), log.vectors(attitude, "q", 4)
    return Track(log.times(place), columns[:, :3], columns[:, 3:], times, turned)


def ekf2_of(log: Log, origin: Array) -> Track:
    """PX4's own estimate, in the truth's frame."""
    place = "vehicle_local_position"
    columns = log.columns(place, "x", "y", "z", "vx", "vy", "vz", "ref_lat", "ref_lon", "ref_alt")
    valid = np.isfinite(columns[:, 6])
    columns = columns[valid]
    columns[:, :3] += _from(origin, columns[:, 6:])
    turned = log.vectors("vehicle_attitude", "q", 4)
    return Track(log.times(place)[valid], columns[:, :3], columns[:, 3:6], log.times("vehicle_attitude"), turned)


def ours_of(log: Log, settings: SensorSettings, truth: Track, origin: Array) -> Track:
    """What the simulated vehicle's filter makes of the log's sensors. It starts aligned at rest, as EKF2 has."""
    none = (0.0, 0.0, 0.0)
    attitude = tuple(truth.attitude_ned_frd[0].tolist())
    start = Motion(0, none, none, attitude, none, (0.0,) * 4, False, 0.0, none, none, 0.0)
    suite = Recorded(log, settings, origin, start)
    estimator = Estimator(suite, 0.0, start, np.random.default_rng(1))
    rows = np.empty((len(suite.times), 10))
    for tick in range(len(rows)):
        estimator.update(start._replace(time_ns=(tick + 1) * TICK_NS))
        rows[tick] = estimator.nominal[:10]
    return Track(suite.times, rows[:, 7:], rows[:, 4:7], suite.times, rows[:, :4])


def errors(track: Track, truth: Track) -> Array:
    """(5,) see ERRORS, while the vehicle is in the air."""
    flying = truth.times[truth.position_ned[:, 2] < -IN_THE_AIR_M]
    begin, end = flying[0], min(flying[-1], track.times[-1])
    times = truth.times[(truth.times >= begin) & (truth.times <= end)]
    at = partial(_at, times)
    away = at(track.times, track.position_ned) - at(truth.times, truth.position_ned)
    faster = at(track.times, track.velocity_ned) - at(truth.times, truth.velocity_ned)
    within = (truth.attitude_times >= begin) & (truth.attitude_times <= end)
    order = np.searchsorted(track.attitude_times, truth.attitude_times[within]).clip(max=len(track.attitude_times) - 1)
    attitudes = zip(track.attitude_ned_frd[order], truth.attitude_ned_frd[within], strict=True)
    tilts, headings = np.array([_turned(told, true) for told, true in attitudes]).T
    sizes = (np.linalg.norm(away[:, :2], axis=1), away[:, 2], np.linalg.norm(faster, axis=1), tilts, headings)
    return np.array([math.sqrt(float(np.mean(np.square(size)))) for size in sizes])


def _at(times: Array, own: Array, rows: Array) -> Array:
    return np.stack([np.interp(times, own, column) for column in rows.T], axis=1)


def _turned(told: Array, true: Array) -> tuple[float, float]:
    """By how much the tilt and the heading of an attitude (4,) are wrong (deg)."""
    tilt = math.acos(min(float(rotate(conjugate(told), DOWN) @ rotate(conjugate(true), DOWN)), 1.0))
    w, _, _, z = multiply(told, conjugate(true)).tolist()
    return math.degrees(tilt), math.degrees(2.0 * math.atan(z / w))


def believed(settings: SensorSettings, log: Log) -> SensorSettings:
    """The noises that EKF2 believes, by its parameters; those of the inertial unit count for each of its steps."""
    assert settings.gnss is not None
    change, told = msgspec.structs.replace, log.parameter
    step = math.sqrt(told("EKF2_PREDICT_US") * 1e-6)
    place, speed = told("EKF2_GPS_P_NOISE"), told("EKF2_GPS_V_NOISE")
    return change(
        settings,
        inertial=change(
            settings.inertial,
            gyro_noise=step * told("EKF2_GYR_NOISE"),
            accelerometer_noise=step * told("EKF2_ACC_NOISE"),
        ),
        barometer=change(settings.barometer, noise=told("EKF2_BARO_NOISE")),
        magnetometer=change(settings.magnetometer, noise=told("EKF2_MAG_NOISE")),
        gnss=change(settings.gnss, position_noise=(place, _UPWARD * place), velocity_noise=(speed, _UPWARD * speed)),
    )


def compared(path: Path, sensors: str) -> dict[str, list[float]]:
    """The errors of each filter."""
    log = Log(path)
    settings = load(find("vehicles/sensors", sensors), SensorSettings)
    assert settings.gnss is not None
    often = partial(msgspec.structs.replace, rate_hz=ASKED_HZ)
    settings = msgspec.structs.replace(
        settings,
        barometer=often(settings.barometer),
        magnetometer=often(settings.magnetometer),
        gnss=often(settings.gnss, delay_s=log.parameter("EKF2_GPS_DELAY") * 1e-3),
    )
    origin = log.columns("vehicle_local_position_groundtruth", "ref_lat", "ref_lon", "ref_alt")[0]
    truth = truth_of(log)
    tracks = {
        "EKF2": ekf2_of(log, origin),
        OURS: ours_of(log, settings, truth, origin),
        f"{OURS}, EKF2's noises": ours_of(log, believed(settings, log), truth, origin),
    }
    return {who: errors(track, truth).tolist() for who, track in tracks.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--sensors", default="px4_sih")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    for path in options.logs:
        found = compared(path, options.sensors)
        if options.json:
            print(json.dumps({"log": str(path), "errors": ERRORS, **found}))
            continue
        print(path)
        print(f"{'':22}" + "".join(f"{name:>16}" for name in ERRORS))
        for who, values in found.items():
            print(f"{who:22}" + "".join(f"{value:16.3f}" for value in values))


if __name__ == "__main__":
    main()
