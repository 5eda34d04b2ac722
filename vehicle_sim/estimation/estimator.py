"""The vehicle's estimator: its sensors, read and fused as they come."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from protocol.arrays import Array
from protocol.frames import product
from protocol.jit import compiled
from vehicle_sim.estimation import ground, kalman
from vehicle_sim.physics.motion import Motion
from vehicle_sim.physics.rigid_body import to_world
from vehicle_sim.sensors.settings import DRIFT_TIME_S
from vehicle_sim.sensors.suite import Fix, SensorSuite, as_row, field_ned, wanders
from vehicle_sim.timing import TICK_NS, TICK_S

_SPREAD_TICKS = 5
OUTPUT_S = 0.25
"""Time constant with which position and velocity follow the filter's corrections: EKF2_TAU_POS, EKF2_TAU_VEL."""
GATE = 5.0
"""Standard deviations of an innovation: EKF2_GPS_P_GATE, EKF2_BARO_GATE."""
LOST_NS = 5_000_000_000
"""Without a fix for this time the position is lost: EKF2_NOAID_TOUT."""
_LOST_M = 5.0
"""Or beyond this horizontal standard deviation: COM_POS_FS_EPH."""
_RESET_NS = 7_000_000_000
"""After no fix was taken for this time, the next one that is refused is believed: PX4's reset_timeout_max."""
_LEAST_NOISE = 1e-3
"""Standard deviation (m, m/s) of a measurement that the filter believes in at least: without any noise rounding makes a
variance negative."""
_LEAST_FIELD_NOISE = 1e-4
"""The same in gauss."""
_FAILED_NS = 1_000_000_000
"""A sensor that has been silent for this time, or more than two of its periods, has failed."""
_ALIGNED = (0.01, 0.02, 0.01)
"""Standard deviations at the start, after the alignment at rest: attitude (rad), velocity (m/s), position (m)."""


@compiled
def compare(nominal: Array, behind: Array, gained: Array, truth: Array, estimate: Array, error: Array) -> None:
    """The estimate (19,) from a nominal state (24,), what told position and velocity are `behind` it (6,), and the last
    tick of the inertial unit (6,): position, velocity, attitude, rates, velocity in the body, specific force. And the
    nominal state's error (13,) from the truth (13,), see MOTION."""
    for i in range(3):
        behind[i] += TICK_S * (behind[3 + i] - behind[i] / OUTPUT_S)
        behind[3 + i] -= TICK_S * behind[3 + i] / OUTPUT_S
        estimate[i], estimate[3 + i] = nominal[7 + i] + behind[i], nominal[4 + i] + behind[3 + i]
        estimate[10 + i] = gained[i] / TICK_S - nominal[10 + i]
        estimate[16 + i] = gained[3 + i] / TICK_S - nominal[13 + i]
        error[i], error[3 + i] = nominal[7 + i] - truth[3 + i], nominal[4 + i] - truth[i]
        error[10 + i] = estimate[10 + i] - truth[10 + i]
    b0, b1, b2, b3 = nominal[0], nominal[1], nominal[2], nominal[3]
    estimate[6], estimate[7], estimate[8], estimate[9] = b0, b1, b2, b3
    estimate[13], estimate[14], estimate[15] = to_world(b0, -b1, -b2, -b3, estimate[3], estimate[4], estimate[5])
    error[6], error[7], error[8], error[9] = product((truth[6], -truth[7], -truth[8], -truth[9]), nominal)


@compiled
def follow(
    nominal: Array, behind: Array, gained: Array, since: Array, truth: Array, estimate: Array, error: Array
) -> None:
    """A tick without any measurement: one call of compiled code costs less than two."""
    kalman.predict(nominal, gained, TICK_S, since)
    compare(nominal, behind, gained, truth, estimate, error)


@dataclass(slots=True)
class Readings:
    """What each sensor read last, and when (ns). Before it has read anything: zero."""

    field_frd: Array
    field_ns: int = 0
    height_m: float = 0.0
    height_ns: int = 0
    fix: Fix | None = None


class Estimator:
    """Flies on what it estimates, and tells it `delay_s` late.

    Position and velocity that it tells go over to what was corrected gradually, as PX4's output predictor lets them;
    only a reset is a jump.

    It starts aligned: its first errors are drawn as its first covariance says, with the receiver's error at that time
    taken for the origin.
    """

    def __init__(
        self,
        suite: SensorSuite,
        delay_s: float,
        start: Motion,
        rng: np.random.Generator,
        range_finder: ground.RangeFinder | None = None,
    ) -> None:
        self.suite = suite
        self.ground = None if range_finder is None else ground.Ground(range_finder)
        """What is known of the ground, if there is a beam for it."""
        s = suite.settings
        every = wanders(s)
        self._deviations = np.array([each.deviation for each in every])
        self._times = np.array([each.time_s for each in every])
        self._densities = np.array((s.inertial.gyro_noise, s.inertial.accelerometer_noise, ground.WALK))
        self._field = field_ned(s)
        level, up = s.positioning.position_noise
        slow, climbing = (math.inf, math.inf) if s.gnss is None else s.gnss.velocity_noise
        self._fix_noise = np.maximum((level, level, up, slow, slow, climbing), _LEAST_NOISE)
        self._fix_delay_ns = round(s.positioning.delay_s * 1e9)
        self._ticks = tuple(_period_ticks(each.rate_hz) for each in (s.magnetometer, s.barometer, s.positioning))
        """From one reading of each to the next."""
        self._fixes: deque[tuple[Fix, Array]] = deque()
        """On their way, each with the nominal state of its time."""
        self.field_ratios, self.height_ratios, self.fix_ratios = np.zeros(3), np.zeros(1), np.zeros(6)
        """Squared innovations over their variances, of the last field, height and fix (position, velocity)."""
        self.read = Readings(np.zeros(3))
        self.reset_counter = 0
        """How often the position has jumped to a fix."""
        self.position_lost = True
        """Nobody should fly by its position: it has had no fix for long, or does not believe in it."""
        self._taken_ns = -_RESET_NS
        """Time of the last fix that was taken as a whole; long ago before the first."""
        self._now_ns = 0
        self.nominal, self.covariance = np.zeros(kalman.NOMINAL), np.zeros((kalman.ERROR, kalman.ERROR))
        self._align(start, rng)
        self._since = np.zeros(kalman.SINCE)
        self._since[:4] = self.nominal[:4]
        self.error = np.zeros(13)
        """(13,): of the filter's position, velocity, the attitude as a quaternion from the true body, and the rates."""
        self._behind = np.zeros(6)
        """See `compare`."""
        self._estimate = np.zeros(19)
        delay_ticks = -(round(delay_s * 1e9) // -TICK_NS)
        self._past = deque([start], maxlen=1 + delay_ticks)

    def _align(self, start: Motion, rng: np.random.Generator) -> None:
        deviations = np.concatenate((np.repeat(_ALIGNED, 3), self._deviations, (0.0,)))
        deviations[15:18] = 0.0  # the origin is where the first fix says
        np.fill_diagonal(self.covariance, deviations**2)
        errors = deviations[: kalman.GROUND] * rng.standard_normal(kalman.GROUND)
        self.nominal[:4] = start.attitude_ned_frd
        kalman.turn(self.nominal, *errors[:3].tolist())
        self.nominal[4:7] = np.array(start.velocity_ned) + errors[3:6]
        self.nominal[7:10] = np.array(start.position_ned) + errors[6:9]

    def update(self, truth: Motion) -> tuple[Motion, Motion]:
        """What the vehicle flies on after one more tick, at whose end it moves so, and what it tells."""
        suite, now = self.suite, as_row(truth)
        suite.advance(now, truth.rotor_speeds)
        tick = truth.time_ns // TICK_NS
        if tick % _SPREAD_TICKS:
            follow(self.nominal, self._behind, suite.gained, self._since, now, self._estimate, self.error)
        else:
            kalman.predict(self.nominal, suite.gained, TICK_S, self._since)
            self._drift()
            kalman.spread(self.nominal, self.covariance, self._since, self._densities, self._deviations, self._times)
            self._measure(tick, truth.time_ns)
            compare(self.nominal, self._behind, suite.gained, now, self._estimate, self.error)
        present = self._present(truth)
        self._past.append(present)
        return present, self._past[0]

    def _drift(self) -> None:
        """The wander of an odometry's position is that of the present speed."""
        vio = self.suite.settings.vio
        if vio is not None:
            speed = math.hypot(*self.nominal[kalman.VELOCITY].tolist())
            self._deviations[6:9] = vio.drifted(0.5 * DRIFT_TIME_S * speed)  # of which 2 dt / DRIFT_TIME_S are added

    def _measure(self, tick: int, time_ns: int) -> None:
        """Read what is due, and fuse what has come."""
        suite, read, before, resets = self.suite, self.read, self.nominal.copy(), self.reset_counter
        self._now_ns = time_ns
        field_due, height_due, fix_due = (_due(tick, every) for every in self._ticks)
        if field_due:
            field = suite.field_frd(time_ns)
            if field is not None:
                read.field_frd, read.field_ns = field, time_ns
                noise = max(suite.settings.magnetometer.noise, _LEAST_FIELD_NOISE)
                self.field_ratios = kalman.take_field(self.nominal, self.covariance, self._field, field, noise, GATE)
        if height_due:
            height = suite.height(time_ns)
            if height is not None:
                read.height_m, read.height_ns = height, time_ns
                noise = max(suite.settings.barometer.noise, _LEAST_NOISE)
                self.height_ratios = kalman.take_height(self.nominal, self.covariance, height, noise, GATE)
        if self.ground is not None and _due(tick, _period_ticks(self.ground.finder.rate_hz)):
            self.ground.take(self.nominal, self.covariance, self._estimate[10:13], time_ns, GATE)
        self._correct_fixes(before, time_ns)
        if self._fixes and time_ns - self._fixes[0][0].time_ns >= self._fix_delay_ns:
            self._take_fix(*self._fixes.popleft(), time_ns)
        if fix_due:  # with what has just become known: nothing of it is to be corrected again
            made = suite.fix(time_ns)
            if made is not None:
                self._fixes.append((made, self.nominal.copy()))
        self._behind[:3] += before[kalman.POSITION] - self.nominal[kalman.POSITION]
        self._behind[3:] += before[kalman.VELOCITY] - self.nominal[kalman.VELOCITY]
        if self.reset_counter != resets:
            self._behind[:] = 0.0
        self.position_lost = time_ns - self._taken_ns > LOST_NS or self.deviations[0] > _LOST_M

    def _take_fix(self, fix: Fix, then: Array, time_ns: int) -> None:
        """Fuse a fix of a time at which the nominal state was `then` (24,); or, after a long time, believe it alone."""
        self.read.fix = fix
        before, uncertain, late = self.nominal.copy(), self.covariance.copy(), (time_ns - fix.time_ns) * 1e-9
        read = np.concatenate(
            (fix.position_ned, then[kalman.VELOCITY] if fix.velocity_ned is None else fix.velocity_ned)
        )
        ratios = kalman.take_fix(self.nominal, self.covariance, then, late, read, self._fix_noise, GATE)
        self.fix_ratios = ratios
        if not (ratios > GATE * GATE).any():
            self._taken_ns = time_ns
        elif time_ns - self._taken_ns >= _RESET_NS:
            self.nominal[:], self.covariance[:] = before, uncertain
            self._believe(then, late, read)
            self._taken_ns = time_ns
            self.reset_counter += 1
        self._correct_fixes(before, time_ns)

    def _believe(self, then: Array, late: float, read: Array) -> None:
        """Start anew from a fix. An odometry says where it is, and nothing of the velocity."""
        noise, wander = self._fix_noise.copy(), self._deviations[6:9]
        if self.suite.settings.gnss is None:
            noise[3:], wander = np.sqrt(self.covariance.diagonal()[3:6]), np.zeros(3)
        kalman.reset_to_fix(self.nominal, self.covariance, then, late, read, noise, wander)

    def _correct_fixes(self, before: Array, time_ns: int) -> None:
        """What has become known of the present was so at the fixes' times, too."""
        change = self.nominal - before
        for fix, then in self._fixes:
            then[4:] += change[4:]
            then[7:10] -= (time_ns - fix.time_ns) * 1e-9 * change[4:7]

    def _present(self, truth: Motion) -> Motion:
        """The estimate as a motion; what it does not estimate is as it is."""
        x, y, z, vx, vy, vz, q0, q1, q2, q3, p, q, r, u, v, w, fx, fy, fz = self._estimate.tolist()
        return Motion(
            truth.time_ns,
            (x, y, z),
            (vx, vy, vz),
            (q0, q1, q2, q3),
            (p, q, r),
            truth.rotor_speeds,
            truth.touching,
            truth.impact_m_s,
            (u, v, w),
            (fx, fy, fz),
            truth.shaft_energy_j,
        )

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations (m) that it believes of its place, horizontal and vertical."""
        P = self.covariance
        return math.sqrt(P[6, 6] + P[7, 7]), math.sqrt(P[8, 8])

    @property
    def failed(self) -> tuple[bool, bool, bool]:
        """Whether magnetometer, barometer, and receiver or odometry are silent."""
        s, read, now_ns = self.suite.settings, self.read, self._now_ns
        last = (s.magnetometer, read.field_ns), (s.barometer, read.height_ns), (s.positioning, self.fix_ns)
        field, height, fix = (now_ns - at_ns > max(_FAILED_NS, 2e9 / each.rate_hz) for each, at_ns in last)
        return field, height, fix

    @property
    def ground_m(self) -> float | None:
        """How far below the vehicle the ground is (m); None: not known."""
        if self.ground is None or not self.ground.known(self._now_ns):
            return None
        return float(self.nominal[1 + kalman.GROUND] - self.nominal[9])

    @property
    def fix_ns(self) -> int:
        """Time of the last fix, 0 before the first."""
        return 0 if self.read.fix is None else self.read.fix.time_ns

    @property
    def covariances(self) -> Array:
        """(2, 6, 6): of the position (m, NED) and the attitude as a turn (rad, FRD); of velocity (m/s, FRD) and rates
        (rad/s, FRD)."""
        return kalman.of_motion(self.nominal, self.covariance, self._densities[0] ** 2 / TICK_S)


def _period_ticks(rate_hz: float) -> int:
    return max(1, round(1.0 / (rate_hz * TICK_S)))


def _due(tick: int, every: int) -> bool:
    """In the first step of the covariance after each period."""
    return tick % every < _SPREAD_TICKS
