"""From armed motors into the air: with motors that wait, vehicles that are not as believed, and a landed state that
lies."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from companion.config import Limits
from companion.control.controller import SIZE
from companion.control.lift_off import LiftOff
from companion.mission.plan import Phase
from companion.runtime.files import load_body
from companion.state import VehicleState
from companion.supervision.states import State
from protocol.arrays import Array
from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import GRAVITY
from studies.joined import Joined, mission_of

BODY = load_body("paper_quad")
DT_NS = 4_000_000
LIMITS = Limits()


def never(time: float, thrust: float) -> bool:
    return False


def until_spooled(time: float, thrust: float) -> bool:
    """ArduPilot's, with motors that wait for 2.3 s."""
    return time < 2.3


def always(time: float, thrust: float) -> bool:
    return True


class Vertical:
    """A vehicle that moves up and down and stands on the ground, `weight` times as heavy for its thrust as believed,
    with motors that wait `delay` s. Its velocity is measured with `noise` (m/s), its height as `sinking` m lower than
    it is after two seconds."""

    def __init__(self, weight: float, delay: float, noise: float = 0.01, sinking: float = 0.0) -> None:
        self.weight, self.delay, self.noise, self.sinking = weight, delay, noise, sinking
        self.height, self.speed, self.thrust, self.time = 0.0, 0.0, 0.0, 0.0
        self._rng = np.random.default_rng(1)

    def fly(self, fraction: float) -> None:
        dt = DT_NS * 1e-9
        self.time += dt
        wanted = fraction * BODY.max_thrust_n if self.time >= self.delay else 0.0
        self.thrust += dt / BODY.rotor_time_constant_s * (wanted - self.thrust)
        self.speed += dt * (self.thrust / (BODY.mass_kg * self.weight) - GRAVITY)
        self.height += dt * self.speed
        if self.height <= 0.0:
            self.height, self.speed = 0.0, max(self.speed, 0.0)

    def state(self) -> VehicleState:
        velocity = self._rng.normal(size=3) * self.noise - np.array([0.0, 0.0, self.speed])
        place = np.array([0.0, 0.0, 3.0 - self.height + self.sinking * min(0.5 * self.time, 1.0)])
        return VehicleState(0, place, velocity, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)


def lifted(vehicle: Vertical, spooling: Callable[[float, float], bool], limit_s: float = 25.0) -> float | None:
    """Up to the moment at which it is found in the air: the thrust's scale; None if it is not."""
    lift_off = LiftOff(LIMITS, BODY)
    lift_off.begin()
    for tick in range(round(limit_s * 1e9 / DT_NS)):
        waits = spooling(vehicle.time, lift_off.thrust or 0.0)
        scale = lift_off.update(vehicle.state(), tick * DT_NS, BODY.mass_kg, True, waits)
        if scale is not None:
            assert lift_off.thrust is None
            return scale
        assert lift_off.thrust is not None and 0.0 < lift_off.thrust <= LIMITS.highest_thrust
        vehicle.fly(lift_off.thrust)
    return None


@pytest.mark.parametrize("weight", [0.33, 0.6, 1.0, 1.3, 1.9])
@pytest.mark.parametrize("spooling", [never, until_spooled, always])
def test_it_rises_gently_and_shows_its_weight(weight: float, spooling: Callable[[float, float], bool]) -> None:
    """Without a landed state, with one that tells, and with one that never leaves the ground."""
    vehicle = Vertical(weight, 2.3 if spooling is until_spooled else 0.0)
    scale = lifted(vehicle, spooling)
    assert scale is not None
    assert vehicle.height < 0.2 and vehicle.speed < 0.6
    assert scale == pytest.approx(1.0 / weight, rel=0.35)


@pytest.mark.parametrize("delay", [0.0, 1.0, 2.3, 4.0])
@pytest.mark.parametrize("weight", [0.85, 1.0, 1.15])
def test_motors_that_wait_in_silence_do_not_make_it_leap(weight: float, delay: float) -> None:
    """The thrust creeps while they may be waiting."""
    vehicle = Vertical(weight, delay)
    assert lifted(vehicle, never) == pytest.approx(1.0 / weight, rel=0.35)
    assert vehicle.time >= delay
    assert vehicle.height < 0.2 and vehicle.speed < 0.6


def test_a_height_that_sinks_on_the_ground_does_not_hide_the_climb() -> None:
    """As PX4's, by 0.13 m in the time that the thrust takes to rise."""
    heights = []
    for sinking in (0.0, 0.13):
        vehicle = Vertical(1.0, 0.0, sinking=sinking)
        assert lifted(vehicle, never) is not None
        heights.append(vehicle.height)
    assert heights[1] < heights[0] + 0.04


def test_what_rises_slowly_flies_once_it_is_clear_of_the_ground() -> None:
    """At half of the speed that tells by itself; the ground does not rise with it."""
    lift_off, upright = LiftOff(LIMITS, BODY), np.array([1.0, 0.0, 0.0, 0.0])
    lift_off.begin()
    speed, found_m = 0.1, math.inf
    for tick in range(1000):
        height = speed * tick * DT_NS * 1e-9
        state = VehicleState(0, np.array([0.0, 0.0, -height]), np.array([0.0, 0.0, -speed]), upright, np.zeros(3), 0)
        if lift_off.update(state, tick * DT_NS, BODY.mass_kg, True, False) is not None:
            found_m = height
            break
    assert found_m == pytest.approx(0.15, abs=0.01)


def test_noise_is_no_flight() -> None:
    """A velocity that is noisy on the ground, and a height that drifts, begin nothing."""
    lift_off, rng = LiftOff(LIMITS, BODY), np.random.default_rng(2)
    lift_off.begin()
    for tick in range(1000):
        place = np.array([0.0, 0.0, -0.1 * tick / 1000 + 0.01 * rng.normal()])
        velocity = 0.04 * rng.normal(size=3)
        state = VehicleState(0, place, velocity, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
        assert lift_off.update(state, tick * DT_NS, BODY.mass_kg, True, False) is None


def test_what_can_not_fly_is_let_be() -> None:
    """The highest thrust does not lift it: after some seconds the motors are asked for little."""
    lift_off, vehicle = LiftOff(LIMITS, BODY), Vertical(3.0, 0.0)
    lift_off.begin()
    most = 0.0
    for tick in range(5000):
        assert lift_off.update(vehicle.state(), tick * DT_NS, BODY.mass_kg, True, False) is None
        assert lift_off.thrust is not None
        most = max(most, lift_off.thrust)
        vehicle.fly(lift_off.thrust)
    assert most == LIMITS.highest_thrust and lift_off.thrust == LIMITS.lowest_thrust


def test_a_hold_on_the_ground_begins_again() -> None:
    lift_off, vehicle = LiftOff(LIMITS, BODY), Vertical(1.0, 0.0)
    lift_off.begin()
    thrusts = []
    for tick in range(400):
        lift_off.update(vehicle.state(), tick * DT_NS, BODY.mass_kg, tick < 200 or tick >= 300, False)
        thrusts.append(lift_off.thrust)
    assert thrusts[250] == thrusts[0] and thrusts[399] == pytest.approx(thrusts[99], rel=0.01)


@pytest.mark.parametrize(("wind", "most"), [(4.5, 0.3), (8.0, 0.75)])
def test_the_wind_does_not_carry_it_along_while_it_is_light(wind: float, most: float) -> None:
    """It slides from the moment at which its feet hold it no more, and is in the air soon after."""
    joined = Joined(mission_of("hover"), world_overrides=(f"wind.mean_ned=[0.0, {wind}, 0.0]",))
    joined.fly(limit_s=10.0, until=lambda each: each.vehicle.state[2] < -1.0)
    assert joined.vehicle.state[2] < -1.0
    places = np.array(joined.truths)[:, :2]
    assert np.linalg.norm(places - places[0], axis=1).max() < most


@pytest.mark.parametrize("rising", [0, 200])
@pytest.mark.parametrize(
    ("height", "airborne", "flies"),
    [(0.0, False, False), (0.05, False, False), (0.5, False, True), (-3.0, False, False), (-3.0, True, True)],
)
def test_a_vehicle_given_back_above_where_it_stood_or_in_the_air_flies(
    height: float, airborne: bool, flies: bool, rising: int
) -> None:
    """It was taken over before it had left the ground, wherever that seems to be meanwhile, even at once; down a slope
    its own word alone tells that it flies."""
    lift_off, vehicle = LiftOff(LIMITS, BODY), Vertical(1.0, 0.0)
    lift_off.begin()
    for tick in range(400):
        assert lift_off.update(vehicle.state(), tick * DT_NS, BODY.mass_kg, tick < rising, False) is None
        vehicle.height = height if tick > 200 else 0.0
    lift_off.given_back(vehicle.state(), airborne=airborne)
    assert (lift_off.thrust is None) == flies


@pytest.mark.parametrize("down_a_slope", [False, True])
def test_who_took_over_on_the_ground_gives_a_flying_vehicle_back(down_a_slope: bool) -> None:
    """One that says nothing of a landing: it is not asked for the little thrust that a lift-off begins with. Nor is one
    that is lower than where it stood, and says that it flies."""
    joined = Joined(mission_of("hover"), overrides=('avoidance.method="none"',))
    del joined.autopilot.link._handlers[245]
    joined.fly(limit_s=30.0, until=lambda joined: joined.autopilot.supervisor.state is State.FLY).fly(limit_s=0.3)
    assert joined.autopilot.controller.setpoint(np.zeros(SIZE)).thrust > 0.0 and not joined.autopilot.own.airborne
    for mode, seconds in (((4.0, 2.0), 8.0), ((6.0, 0.0), 0.0)):  # it takes off by itself, and is given back
        fields = (1, 1, dialect.MAV_CMD_DO_SET_MODE, 0, 1.0, *mode, 0.0, 0.0, 0.0, 0.0)
        joined.vehicle.receive(Encoder(1, 190).encode_fields(dialect.MAVLink_command_long_message, *fields))
        joined.fly(limit_s=seconds)
        if down_a_slope:  # as if it had stood 50 m higher
            joined.autopilot.controller._lift_off._stood_down = -50.0
            joined.autopilot.link.said._airborne = True
    height = -joined.vehicle.motion.position_ned[2]
    assert height > 2.0 and joined.trace()["state"][-1] == State.RELINQUISHED
    joined.fly(limit_s=1.0)
    assert joined.trace()["state"][-1] == State.HOLD
    assert -joined.vehicle.motion.position_ned[2] > height - 0.2
    joined.fly(limit_s=30.0)
    assert joined.autopilot.supervisor.fault is None and joined.vehicle.summary().outcome == "landed"


def test_a_vehicle_that_flies_already_is_not_touched() -> None:
    """Nothing was armed by the companion: control was given back, or taken over in flight."""
    lift_off = LiftOff(LIMITS, BODY)
    assert lift_off.thrust is None


def taken_off(delay: float, *vehicle: str, silent: bool = False, sticks: float = 0.0) -> tuple[Array, Joined]:
    """The distance from the reference (m) at each step from arming to the end of the climb. A vehicle that `sticks`
    stays where it is until its speed would be so much (m/s)."""
    armed: list[int] = []
    loose = False

    def waiting(time_ns: int, data: bytes) -> bytes:
        nonlocal loose
        if joined.autopilot.supervisor.state is State.FLY:
            armed.append(time_ns)
        if not armed or time_ns - armed[0] < delay * 1e9:
            joined.vehicle.flight.command[:] = 0.0
        state = joined.vehicle.state
        loose = loose or -state[5] >= sticks
        if not loose:
            state[2] = max(state[2], unloaded_down)
        return data

    joined = Joined(
        mission_of("hover"), overrides=('avoidance.method="none"',), vehicle_overrides=vehicle, meddle=waiting
    )
    unloaded_down = joined.vehicle.state[2] - 0.003
    if silent:
        del joined.autopilot.link._handlers[245]
    joined.fly(limit_s=30.0, until=lambda joined: joined.autopilot.navigator.phase is Phase.ROUTE)
    trace = joined.trace()
    trace = trace[trace["state"] == State.FLY]
    error: Array = np.linalg.norm(trace["position_ned"] - trace["reference_position_ned"], axis=1)
    return error, joined


@pytest.mark.parametrize(("delay", "silent"), [(0.0, True), (2.3, False), (4.0, False)])
def test_the_reference_leaves_with_the_vehicle(delay: float, silent: bool) -> None:
    """However long the motors wait, and whatever the landed state says or does not say."""
    error, joined = taken_off(delay, silent=silent)
    assert joined.autopilot.navigator.phase is Phase.ROUTE
    assert error.max() < 0.03
    assert -joined.trace()["velocity_ned"][:, 2].min() < 1.7


@pytest.mark.parametrize("believed", [0.5, 1.5])
def test_a_wrong_hover_thrust_does_not_matter(believed: float) -> None:
    """The vehicle's rotors give less or more than the companion believes."""
    error, joined = taken_off(0.0, f"body.rotor_max_thrust_n={8.0 / believed}")
    assert joined.autopilot.navigator.phase is Phase.ROUTE
    assert error.max() < 0.15


def test_a_vehicle_that_breaks_loose_takes_the_reference_along() -> None:
    """As ArduPilot's simulation, which holds it to the ground up to 1.2 m/s."""
    error, joined = taken_off(0.0, sticks=1.2)
    assert joined.autopilot.navigator.phase is Phase.ROUTE
    assert error.max() < 0.05
