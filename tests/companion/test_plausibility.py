"""Telemetry of a motion that a vehicle can fly passes untouched; what is stuck, leaps or is turned does not."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from companion.plausibility import Plausibility
from companion.reports import AttitudeReport, PositionReport
from companion.state import Setpoint
from protocol.arrays import Array
from protocol.frames import from_euler, multiply, rotate

MS = 1_000_000
STEP_MS = 8
FAULT_MS = 1000
TILTED = from_euler(0.05, -0.1, 0.0)
Telemetry = tuple[AttitudeReport, PositionReport]
Change = Callable[[int, Telemetry], Telemetry]
COUNT_MS, COUNTED_MS = 32, 1024
Counted = tuple[bool, int]
"""Whether the vehicle's count of resets comes before its position, and when (ms) it counts one."""


def motion(ms: int) -> Telemetry:
    """A circle of 4 m at 3 m/s, climbing and falling, with the heading along it and the tilt that it takes."""
    s, radius, w = ms * 1e-3, 4.0, 0.75
    place = np.array([radius * math.sin(w * s), radius * (1.0 - math.cos(w * s)), -5.0 + 0.5 * math.sin(s)])
    speed = np.array([radius * w * math.cos(w * s), radius * w * math.sin(w * s), 0.5 * math.cos(s)])
    attitude = from_euler(math.atan(radius * w * w / 9.81), 0.0, w * s)
    return AttitudeReport(ms, attitude, np.array([0.0, 0.17, 0.74])), PositionReport(ms, place, speed)


class Flown:
    """What comes of the motion with a change of it from FAULT_MS on."""

    def __init__(
        self, change: Change = lambda ms, told: told, until_ms: int = 3000, counted: Counted | None = None
    ) -> None:
        """`counted` says at a time whether the vehicle counts a reset: every 32 ms, before or after its position."""
        self.told, self.news, self.fault_ms = Plausibility(), list[str](), math.inf
        self.attitudes, self.places = list[tuple[int, Array]](), list[tuple[int, Array, Array]]()
        self.told.watch(stands=False)
        for ms in range(0, until_ms, STEP_MS):
            attitude, position = motion(ms)
            if ms >= FAULT_MS:
                attitude, position = change(ms, (attitude, position))
            turned = self.told.attitude(attitude, ms * MS)
            first = counted is not None and counted[0]
            if first:
                self.count(ms, counted)
            moved = self.told.position(position, ms * MS)
            if not first:
                self.count(ms, counted)
            if turned is not None:
                self.attitudes.append((ms, turned.attitude_ned_frd))
            if moved is not None:
                self.places.append((ms, moved.position_ned, moved.velocity_ned))
            if self.told.fault(ms * MS) is not None:
                self.fault_ms = min(self.fault_ms, ms)
            said = self.told.news(ms * MS)
            self.news += [] if said is None else [said.text]

    def count(self, ms: int, counted: Counted | None) -> None:
        if counted is not None and ms % COUNT_MS == 0:
            self.told.resets(ms * MS, reset=counted[1] <= ms < counted[1] + COUNT_MS)

    def follows_the_motion(self) -> bool:
        """Everything that was passed on is the motion, to within what is not known of it between two samples."""
        turns = [abs(float(q @ motion(ms)[0].attitude_ned_frd)) for ms, q in self.attitudes]
        away = [np.linalg.norm(p - motion(ms)[1].position_ned) for ms, p, _ in self.places]
        slower = [np.linalg.norm(v - motion(ms)[1].velocity_ned) for ms, _, v in self.places]
        return bool(min(turns) > math.cos(0.5 * 0.02) and max(away) < 0.05 and max(slower) < 0.1)


def turned(angle: float, *, whole: bool) -> Change:
    """The estimator's frame turned by an angle: all of it, or the attitude alone."""
    turn = from_euler(0.0, 0.0, angle)

    def change(ms: int, told: Telemetry) -> Telemetry:
        attitude, position = told
        told_attitude = AttitudeReport(ms, multiply(turn, attitude.attitude_ned_frd), attitude.rates_frd)
        if not whole:
            return told_attitude, position
        place, speed = rotate(turn, position.position_ned), rotate(turn, position.velocity_ned)
        return told_attitude, PositionReport(ms, place, speed)

    return change


def shifted(*by: float) -> Change:
    return lambda ms, told: (told[0], PositionReport(ms, told[1].position_ned + by, told[1].velocity_ned))


def at_once(change: Change, lasts_ms: int) -> Change:
    return lambda ms, told: change(ms, told) if ms < FAULT_MS + lasts_ms else told


def faster(ms: int, told: Telemetry) -> Telemetry:
    speed = told[1].velocity_ned.copy()
    speed[0] = 140.0
    return told[0], PositionReport(ms, told[1].position_ned, speed)


def test_what_a_vehicle_can_fly_passes_as_it_is() -> None:
    flown = Flown()
    assert flown.fault_ms == math.inf and not flown.news and flown.told.refused == 0
    report, position = motion(5000)
    assert flown.told.attitude(report, 0) is report and flown.told.position(position, 0) is position


def frozen_position(ms: int, told: Telemetry) -> Telemetry:
    kept = motion(FAULT_MS)[1]
    return told[0], PositionReport(ms, kept.position_ned, kept.velocity_ned)


def frozen_place(ms: int, told: Telemetry) -> Telemetry:
    return told[0], PositionReport(ms, motion(FAULT_MS)[1].position_ned, told[1].velocity_ned)


def frozen_attitude(ms: int, told: Telemetry) -> Telemetry:
    kept = motion(FAULT_MS)[0]
    return AttitudeReport(ms, kept.attitude_ned_frd, kept.rates_frd), told[1]


def frozen_level(ms: int, told: Telemetry) -> Telemetry:
    """An attitude without rates: the velocity tells."""
    return AttitudeReport(ms, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)), told[1]


@pytest.mark.parametrize("change", [frozen_position, frozen_place, frozen_attitude])
def test_what_stands_still_in_motion_is_a_fault_within_300_ms(change: Change) -> None:
    assert FAULT_MS < Flown(change).fault_ms <= FAULT_MS + 300


def test_an_attitude_that_stays_the_same_while_the_velocity_changes_is_stuck() -> None:
    told, faults = Plausibility(), list[int]()
    told.watch(stands=False)
    for ms in range(0, 1000, STEP_MS):
        told.position(motion(ms)[1], ms * MS)
        told.attitude(frozen_level(ms, motion(ms))[0], ms * MS)
        faults += [ms] if told.fault(ms * MS) else []
    assert faults and faults[0] <= 300


@pytest.mark.parametrize("speed", [0.0, 1e-4])
def test_a_vehicle_that_stands_still_may_say_the_same_for_ever(speed: float) -> None:
    """On the ground, or in a simulator without noise; also while it is asked to turn and does not fly yet."""
    told = Plausibility()
    told.watch(stands=False)
    for ms in range(0, 20_000, STEP_MS):
        assert told.attitude(AttitudeReport(ms, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)), ms * MS) is not None
        assert told.position(PositionReport(ms, np.zeros(3), np.array([speed, 0.0, 0.0])), ms * MS) is not None
        told.setpoint(Setpoint((1.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2))
        assert told.fault(ms * MS) is None


def test_a_vehicle_that_was_asked_to_turn_on_the_ground_may_lift_off_before_it_turns() -> None:
    told = Plausibility()
    told.watch(stands=True)
    for ms in range(0, 1000, STEP_MS):
        lifted = max(ms - 800, 0) * 1e-3  # s
        pitch = 0.3 * max(lifted - 2.5e-3 * STEP_MS, 0.0)
        told.attitude(AttitudeReport(ms, from_euler(0.0, pitch, 0.0), 0.3 * (pitch > 0.0) * np.eye(3)[1]), ms * MS)
        told.position(
            PositionReport(ms, np.array([0.0, 0.0, -0.5 * lifted**2]), np.array([0.0, 0.0, -lifted])), ms * MS
        )
        told.setpoint(Setpoint((1.0, 0.0, 0.0, 0.0), (0.0, 0.3 * (ms > 300), 0.0), (0.0, 0.0, 0.0), 0.6))
        assert told.fault(ms * MS) is None


def climbing(asked: float, until_ms: int, late_s: float = 0.0, at_first: float = 0.0, more: float = 0.0) -> float:
    """A climb at a level attitude that never changes, in which a turn is asked for (rad/s, and `more` rad/s2) from
    FAULT_MS on, and another one `at_first`; ms from then on to the fault."""
    told = Plausibility()
    told.late_s = late_s
    told.watch(stands=True)
    for ms in range(0, FAULT_MS + until_ms, STEP_MS):
        told.attitude(AttitudeReport(ms, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)), ms * MS)
        speed = 1e-3 * ms  # m/s
        told.position(
            PositionReport(ms, np.array([0.0, 0.0, -0.5e-3 * ms * speed]), np.array([0.0, 0.0, -speed])), ms * MS
        )
        rate = asked + more * 1e-3 * (ms - FAULT_MS) if ms >= FAULT_MS else at_first
        told.setpoint(Setpoint((1.0, 0.0, 0.0, 0.0), (rate, 0.0, 0.0), (0.0, 0.0, 0.0), 0.6))
        if told.fault(ms * MS):
            return ms - FAULT_MS
    return math.inf


def test_a_climb_at_a_constant_attitude_is_none_that_is_stuck() -> None:
    assert climbing(asked=0.0, until_ms=1500) == math.inf


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_an_attitude_that_does_not_follow_what_is_asked_is_stuck(late_s: float) -> None:
    """Though it is the same since the start; over a late link an answer takes its time."""
    assert 1e3 * late_s + 100 <= climbing(asked=1.0, until_ms=1500, late_s=late_s) <= 1e3 * late_s + 200


def test_an_attitude_that_does_not_begin_a_gentle_turn_is_stuck_within_300_ms() -> None:
    """As at the end of a climb, where the way along a track begins: 0.4 degrees in the first 0.3 s."""
    assert 100 <= climbing(asked=0.0, more=0.15, until_ms=1500) <= 300


def test_a_turn_that_is_asked_for_all_the_time_and_not_flown_stands_against_a_torque() -> None:
    assert climbing(asked=0.2, at_first=0.2, until_ms=3000) == math.inf


@pytest.mark.parametrize(("along", "stuck"), [((2.0, 1.0), False), ((-2.0, -1.0), False), ((1.0, -2.0), True)])
def test_a_constant_tilt_pushes_along_itself(along: tuple[float, float], stuck: bool) -> None:
    """Nose down to the north and right side down to the east, twice as much of the first."""
    told, faults = Plausibility(), list[str]()
    told.watch(stands=False)
    for ms in range(0, 2000, STEP_MS):
        s = ms * 1e-3
        speed = 0.2 * s * np.array([*along, 0.0])
        told.position(PositionReport(ms, 0.5 * s * speed, speed), ms * MS)
        told.attitude(AttitudeReport(ms, TILTED, np.zeros(3)), ms * MS)
        faults += filter(None, [told.fault(ms * MS)])
    assert bool(faults) is stuck


def hovering(noise: float, frozen: Callable[[Telemetry, Telemetry], Telemetry], *, stands: bool = True) -> float:
    """A vehicle at rest whose telemetry has noise (rad, m), watched from the start; ms from FAULT_MS on, when it is
    `frozen` to what was said then, to the fault."""
    told, rng = Plausibility(), np.random.default_rng(3)
    told.watch(stands=stands)
    kept: Telemetry | None = None
    for ms in range(0, 3000, STEP_MS):
        attitude = AttitudeReport(ms, from_euler(*(noise * rng.standard_normal(3))), noise * rng.standard_normal(3))
        position = PositionReport(ms, noise * rng.standard_normal(3), noise * rng.standard_normal(3))
        if ms >= FAULT_MS:
            kept = kept or (attitude, position)
            attitude, position = frozen(kept, (attitude, position))
        told.attitude(AttitudeReport(ms, attitude.attitude_ned_frd, attitude.rates_frd), ms * MS)
        told.position(PositionReport(ms, position.position_ned, position.velocity_ned), ms * MS)
        if told.fault(ms * MS):
            return ms - FAULT_MS
    return math.inf


@pytest.mark.parametrize(
    ("frozen", "taken_over_ms"),
    [(lambda kept, told: (kept[0], told[1]), 150), (lambda kept, told: (told[0], kept[1]), math.inf)],
    ids=["attitude", "position"],
)
def test_what_had_noise_and_repeats_itself_is_stuck_though_nothing_moves(
    frozen: Callable[[Telemetry, Telemetry], Telemetry], taken_over_ms: float
) -> None:
    """Who takes a vehicle over in flight can't tell a position's noise from motion; an attitude does not stop so."""
    assert hovering(5e-6, frozen) <= 150
    assert hovering(0.0, frozen) == math.inf, "a simulator without noise"
    taken_over = hovering(5e-6, frozen, stands=False)
    assert taken_over == taken_over_ms or taken_over <= taken_over_ms < math.inf
    assert hovering(5e-6, lambda kept, told: told) == math.inf


def test_who_slides_and_sways_in_the_wind_before_take_off_shows_no_noise() -> None:
    """In a simulator: no message is like the last, until the vehicle flies at rest."""
    told = Plausibility()
    told.watch(stands=True)
    for ms in range(0, 3000, STEP_MS):
        s = min(ms, 1500) * 1e-3
        slides, sways = np.array([0.003, 0.008, 0.0]), 1e-4 * math.exp(-10.0 * s) + 1e-9 * (ms < 1500) * s
        told.attitude(AttitudeReport(ms, from_euler(sways, 0.001, 0.0), np.array([-10.0 * sways, 0.0, 0.0])), ms * MS)
        told.position(PositionReport(ms, s * slides, slides * (ms < 1500)), ms * MS)
        assert told.fault(ms * MS) is None


def settling(tau: float, step_ms: int, said: Callable[[Array], Array], frozen_ms: float = math.inf) -> float:
    """A pitch that goes to zero with a time constant (s), told every `step_ms`, its numbers as `said` leaves them;
    from `frozen_ms` on what is told stays. ms to the fault."""
    told = Plausibility()
    told.watch(stands=False)
    for ms in range(0, 8000, step_ms):
        pitch = 0.01 * math.exp(-1e-3 * min(ms, frozen_ms) / tau)
        values = said(np.array([*from_euler(0.0, pitch, 0.0), 0.0, -pitch / tau, 0.0]))
        told.attitude(AttitudeReport(ms, values[:4], values[4:]), ms * MS)
        told.position(PositionReport(ms, np.zeros(3), np.zeros(3)), ms * MS)
        if told.fault(ms * MS):
            return ms - frozen_ms
    return math.inf


def as_floats(values: Array) -> Array:
    return values.astype(np.float32).astype(float)


@pytest.mark.parametrize("step_ms", [4, 20, 50])
@pytest.mark.parametrize("tau", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("said", [as_floats, lambda values: np.round(values, 7), lambda values: np.round(values, 5)])
def test_what_comes_to_rest_by_itself_is_not_stuck(tau: float, step_ms: int, said: Callable[[Array], Array]) -> None:
    """However coarse its numbers are, and though they are all the same in the end."""
    assert settling(tau, step_ms, said) == math.inf


@pytest.mark.parametrize("step_ms", [4, 20])
def test_an_attitude_that_stops_from_one_message_to_the_next_is_stuck(step_ms: int) -> None:
    """Though it turned slowly, by 1e-3 degrees a second, and nothing else tells."""
    assert 100 <= settling(1.0, step_ms, as_floats, frozen_ms=6000) <= 200


@pytest.mark.parametrize("angle", [-90.0, 45.0, 90.0, 170.0])
@pytest.mark.parametrize("whole", [False, True])
def test_a_heading_that_is_reset_turns_the_frame_and_not_the_flight(angle: float, whole: bool) -> None:
    flown = Flown(turned(math.radians(angle), whole=whole))
    assert flown.fault_ms == math.inf and flown.follows_the_motion()
    assert len(flown.news) == 1 and f"{abs(angle):.0f} deg" in flown.news[0]
    level = Setpoint((1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, 0.0), 0.5)
    sent = flown.told.setpoint(level)
    assert np.array(sent.attitude_ned_frd) == pytest.approx(from_euler(0.0, 0.0, math.radians(angle)), abs=0.02)
    assert (sent.rates_frd, sent.thrust) == (level.rates_frd, level.thrust)


def test_after_a_reboot_of_a_turned_frame_positions_may_come_before_an_attitude() -> None:
    told = Flown(turned(1.0, whole=False)).told
    told.restart()
    assert None not in [told.position(motion(ms)[1], ms * MS) for ms in (0, STEP_MS)]


@pytest.mark.parametrize("by", [(0.0, 0.0, -3.0), (90_000.0, 0.0, 0.0), (2.0, -5.0, 1.0)])
def test_a_position_that_is_reset_shifts_the_frame_and_not_the_flight(by: tuple[float, ...]) -> None:
    flown = Flown(shifted(*by))
    assert flown.fault_ms == math.inf and flown.follows_the_motion()
    assert len(flown.news) == 1 and f"{np.linalg.norm(by):.1f} m" in flown.news[0]


@pytest.mark.parametrize("change", [shifted(0.0, 0.0, -3.0), turned(1.0, whole=False), turned(1.0, whole=True), faster])
def test_a_jump_that_goes_back_leaves_nothing_behind(change: Change) -> None:
    flown = Flown(at_once(change, 2 * STEP_MS))
    assert flown.fault_ms == math.inf and flown.follows_the_motion() and flown.told.refused > 0
    report, position = motion(5000)
    assert flown.told.attitude(report, 0) is report and flown.told.position(position, 0) is position


def test_a_velocity_that_the_way_does_not_bear_out_is_a_fault() -> None:
    flown = Flown(faster, FAULT_MS + 400)
    assert flown.fault_ms <= FAULT_MS + 300 and flown.follows_the_motion()


def test_a_velocity_that_the_way_bears_out_is_believed() -> None:
    def blown(ms: int, told: Telemetry) -> Telemetry:
        speed = np.array([20.0, 0.0, 0.0])
        return told[0], PositionReport(ms, motion(FAULT_MS)[1].position_ned + speed * (ms - FAULT_MS) * 1e-3, speed)

    assert Flown(blown).fault_ms == math.inf


def test_an_attitude_that_tips_over_at_once_is_a_fault() -> None:
    def tipped(ms: int, told: Telemetry) -> Telemetry:
        return AttitudeReport(ms, multiply(told[0].attitude_ned_frd, from_euler(0.6, 0.0, 0.0)), np.zeros(3)), told[1]

    flown = Flown(tipped, FAULT_MS + 400)
    assert flown.fault_ms <= FAULT_MS + 300 and flown.follows_the_motion()


def test_what_jumps_on_and_on_is_a_fault() -> None:
    random = np.random.default_rng(1)
    flown = Flown(lambda ms, told: shifted(*random.normal(0.0, 30.0, 3))(ms, told))
    assert flown.fault_ms <= FAULT_MS + 300


def test_before_a_flight_all_is_taken_as_it_comes() -> None:
    told = Plausibility()
    for ms, by in ((0, 0.0), (8, 50.0), (16, -50.0)):
        position = shifted(by, 0.0, 0.0)(ms, motion(ms))[1]
        assert told.position(position, ms * MS) is position
    assert told.refused == 0 and told.news(10**12) is None


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("angle", [-1.5, 0.8, 1.2])
def test_a_frame_that_turned_at_a_standstill_is_known_by_how_the_vehicle_speeds_up(angle: float, whole: bool) -> None:
    """At the origin nothing else tells; the vehicle pitches down and gathers speed to the north, which it had as its
    heading."""
    told, change, way = Plausibility(), turned(angle, whole=whole), np.zeros(3)
    told.watch(stands=False)
    for ms in range(0, 3000, STEP_MS):
        pitch = 0.2 * min(max((ms - 1000) / 100.0, 0.0), 1.0)
        s = max(ms - 1000, 0) * 1e-3
        speed = np.array([9.81 * 0.2 * s, 0.0, 0.0])
        rates = np.array([0.0, -2.0 if 0.0 < pitch < 0.2 else 0.0, 0.0])
        truth = (
            AttitudeReport(ms, from_euler(1e-4 * math.sin(ms), -pitch, 0.0), rates),
            PositionReport(ms, 0.5 * s * speed, speed),
        )
        attitude, position = change(ms, truth) if ms >= 500 else truth
        assert told.attitude(attitude, ms * MS) is not None
        moved = told.position(position, ms * MS)
        assert moved is not None and told.fault(ms * MS) is None
        told.news(ms * MS)
        way = np.array([*moved.position_ned, *moved.velocity_ned])
    assert way == pytest.approx(np.array([*truth[1].position_ned, *speed]), abs=0.1), "as if it had been seen at once"


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("angle", [-45.0, 30.0, 90.0])
@pytest.mark.parametrize("last_ms", [-STEP_MS, 0, 150])
@pytest.mark.parametrize("north", [-0.3, 0.6, 40.0])
def test_a_frame_that_turned_on_a_slow_way_is_known_at_once(
    whole: bool, angle: float, last_ms: int, north: float
) -> None:
    """Too slow and near for a leap or a jump; the position comes before the attitude or after it."""
    told, change, worst = Plausibility(), turned(math.radians(angle), whole=whole), 0.0
    told.watch(stands=False)
    for ms in range(0, 4000, STEP_MS):
        sway = 0.05 * math.sin(2e-3 * ms)
        truth = (
            AttitudeReport(ms, from_euler(0.0, 0.02 * sway, 0.0), np.zeros(3)),
            PositionReport(ms, np.array([north + 9e-4 * (ms - FAULT_MS), sway, 0.0]), np.array([0.9, 2.0 * sway, 0.0])),
        )
        attitude = change(ms, truth)[0] if ms >= FAULT_MS else truth[0]
        position = change(ms, truth)[1] if ms >= FAULT_MS + last_ms else truth[1]
        if last_ms < 0:
            moved = told.position(position, ms * MS)
            told.attitude(attitude, ms * MS)
        else:
            told.attitude(attitude, ms * MS)
            moved = told.position(position, ms * MS)
        assert moved is not None and told.fault(ms * MS) is None
        told.news(ms * MS)
        if ms > FAULT_MS:
            worst = max(worst, float(np.linalg.norm(moved.position_ned - truth[1].position_ned)))
    assert worst < 0.05


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("since_ms", [FAULT_MS, COUNTED_MS])
def test_a_small_reset_that_is_told_is_gone_along_with(first: bool, since_ms: int) -> None:
    """Too small to be recognised: the count shows it, and what came before the count is all that is wrong."""
    shift = shifted(0.3, -0.2, 0.1)

    def change(ms: int, told: Telemetry) -> Telemetry:
        return shift(ms, told) if ms >= since_ms else told

    flown = Flown(change, counted=(first, COUNTED_MS))
    away = [(ms, np.linalg.norm(p - motion(ms)[1].position_ned)) for ms, p, _ in flown.places]
    assert max(gap for ms, gap in away if not since_ms <= ms <= COUNTED_MS - first) < 0.01
    assert len(flown.news) == 1 and "reset by 0.4 m" in flown.news[0]
    untold = Flown(change)
    assert not untold.news and not untold.follows_the_motion()


def test_a_reset_that_is_recognised_is_not_followed_twice() -> None:
    for first in (True, False):
        flown = Flown(shifted(2.0, 0.0, 0.0), counted=(first, COUNTED_MS))
        assert flown.follows_the_motion() and len(flown.news) == 1


def test_a_reset_of_nothing_that_shows_moves_nothing() -> None:
    flown = Flown(shifted(0.05, 0.0, 0.0), counted=(False, COUNTED_MS))
    assert not flown.news
    assert max(np.linalg.norm(p - motion(ms)[1].position_ned) for ms, p, _ in flown.places) < 0.051


def slower(ms: int, told: Telemetry) -> Telemetry:
    """12 m/s more upwards from one message to the next, and positions that go with it."""
    since = 1e-3 * (ms - FAULT_MS)
    lost = np.array([0.0, 0.0, 12.0])
    return told[0], PositionReport(ms, told[1].position_ned - lost * since, told[1].velocity_ned - lost)


def test_a_velocity_that_leaps_is_believed_at_once_where_a_reset_was_told() -> None:
    told, untold = Flown(slower, counted=(False, COUNTED_MS)), Flown(slower)
    assert 0 < told.told.refused <= 4 < untold.told.refused
    assert told.places[-1][2] == pytest.approx(slower(2992, motion(2992))[1].velocity_ned)


@pytest.mark.parametrize(
    ("far", "turn"), [(0.0, (0.0, 0.0, 0.0)), (500.0, (math.pi, 0.0, 0.0)), (500.0, (0.0, 0.0, 1.0))]
)
def test_what_comes_once_more_for_the_same_moment_brings_no_jump(far: float, turn: tuple[float, float, float]) -> None:
    flown = Flown(until_ms=FAULT_MS)
    attitude, position = motion(FAULT_MS - STEP_MS)
    now = FAULT_MS * MS
    other = multiply(from_euler(*turn), attitude.attitude_ned_frd)
    place = position.position_ned + np.array([0.0, far, 0.0])
    turned = flown.told.attitude(AttitudeReport(attitude.boot_time_ms, other, attitude.rates_frd), now)
    moved = flown.told.position(PositionReport(position.boot_time_ms, place, position.velocity_ned), now)
    assert (turned is None) is (moved is None) is (far > 0.0) and flown.told.refused == (2 if far else 0)
    for ms in range(FAULT_MS, FAULT_MS + 800, STEP_MS):
        attitude, position = motion(ms)
        after = flown.told.position(position, ms * MS)
        assert after is not None and np.allclose(after.position_ned, position.position_ned)
        still = flown.told.attitude(attitude, ms * MS)
        assert still is not None and np.allclose(still.attitude_ned_frd, attitude.attitude_ned_frd)
