"""Whether the vehicle's telemetry can be true: its parts against one another, and against what a vehicle can do.

A jump of position or heading moves the estimator's frame and nothing in the world. So it moves the frame of the flight,
too: what leaves here goes on without a jump, in the frame of the take-off, and with it mission, references and map. One
that goes back was an outlier. What does not move although other telemetry says that it must is a fault; and where each
message on the ground was another one, as with real sensors, so is what repeats itself. Before `watch`, all is taken as
it comes: estimators settle.

Without noise a vehicle at rest says the same for ever, but it comes to rest slowly: an attitude that was another one in
each message, moved, and then repeats itself has stopped in a way that no vehicle does.
"""

import math
from collections.abc import Sequence

import numpy as np

from companion.reports import AttitudeReport, PositionReport
from companion.state import Announcement, Setpoint, Severity
from companion.told_resets import ToldResets
from companion.turned_frame import Place, Step, TurnedFrame
from protocol.arrays import Array
from protocol.frames import multiply, to_rotation_vector, wrap
from protocol.vehicle_parameters import GRAVITY

_GAP_S = 1.0
"""Behind a longer gap anything may be true."""
_PLACE_M, _REACH = 0.75, 25.0
"""A position may be so far from where the velocity leads (m), and so much more (m/s2, half an acceleration)."""
_SPEED, _PUSH = 2.0, 60.0
"""A velocity may change by so much at once (m/s), and with time (m/s2)."""
_TURN, _TURNING = 0.12, 1.5
"""An attitude may be so far (rad) from the last one, and so many times what the rates say."""
_STILL_S, _STILL_COUNT = 0.1, 4
"""Telemetry that has not changed for so long and in so many messages,"""
_MOVED_M, _TURNED, _PUSHED = 0.1, 0.012, 0.06
"""and should have, by so much (m, rad, m/s), is stuck."""
_ASKED, _ASKED_S = 5e-4, 0.5
"""rad, within so many seconds. An attitude that is the same by every bit, though that was asked for, is stuck."""
_NOISY = 100
"""So many messages in a row of which none goes on as those before it, from a vehicle that stands, show noise."""
_MOVING = 1e-6
"""rad, rad/s, m and m/s: 16 times a float's resolution. So far an attitude that is under way moves in 0.1 to 0.2 s, and
so far noise bends what messages say from one to the next: in recordings at least by twice that."""
_LEVEL = 0.005
"""sin of a tilt that pushes nowhere,"""
_FLIES = 0.002
"""m/s; what stands on the ground is slower,"""
_LIFTS_MS = 20
"""and when it lifts off it takes so long until it turns."""
_SETTLED_S = 0.1
"""A jump that stays for so long is a reset."""
_UNSETTLED_S = 0.2
"""Telemetry that jumps or is refused for longer than this is no telemetry."""
_SAME_TURN, _SAME_M = 0.03, 0.2
"""rad and m: nearer to the settled frame than this, a jump went back there."""
_LEAST_UPRIGHT = 0.3
"""Cosine of the tilt; a thrust that holds the vehicle pushes it by gravity times its tilt's tangent, up to here."""


def _turned(angle: float, north: float, east: float) -> tuple[float, float]:
    c, s = math.cos(angle), math.sin(angle)
    return c * north - s * east, s * north + c * east


class Unchanged:
    """Since when a message has said the same; looked at where it says again what it said before."""

    def __init__(self) -> None:
        self._values: list[float] = []
        self.since_ms = self.count = 0
        self.witness: tuple[float, ...] | None = None
        """What another message said then."""

    def seconds(self, values: list[float], time_ms: int, witness: tuple[float, ...] | None) -> float:
        """For how long, at the vehicle's time; 0 where that is too short to say anything."""
        if values != self._values or not 0 <= time_ms - self.since_ms < 1e6:
            self._values, self.since_ms, self.count, self.witness = values, time_ms, 1, witness
            return 0.0
        self.count += 1
        lasts = (time_ms - self.since_ms) * 1e-3
        return lasts if self.count >= _STILL_COUNT and lasts >= _STILL_S else 0.0


class Motion:
    """Whether an attitude with its rates has stopped from one message to the next."""

    def __init__(self) -> None:
        self.broke_off = False
        """It was under way, and says the same since."""
        self._values: list[float] = []
        self._differed = 0
        """So many messages in a row."""
        self._marks: list[tuple[int, list[float]]] = []
        """Times (ms) and values 0.1 to 0.2 s ago, and later."""

    def take(self, values: list[float], time_ms: int) -> None:
        """The next message."""
        if values == self._values:
            if self._differed:
                moved = max(abs(a - b) for a, b in zip(values, self._marks[0][1], strict=True))
                self.broke_off = self._differed >= _NOISY and moved > _MOVING
                self._differed = 0
            return
        self._values, self.broke_off = values, False
        self._differed += 1
        if not self._marks or not 0 <= time_ms - self._marks[-1][0] < 1e3 * _STILL_S:
            self._marks = [*self._marks[-1:], (time_ms, values)]


class Noise:
    """Whether the messages of a vehicle that stands have noise on them. Without it a vehicle sways on its feet or is
    pushed along by the wind, and each message differs from the last; but it goes on as those before it."""

    def __init__(self) -> None:
        self._due = 0
        """So many messages must still bend; 0: it was not asked, or there is none."""
        self.seen = False
        self._before: list[list[float]] = []

    def look(self) -> None:
        """From the next message on."""
        self.__init__()  # type: ignore[misc]
        self._due = _NOISY

    def take(self, values: list[float]) -> None:
        """The next message."""
        if not self._due:
            return
        if len(self._before) == 2:
            bends = max(abs(a - 2.0 * b + c) for a, b, c in zip(*self._before, values, strict=True)) > _MOVING
            self._due = self._due - 1 if bends else 0
            self.seen = bends and not self._due
        self._before = [*self._before[-1:], values]


class AskedTurn:
    """By what angle the vehicle was asked to turn away from what it did, while its attitude has not changed. What it
    was asked for at first is no turn: it may stand against a torque. Times in ms of the vehicle's clock."""

    def __init__(self) -> None:
        self._since_ms = self._counted_ms = 0
        self._at_first = 0.0, 0.0, 0.0
        self._angle = 0.0
        self._enough_ms: int | None = None
        self._stood_ms = 0

    def shows(
        self, since_ms: int, time_ms: int, asked: tuple[float, float, float], late_s: float, *, flies: bool
    ) -> bool:
        """The attitude is the same since then, and so much was asked for (now: rad/s), so long ago, that it would not
        be if it were true; what is asked takes `late_s` to show, and shows on a vehicle that `flies` alone."""
        if since_ms != self._since_ms:
            self.__init__()  # type: ignore[misc]
            self._since_ms, self._counted_ms, self._at_first = since_ms, time_ms, asked
        dt = (time_ms - self._counted_ms) * 1e-3
        self._angle = self._angle * math.exp(-dt / _ASKED_S) + math.dist(asked, self._at_first) * dt
        self._counted_ms = time_ms
        if self._enough_ms is None and self._angle >= _ASKED:
            self._enough_ms = time_ms
        if not flies:
            self._stood_ms = time_ms
        if self._enough_ms is None or time_ms - self._stood_ms < _LIFTS_MS:
            return False
        return time_ms - self._enough_ms > 1e3 * (_STILL_S + late_s)


class Plausibility:
    """The plausibility of one vehicle's reports. Takes them in the order of arrival; gives them in the frame of the
    flight, or refuses them."""

    def __init__(self) -> None:
        self.watches = False
        """Set by `watch`."""
        self.refused = 0
        """Reports that were not believed, and jumps that went back."""
        self._heading = 0.0
        """rad by which the frame of the vehicle's attitude is turned against that of the flight."""
        self._turn = 0.0
        """The same of its position and velocity,"""
        self._shift = [0.0, 0.0, 0.0]
        """and what is to be added then (m)."""
        self._settled = (0.0, 0.0, [0.0, 0.0, 0.0])
        """These three, as they were before the latest jumps."""
        self._attitude: tuple[int, list[float], float] | None = None
        """Time (ms), attitude and rate of turn as they were believed."""
        self._place: Place | None = None
        """As it was believed."""
        self._odd: tuple[int, list[float]] | None = None
        """Time (ms) and position at the first velocity of those that are refused."""
        self._jumps_ns: tuple[int, int] | None = None
        """The first and the latest jump of those that have not settled."""
        self._refused_ns: dict[str, int] = {}
        """Since when a kind of report is refused without a break."""
        self._attitude_noise, self._place_noise = Noise(), Noise()
        self._still_attitude, self._still_turn = Unchanged(), Unchanged()
        self._still_place, self._still_motion = Unchanged(), Unchanged()
        self._stuck: set[str] = set()
        """What was stuck is so until it changes."""
        self._asked = 0.0, 0.0, 0.0
        """rad/s: how fast the vehicle was asked to turn, the last time."""
        self.late_s = 0.0
        """After so long what is asked shows in what the vehicle says."""
        self._asked_turn, self._told = AskedTurn(), ToldResets()
        self._motion = Motion()
        self._turned = TurnedFrame()

    def watch(self, *, stands: bool) -> None:
        """Judge from now on. Where the vehicle `stands`, it is seen whether its telemetry has noise on it."""
        self.watches = True
        if stands:
            self._attitude_noise.look()
            self._place_noise.look()

    def restart(self) -> None:
        """The vehicle has rebooted: nothing leads from what it said before to what it says now."""
        fresh = Plausibility()
        fresh.watches, fresh.refused, fresh.late_s = self.watches, self.refused, self.late_s
        fresh._heading, fresh._turn, fresh._shift = self._heading, self._turn, self._shift
        fresh._settled = self._settled
        self.__dict__.update(fresh.__dict__)

    def clock_set(self, by_ms: int) -> None:
        """The vehicle's clock was set: what it said before is as old as it was."""
        self._attitude = self._attitude and (self._attitude[0] + by_ms, *self._attitude[1:])
        self._place = self._place and (self._place[0] + by_ms, *self._place[1:])
        self._odd = None
        for each in (self._still_attitude, self._still_turn, self._still_place, self._still_motion):
            each.since_ms += by_ms

    # -- reports -------------------------------------------------------------------------------------------------------

    def attitude(self, report: AttitudeReport, now_ns: int) -> AttitudeReport | None:
        """The report in the frame of the flight; None if it can't be true."""
        if not self.watches:
            return report
        quaternion, rates = report.attitude_ned_frd.tolist(), report.rates_frd.tolist()
        before, time_ms, fast = self._attitude, report.boot_time_ms, math.hypot(*rates)
        if before is not None and 0 <= time_ms - before[0] < _GAP_S * 1e3:
            dt = (time_ms - before[0]) * 1e-3
            allowed = _TURN + _TURNING * max(fast, before[2]) * dt
            last = before[1]
            (a, b, c, d), (e, f, g, h) = quaternion, last
            along = a * e + b * f + c * g + d * h
            leaps = 8.0 * (1.0 - abs(along)) > allowed * allowed
            if leaps and (dt == 0.0 or not self._turns(report, last, allowed, now_ns)):
                self._refuse("attitude", now_ns)
                return None
        if before is None or time_ms > before[0] or time_ms < before[0] - _GAP_S * 1e3:
            same = before is not None and quaternion == before[1]
            self._motion.take(quaternion + rates, time_ms)
            self._attitude_noise.take(quaternion + rates)
            if same:
                self._look_for_stuck_attitude(quaternion, rates, time_ms)
            elif self._still_turn.count:
                self._still_turn, self._still_attitude = Unchanged(), Unchanged()
                self._stuck.discard("attitude")
            self._attitude = time_ms, quaternion, fast
            if self._refused_ns:
                self._refused_ns.pop("attitude", None)
        return report if self._heading == 0.0 else self._attitude_in_flight(report)

    def _attitude_in_flight(self, report: AttitudeReport) -> AttitudeReport:
        return AttitudeReport(report.boot_time_ms, _yawed(report.attitude_ned_frd, -self._heading), report.rates_frd)

    def _turns(self, report: AttitudeReport, last: list[float], allowed: float, now_ns: int) -> bool:
        """The jump is one of the heading alone, and taken for one of the frame."""
        turn = multiply(report.attitude_ned_frd, np.array((last[0], -last[1], -last[2], -last[3])))
        yaw = 2.0 * math.atan2(turn[3], turn[0])
        if np.linalg.norm(to_rotation_vector(_yawed(turn, -yaw))) > allowed:
            return False
        self._heading = wrap(self._heading + yaw)
        if abs(wrap(self._heading - self._settled[0])) < _SAME_TURN:
            self._heading = self._settled[0]
        self._still_motion = Unchanged()  # what turned was the frame
        self._jumped(now_ns)
        step = self._turned.heading_jumped(wrap(self._heading - self._turn), report.boot_time_ms)
        if step is not None:
            self._turn_on(step.place, step.there, now_ns)
        return True

    def position(self, report: PositionReport, now_ns: int) -> PositionReport | None:
        """The report in the frame of the flight; None if it can't be true."""
        if not self.watches:
            return report
        place, velocity = report.position_ned.tolist(), report.velocity_ned.tolist()
        before, time_ms = self._place, report.boot_time_ms
        if before is not None and time_ms == before[0]:  # the same moment once more: it brings no jump
            if math.dist(place, before[1]) > _PLACE_M or math.dist(velocity, before[2]) > _SPEED:
                self._refuse("velocity", now_ns)
                return None
        elif before is not None and 0 < time_ms - before[0] < _GAP_S * 1e3:
            dt = (time_ms - before[0]) * 1e-3
            (x, y, z), (u, v, w), (x0, y0, z0), (u0, v0, w0) = place, velocity, before[1], before[2]
            half = 0.5 * dt
            step = x - x0 - half * (u + u0), y - y0 - half * (v + v0), z - z0 - half * (w + w0)
            told = self._told.step(step)
            jumps = told or math.hypot(*step) > _PLACE_M + _REACH * dt * dt
            leaps = math.hypot(u - u0, v - v0, w - w0) > _SPEED + _PUSH * dt and not self._told.due
            there = self._in_flight([x0 + u0 * dt, y0 + v0 * dt, z0 + w0 * dt])
            taken = Step(before, (time_ms, place, velocity), there)
            if not self._moves(taken, jumps, leaps, now_ns):
                if self._odd is None:
                    self._odd = time_ms, place
                if not self._is_borne_out(place, velocity, time_ms):
                    self._told.refused()
                    self._refuse("velocity", now_ns)
                    return None
                self._put(place, there, now_ns)
            if time_ms > before[0]:
                self._turned.step(taken)
                if self._heading != self._turn and self._attitude is not None:  # after a reboot none may have come
                    self._compare(taken, self._attitude[1], now_ns)
        if before is None or time_ms > before[0] or time_ms < before[0] - _GAP_S * 1e3:
            same = before is not None and place == before[1]
            self._place_noise.take(place + velocity)
            if same:
                self._look_for_stuck_position(place, velocity, time_ms)
            elif self._still_place.count:
                self._still_place, self._still_motion = Unchanged(), Unchanged()
                self._stuck.discard("position")
            self._place, self._odd = (time_ms, place, velocity), None
            self._told.believed()
            if self._refused_ns:
                self._refused_ns.pop("velocity", None)
        if self._turn == 0.0 and not any(self._shift):
            return report
        return PositionReport(time_ms, np.array(self._in_flight(place)), np.array(self._along(velocity)))

    def _along(self, vector: Sequence[float]) -> list[float]:
        return [*_turned(-self._turn, vector[0], vector[1]), vector[2]]

    def _in_flight(self, place: Sequence[float]) -> list[float]:
        return [a + b for a, b in zip(self._along(place), self._shift, strict=True)]

    def _moves(self, step: Step, jumps: bool, leaps: bool, now_ns: int) -> bool:
        """What jumps or leaps is the whole frame: the position alone, or turned as the heading is."""
        turn = wrap(self._heading - self._turn)
        if turn:
            turned = self._turned.shows(turn, step)
            before, dt = step.before[2], step.dt
            swift = [*_turned(turn, before[0], before[1]), before[2]]
            if (jumps or leaps) and turned is None:  # both at once are one
                turned = math.dist(step.velocity, swift) <= _SPEED + _PUSH * dt
            if turned and math.dist(step.velocity, swift) <= _SPEED + _PUSH * dt:
                self._turn_on(step.place, step.there, now_ns)
                return True
        if leaps:
            return False
        if jumps:
            self._put(step.place, step.there, now_ns)
        return True

    def _turn_on(self, place: Sequence[float], there: Sequence[float], now_ns: int) -> None:
        """The frame of positions has turned as the heading did, and a position is that place of the flight."""
        self._turn = self._heading
        self._put(place, there, now_ns)

    def _put(self, place: Sequence[float], there: Sequence[float], now_ns: int) -> None:
        """The frame moves, so that a position is that place of the flight."""
        shift = [a - b for a, b in zip(there, self._along(place), strict=True)]
        self._told.followed()
        _, turn, settled = self._settled
        self._shift = settled if turn == self._turn and math.dist(shift, settled) < _SAME_M else shift
        self._jumped(now_ns)

    def resets(self, now_ns: int, *, reset: bool) -> None:
        """The vehicle tells that its estimate was reset since it was asked last, or that it was not: a step too small
        to be recognised is one of the frame, too."""
        step = self._told.told(reset=reset)
        if step is not None and self.watches:
            self._shift = [a - b for a, b in zip(self._shift, self._along([*step]), strict=True)]
            self._jumped(now_ns)

    def _is_borne_out(self, place: list[float], velocity: list[float], time_ms: int) -> bool:
        """A velocity that has leapt is borne out by the way that the vehicle has made since."""
        assert self._odd is not None
        dt = (time_ms - self._odd[0]) * 1e-3
        way = [p + v * dt for p, v in zip(self._odd[1], velocity, strict=True)]
        return dt >= _SETTLED_S and math.dist(place, way) < 0.1 + 0.3 * math.hypot(*velocity) * dt

    def _compare(self, step: Step, attitude: list[float], now_ns: int) -> None:
        """Since the heading jumped alone: if the vehicle accelerates as if its position's frame were turned with it,
        this is what it is, and was not seen at a standstill."""
        w, x, y, z = attitude
        upright = GRAVITY / max(1.0 - 2.0 * (x * x + y * y), _LEAST_UPRIGHT)
        push = _turned(-self._heading, -2.0 * (x * z + w * y) * upright, -2.0 * (y * z - w * x) * upright)
        before, after = step.before[2], step.velocity
        change = _turned(-self._turn, after[0] - before[0], after[1] - before[1])
        base = self._turned.accelerates(wrap(self._heading - self._turn), complex(*push), complex(*change), step)
        if base is not None:
            self._turn_on(base.place, base.there, now_ns)

    def setpoint(self, setpoint: Setpoint) -> Setpoint:
        """A setpoint of the flight's frame in that of the vehicle."""
        p, q, r = setpoint.rates_frd
        self._asked = p, q, r
        if self._heading == 0.0:
            return setpoint
        attitude = _yawed(np.array(setpoint.attitude_ned_frd), self._heading).tolist()
        return Setpoint(attitude, setpoint.rates_frd, setpoint.torque, setpoint.thrust)

    # -- faults --------------------------------------------------------------------------------------------------------

    def _look_for_stuck_attitude(self, quaternion: list[float], rates: list[float], time_ms: int) -> None:
        speed = None if self._place is None else tuple(self._place[2])
        still = self._still_attitude
        alike = self._still_turn.seconds(quaternion, time_ms, speed)
        wholly = still.seconds(quaternion + rates, time_ms, speed)
        stuck = bool(alike) and (self._attitude_noise.seen or math.hypot(*rates) * alike > 4.0 * _TURNED)
        stuck = stuck or (wholly > 0.0 and self._motion.broke_off)
        flies = speed is not None and math.hypot(*speed) > _FLIES
        shows = self._asked_turn.shows(still.since_ms, time_ms, self._asked, self.late_s, flies=flies)
        if wholly and speed is not None:
            still.witness = still.witness or speed
            stuck = stuck or _aside(quaternion, speed, still.witness) > _PUSHED
            stuck = stuck or shows
        if stuck:
            self._stuck.add("attitude")

    def _look_for_stuck_position(self, place: list[float], velocity: list[float], time_ms: int) -> None:
        turned = None if self._attitude is None else tuple(self._attitude[1])
        alike = self._still_place.seconds(place, time_ms, turned)
        wholly = self._still_motion.seconds(place + velocity, time_ms, turned)
        stuck = bool(alike) and (self._place_noise.seen or math.hypot(*velocity) * alike > _MOVED_M)
        if wholly and turned is not None and self._still_motion.witness is not None:
            along = abs(sum(a * b for a, b in zip(turned, self._still_motion.witness, strict=True)))
            stuck = stuck or 8.0 * (1.0 - along) > _TURNED * _TURNED
        if stuck:
            self._stuck.add("position")

    def _refuse(self, what: str, now_ns: int) -> None:
        self.refused += 1
        self._refused_ns.setdefault(what, now_ns)

    def _jumped(self, now_ns: int) -> None:
        self._jumps_ns = now_ns if self._jumps_ns is None else self._jumps_ns[0], now_ns

    def fault(self, now_ns: int) -> str | None:
        """Why the telemetry can't be true, for so long that it is not to be flown by; None if it may be."""
        if self._stuck:
            return f"{' and '.join(sorted(self._stuck))} stuck"
        for what, since_ns in self._refused_ns.items():
            if now_ns - since_ns > _UNSETTLED_S * 1e9:
                return f"{what} that the vehicle can't have"
        jumps = self._jumps_ns
        if jumps is not None and jumps[1] - jumps[0] > _UNSETTLED_S * 1e9:
            return "position or heading jumps on and on"
        return None

    def news(self, now_ns: int) -> Announcement | None:
        """A reset that has settled, once."""
        jumps = self._jumps_ns
        if jumps is None or now_ns - jumps[1] < _SETTLED_S * 1e9:
            return None
        heading, _, shift = self._settled
        moved, turned = math.dist(shift, self._shift), wrap(self._heading - heading)
        self._jumps_ns, self._settled = None, (self._heading, self._turn, self._shift)
        if not moved and not turned:
            self.refused += 1
            return Announcement(Severity.WARNING, "telemetry jumped and went back: not followed")
        text = f"the vehicle's estimate was reset by {moved:.1f} m and {math.degrees(turned):.0f} deg: gone along with"
        return Announcement(Severity.WARNING, text)


def _aside(attitude: Sequence[float], velocity: Sequence[float], before: Sequence[float]) -> float:
    """m/s: how far the velocity has changed to where a thrust at this attitude can't push, nor the weight."""
    w, x, y, z = attitude
    north, east = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    a, b, tilt = velocity[0] - before[0], velocity[1] - before[1], math.hypot(north, east)
    return abs(a * east - b * north) / tilt if tilt > _LEVEL else math.hypot(a, b)


def _yawed(attitude_ned_frd: Array, angle: float) -> Array:
    """The attitude (4,) turned by an angle (rad) about the vertical of the world."""
    return multiply(np.array((math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))), attitude_ned_frd)
