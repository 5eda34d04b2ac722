"""The controller on a vehicle of its own: estimates find what they should, the prediction is the motion, laws
converge."""

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from companion.control import disturbance_observer, prediction
from companion.control.controller import MEMORY, RATES, SIZE, THRUST, TORQUE, Controller
from companion.control.jumps import fade_jumps
from companion.control.laws import LAWS
from companion.control.lqr import attitude_error
from companion.outputs import TurningInput
from companion.reports import LinkDelay, Motors
from companion.runtime.files import load_body, load_settings
from companion.state import Output, Reference, VehicleState
from protocol.arrays import Array
from protocol.frames import from_euler, from_rotation_vector, multiply, rotate, to_body, to_rotation_vector
from protocol.vehicle_parameters import GRAVITY

BODY = load_body("paper_quad")
TICK_NS = 4_000_000
START_NS = 1_000_000_000
DOWN = np.array([0.0, 0.0, 1.0])


class Body:
    """A rigid body with rotors' lag and the vehicle's rate loop, by small steps of plain Euler: written down here once
    more, in numpy, as the oracle of the prediction."""

    def __init__(self, mass: float, drag: Array, disturbance: Array) -> None:
        self.mass, self.drag, self.disturbance = mass, drag, disturbance
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.attitude = np.array([1.0, 0.0, 0.0, 0.0])
        self.rates, self.turning = np.zeros(3), np.zeros(3)
        self.thrust = mass * GRAVITY

    def fly(self, seconds: float, thrust: float, asked: Array, step: float = 1e-4) -> None:
        """Under rates (3,) or an attitude (4,)."""
        lag, loop, rates = BODY.rotor_time_constant_s, np.array(BODY.rate_loop_gain_1_s), asked
        for _ in range(round(seconds / step)):
            if len(asked) == 4:
                rates = BODY.attitude_loop_gain_1_s * attitude_error(self.attitude, asked)
            self.thrust += step / lag * (thrust - self.thrust)
            self.turning = self.turning + step / lag * (loop * (rates - self.rates) - self.turning)
            self.rates = self.rates + step * self.turning
            force = rotate(self.attitude, -self.thrust * DOWN)
            force = force - rotate(self.attitude, self.drag * np.array(to_body(self.attitude, self.velocity)))
            self.velocity = self.velocity + step * (force / self.mass + GRAVITY * DOWN + self.disturbance)
            self.position = self.position + step * self.velocity
            self.attitude = multiply(self.attitude, from_rotation_vector(step * self.rates))

    def state(self, time_ns: int) -> VehicleState:
        return VehicleState(time_ns, self.position, self.velocity, self.attitude, self.rates, 0)


def circle(time: float, speed: float = 4.0, radius: float = 3.0) -> Reference:
    rate = speed / radius
    phase = np.array([math.pi / 2, 0.0, 0.0])
    size = np.array([radius, radius, 0.0])
    motion = [size * rate**n * np.sin(rate * time + phase + n * math.pi / 2) for n in range(5)]
    return Reference(np.array([*motion, np.zeros(3)]))


def tracked(
    vehicle: Body, *overrides: str, seconds: float = 12.0, late_ticks: int = 0, output: Output = Output.RATES
) -> tuple[Array, Array]:
    """Errors (n, 3) on the circle, and the last CONTROL_FIELDS. The vehicle follows rates; its pose comes `late_ticks`
    late."""
    settings = load_settings(None, ["limits.tilt_deg=70.0", *overrides])
    controller = Controller(settings, BODY, output)
    vehicle.position, vehicle.velocity = circle(0.0).position_ned, circle(0.0).velocity_ned
    errors, out = [], np.zeros(SIZE)
    poses = [vehicle.state(START_NS)] * (late_ticks + 1)
    for tick in range(round(seconds * 250)):
        now = START_NS + tick * TICK_NS
        poses = [*poses[1:], vehicle.state(now)]
        reference, ahead = (circle((at - START_NS) * 1e-9) for at in controller.reference_times(now))
        wanted = controller.acceleration_command(poses[0], now, poses[0].time_ns, reference, BODY.mass_kg, True)
        out, _ = controller.attitude_command(wanted, now, ahead, BODY.mass_kg)
        vehicle.fly(0.004, out[THRUST] * BODY.max_thrust_n, out[RATES], step=1e-3)
        errors.append(vehicle.position - circle((tick + 1) * 0.004).position_ned)
    return np.array(errors), out


def pose(state: VehicleState) -> prediction.Measured:
    return prediction.Measured(state.position_ned, state.velocity_ned, state.attitude_ned_frd, state.rates_frd)


def nominal() -> Body:
    return Body(BODY.mass_kg, np.array(BODY.drag_kg_s), np.zeros(3))


@pytest.mark.parametrize("age_ms", [0, 12, 40])
def test_prediction_is_the_motion(age_ms: int) -> None:
    """From an old measurement to now and on, through commands that change at every tick: as the body really moved."""
    rng = np.random.default_rng(1)
    vehicle = Body(1.4, np.array([0.4, 0.5, 0.7]), np.array([0.5, -0.3, 0.2]))
    commands, count = np.zeros(prediction.HISTORY, prediction.COMMAND), 0
    measured, then, ticks = vehicle.state(0), 0.0, 200
    for tick in range(ticks):
        if (ticks - tick) * 4 == age_ms + 4:
            measured = vehicle.state(START_NS + tick * TICK_NS)
            then = vehicle.thrust
        thrust = 14.0 + 3.0 * math.sin(0.3 * tick)
        rates = np.array([math.sin(0.05 * tick), math.cos(0.07 * tick), 0.3]) + 0.1 * rng.normal(size=3)
        count = prediction.remember(commands, count, START_NS + tick * TICK_NS, thrust, int(TurningInput.RATES), rates)
        vehicle.fly(0.004, thrust, rates)
    last = START_NS + ticks * TICK_NS
    model = prediction.Model(
        BODY.rotor_time_constant_s, np.array(BODY.rate_loop_gain_1_s), 0.0,
        vehicle.mass, vehicle.drag, vehicle.disturbance,
    )  # fmt: skip
    found = prediction.predict(pose(measured), measured.time_ns, last, commands, count, model)
    assert found.position == pytest.approx(vehicle.position, abs=1e-4)
    assert found.velocity == pytest.approx(vehicle.velocity, abs=5e-3)
    assert found.attitude == pytest.approx(vehicle.attitude, abs=3e-3)
    assert found.rates == pytest.approx(vehicle.rates, abs=0.03)
    assert found.angular_acceleration == pytest.approx(vehicle.turning, abs=1.0)
    assert found.thrust == pytest.approx(vehicle.thrust, abs=0.05)
    assert found.measured_thrust == pytest.approx(then, abs=0.05)


def predicted(
    vehicle: Body, age_ms: int, command: Callable[[int], tuple[float, TurningInput, Array]]
) -> tuple[VehicleState, prediction.Predicted]:
    """The state `age_ms` before the end of 200 ticks under commands, by tick: thrust (N), and what is asked for, rates
    or an attitude. And what is predicted from it."""
    commands, count, measured, ticks = np.zeros(prediction.HISTORY, prediction.COMMAND), 0, vehicle.state(0), 200
    for tick in range(ticks):
        now = START_NS + tick * TICK_NS
        if (ticks - tick) * 4 == age_ms:
            measured = vehicle.state(now)
        thrust, kind, asked = command(tick)
        sent = asked if kind is TurningInput.RATES else to_rotation_vector(asked)
        count = prediction.remember(commands, count, now, thrust, int(kind), sent)
        vehicle.fly(0.004, thrust, asked)
    model = prediction.Model(
        BODY.rotor_time_constant_s, np.array(BODY.rate_loop_gain_1_s),
        BODY.attitude_loop_gain_1_s, vehicle.mass, vehicle.drag, vehicle.disturbance,
    )  # fmt: skip
    end_ns = START_NS + ticks * TICK_NS
    return measured, prediction.predict(pose(measured), measured.time_ns, end_ns, commands, count, model)


def dragging() -> Body:
    return Body(1.4, np.array([0.4, 0.5, 0.7]), np.array([0.5, -0.3, 0.2]))


@pytest.mark.parametrize("age_ms", [12, 40, 400])
def test_prediction_is_the_motion_under_attitudes(age_ms: int) -> None:
    """However fast the vehicle turns at the measurement: it turns no farther than to what it was asked for."""
    vehicle = dragging()

    def command(tick: int) -> tuple[float, TurningInput, Array]:
        asked = from_rotation_vector(np.array([0.3 * math.sin(0.04 * tick), 0.3 * math.cos(0.05 * tick), 0.2]))
        return 14.0 + 3.0 * math.sin(0.03 * tick), TurningInput.ATTITUDE, asked

    measured, found = predicted(vehicle, age_ms, command)
    assert np.abs(measured.rates_frd[:2]).max() > 0.3
    assert found.position == pytest.approx(vehicle.position, abs=0.01)
    assert found.velocity == pytest.approx(vehicle.velocity, abs=0.05)
    assert found.attitude == pytest.approx(vehicle.attitude, abs=0.01)
    assert found.rates == pytest.approx(vehicle.rates, abs=0.3) and np.abs(vehicle.rates).max() > 2.0
    assert found.thrust == pytest.approx(vehicle.thrust, abs=0.05)


@pytest.mark.parametrize("age_ms", [100, 400])
def test_prediction_is_the_motion_through_a_change_of_the_output(age_ms: int) -> None:
    """Rates, from 200 ms before the end on attitudes: each command turns the vehicle as it was meant to."""
    vehicle, level = dragging(), from_rotation_vector(np.array([0.3, -0.2, 0.4]))

    def command(tick: int) -> tuple[float, TurningInput, Array]:
        rates = np.array([0.5 * math.sin(0.05 * tick), 0.5 * math.cos(0.07 * tick), 0.3])
        return (14.0, TurningInput.RATES, rates) if tick < 150 else (14.0, TurningInput.ATTITUDE, level)

    _, found = predicted(vehicle, age_ms, command)
    assert found.position == pytest.approx(vehicle.position, abs=0.01)
    assert found.attitude == pytest.approx(vehicle.attitude, abs=0.02)
    assert found.rates == pytest.approx(vehicle.rates, abs=0.3)


@pytest.mark.parametrize("age_ms", [4, 40, 100, 148])
def test_a_late_position_catches_up(age_ms: int) -> None:
    """Position and velocity from before the attitude, with the attitudes since: as the body really moved."""
    vehicle = Body(1.4, np.array([0.4, 0.5, 0.7]), np.array([0.5, -0.3, 0.2]))
    poses, count, ticks, old = np.zeros(prediction.HISTORY, prediction.POSE), 0, 200, vehicle.state(0)
    for tick in range(ticks):
        now = START_NS + tick * TICK_NS
        if (ticks - tick) * 4 == age_ms:
            old = vehicle.state(now)
        count = prediction.keep_pose(poses, count, now, vehicle.attitude, vehicle.thrust)
        vehicle.fly(0.004, 14.0 + 3.0 * math.sin(0.3 * tick), np.array([math.sin(0.05 * tick), 1.0, 0.3]))
    now, seconds = START_NS + ticks * TICK_NS, age_ms * 1e-3
    model = prediction.Model(
        BODY.rotor_time_constant_s, np.zeros(3), 0.0,
        vehicle.mass, vehicle.drag, vehicle.disturbance,
    )  # fmt: skip
    carried = prediction.Measured(
        old.position_ned + seconds * old.velocity_ned, old.velocity_ned, vehicle.attitude, vehicle.rates
    )
    found = prediction.caught_up(carried, now, old.time_ns, poses, count, model)
    assert found.position == pytest.approx(vehicle.position, abs=2e-3)
    assert found.velocity == pytest.approx(vehicle.velocity, abs=3e-2)
    if age_ms >= 100:  # which is not what it was
        assert np.abs(carried.velocity - vehicle.velocity).max() > 0.2


def test_nothing_to_predict_is_the_measurement() -> None:
    commands = np.zeros(prediction.HISTORY, prediction.COMMAND)
    prediction.remember(commands, 0, START_NS, 13.0, int(TurningInput.ATTITUDE), np.zeros(3))
    state = prediction.Measured(np.arange(3.0), np.ones(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    model = prediction.Model(0.03, np.zeros(3), 8.0, 1.3, np.zeros(3), np.zeros(3))
    found = prediction.predict(state, START_NS + TICK_NS, START_NS + TICK_NS, commands, 1, model)
    for given, back in zip(state, found[:4], strict=True):
        assert np.array_equal(given, np.array(back))


@pytest.mark.parametrize("heading", [2.0, -1.0])
def test_what_is_left_behind_is_level_on_the_heading_and_hovers(heading: float) -> None:
    controller = Controller(load_settings(None, []), BODY, Output.ATTITUDE)
    controller._memory["attitude"] = from_euler(0.3, -0.2, heading)
    controller._memory["observer"]["mean"][0, disturbance_observer.THRUST_SCALE] = 0.8
    level = controller.level(1.2 * BODY.mass_kg)
    assert level.attitude_ned_frd == pytest.approx(from_euler(0.0, 0.0, heading).tolist())
    assert level.thrust == pytest.approx(1.2 * BODY.mass_kg * GRAVITY / (0.8 * BODY.max_thrust_n))


def test_over_a_late_link_the_present_moves_on_from_the_last_step() -> None:
    controller = Controller(load_settings(None, []), BODY, Output.RATES)
    place, velocity, late_ns = np.array([1.0, 2.0, -3.0]), np.array([2.0, -1.0, 0.5]), 5 * TICK_NS
    state = VehicleState(START_NS, place, velocity, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    controller.acceleration_command(state, START_NS, START_NS, Reference(np.zeros((6, 3))), BODY.mass_kg, False)
    assert controller.present(state, START_NS + late_ns) is state
    controller.follow(LinkDelay(age=0.04, command=0.04))
    found = controller.present(state, START_NS + late_ns)
    assert found.position_ned == pytest.approx(place + 1e-9 * late_ns * velocity)
    assert found.velocity_ned == pytest.approx(velocity) and found.attitude_ned_frd is state.attitude_ned_frd
    assert controller.present(state, START_NS + 1_000_000_000) is state  # nothing was flown just now


def test_each_estimate_finds_its_own() -> None:
    """In motion the filter tells the thrust's scale, the drag's scale and a steady disturbance apart."""
    push = np.array([0.8, -0.5, 0.0])
    vehicle = Body(BODY.mass_kg / 0.8, np.array(BODY.drag_kg_s) / 0.8 * 1.4, push)
    _, out = tracked(vehicle, "control.position.adaptation=[0.0, 0.0, 0.0]", seconds=40.0)
    assert out[32] == pytest.approx(0.8, abs=0.02)
    assert out[33] == pytest.approx(1.4 * 1.0, abs=0.15)
    assert out[29:32] == pytest.approx(push, abs=0.15)


def test_what_is_not_estimated_stays_nominal() -> None:
    vehicle = Body(BODY.mass_kg * 1.2, np.array(BODY.drag_kg_s), np.zeros(3))
    off = [f"control.estimation.{part}=false" for part in ("disturbance", "thrust_scale", "drag_scale")]
    _, out = tracked(vehicle, *off, "control.position.adaptation=[0.0, 0.0, 0.0]", seconds=4.0)
    assert out[32] == 1.0 and out[33] == 1.0 and not out[29:32].any()


def test_estimates_keep_within_their_bounds() -> None:
    """For velocities of any size."""
    rng = np.random.default_rng(2)
    observer = np.zeros(1, disturbance_observer.OBSERVER)
    disturbance_observer.reset(observer[0], np.full(8, 1.0))
    for tick in range(2000):
        effect = rng.normal(size=3) * 10.0
        velocity = rng.normal(size=3) * 100.0
        noise = disturbance_observer.Noise(0.02, np.ones(8), 2.0, np.zeros(3), 0.0, 0.1)
        disturbance_observer.update(observer[0], START_NS + tick * TICK_NS, velocity, effect, rng.normal(size=3), noise)
        mean = observer["mean"][0]
        assert np.isfinite(mean).all()
        assert (
            disturbance_observer.THRUST_SCALE_BOUNDS[0]
            <= mean[disturbance_observer.THRUST_SCALE]
            <= disturbance_observer.THRUST_SCALE_BOUNDS[1]
        )
        assert (
            disturbance_observer.DRAG_SCALE_BOUNDS[0]
            <= mean[disturbance_observer.DRAG_SCALE]
            <= disturbance_observer.DRAG_SCALE_BOUNDS[1]
        )
        assert np.linalg.norm(mean[disturbance_observer.DISTURBANCE]) <= disturbance_observer.DISTURBANCE_BOUND + 1e-9


@pytest.mark.parametrize("told", [np.zeros(3), np.array([0.01, 0.09, 4.0])])
def test_the_observer_is_the_textbooks_kalman_filter(told: Array) -> None:
    """Against the matrix form of the partial update (K. Brink 2017), with numpy; noise as it is expected, or as a sum
    of errors that last for 30 ms has it."""
    rng = np.random.default_rng(3)
    observer = np.zeros(1, disturbance_observer.OBSERVER)
    spread, walk, least, fading = np.full(8, 0.3), rng.uniform(0.01, 0.1, 8), 0.02, 2.0
    noise = disturbance_observer.Noise(least, walk, fading, told, 0.03, 0.05)
    disturbance_observer.reset(observer[0], spread)
    mean, variance, seen = observer["mean"][0].copy(), np.diag(spread**2), np.zeros(3)
    lasting = sum(math.exp(-0.004 * abs(lag) / 0.03) for lag in range(-500, 501))
    thrust, drag, climb = np.array([0.2, 0.1, -9.7]), np.array([-0.1, 0.05, 0.0]), 0.0
    disturbance_observer.update(observer[0], START_NS, np.zeros(3), thrust, drag, noise)
    for tick in range(1, 60):
        thrust_next, drag_next = thrust + rng.normal(size=3) * 0.1, drag + rng.normal(size=3) * 0.05
        velocity = rng.normal(size=3) * np.array([0.5, 0.5, 0.1])
        velocity[2] += 0.5 * (20 <= tick < 40)  # it descends
        disturbance_observer.update(observer[0], START_NS + tick * TICK_NS, velocity, thrust_next, drag_next, noise)
        share = np.linalg.norm(velocity) ** 4 / (1.0 + np.linalg.norm(velocity) ** 4)
        counts = np.diag([*np.ones(7), share])
        if abs(velocity[2] - climb) > 0.4:
            slower = abs(velocity[2]) < abs(climb)
            variance[6, 6] += slower * (0.05 * (velocity[2] - climb) * mean[6]) ** 2
            climb = velocity[2]
        step = np.eye(8)
        step[:3, 3:6] = 0.004 * np.eye(3)
        step[:3, 6] = 0.002 * (thrust + thrust_next)
        step[:3, 7] = 0.002 * (drag + drag_next)
        step[5, 5] = 1.0 - 0.004 * fading
        thrust, drag = thrust_next, drag_next
        mean = step @ mean
        mean[2] += 0.004 * GRAVITY
        variance = step @ variance @ step.T + 0.004 * counts @ np.diag(walk**2)
        for axis in range(3):
            row, innovation = np.eye(8)[axis], velocity[axis] - mean[axis]
            seen[axis] += 0.002 * (min(innovation**2 - variance[axis, axis], 0.0625) - seen[axis])
            spread_here = max(least**2, seen[axis], min(told[axis], 0.0625) * lasting)
            gain = counts @ variance @ row / (row @ variance @ row + spread_here)
            left = np.eye(8) - np.outer(gain, row)
            mean = mean + gain * innovation
            variance = left @ variance @ left.T + spread_here * np.outer(gain, gain)
        assert observer["mean"][0] == pytest.approx(mean, abs=1e-9)
        assert observer["covariance"][0] == pytest.approx(variance, abs=1e-9)
    assert (seen[:2] > least**2).all()


@pytest.mark.parametrize("fading", [20.0, 200.0, 1000.0])
def test_a_vertical_disturbance_that_fades_at_once_is_none(fading: float) -> None:
    """Within a step it falls back to zero, and not beyond it."""
    rng, observer = np.random.default_rng(3), np.zeros(1, disturbance_observer.OBSERVER)
    walk = np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 0.005, 0.1])
    noise = disturbance_observer.Noise(0.02, walk, fading, np.zeros(3), 0.2, 0.1)
    disturbance_observer.reset(observer[0], np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.3, 0.3]))
    for tick in range(300):
        velocity, time_ns = 0.02 * rng.normal(size=3), START_NS + tick * 20_000_000
        hover = np.array([0.0, 0.0, -GRAVITY])
        disturbance_observer.update(observer[0], time_ns, velocity, hover, np.zeros(3), noise)
    assert abs(observer["mean"][0, 5]) < 0.1


@pytest.mark.parametrize("law", LAWS)
def test_every_law_flies_the_circle(law: str) -> None:
    errors, _ = tracked(nominal(), f"control.position.law={law}")
    bound = 1.0 if law == "pid" else 0.02  # which knows nothing of the acceleration to come
    assert np.linalg.norm(errors[1000:], axis=1).max() < bound


def test_a_late_pose_costs_nothing_that_is_predicted() -> None:
    late, _ = tracked(nominal(), late_ticks=7)
    without, _ = tracked(nominal(), "control.prediction.enabled=false", late_ticks=7)
    assert np.linalg.norm(late[500:], axis=1).max() < 0.02
    assert np.linalg.norm(without[500:], axis=1).max() > 0.05


def test_adaptation_takes_a_steady_push_away() -> None:
    """Without the observer the integral alone removes the error; without the integral the error stays."""
    off = [f"control.estimation.{part}=false" for part in ("disturbance", "thrust_scale", "drag_scale")]
    push = np.array([1.5, 0.0, 0.0])

    def last_error(gamma: float) -> float:
        vehicle = Body(BODY.mass_kg, np.array(BODY.drag_kg_s), push)
        errors, _ = tracked(vehicle, *off, f"control.position.adaptation=[{gamma}, {gamma}, {gamma}]", seconds=20.0)
        return float(np.linalg.norm(errors[-500:].mean(axis=0)))

    assert last_error(0.0) == pytest.approx(1.5 / 7.25, rel=0.1)  # d / (1 + c1 c2)
    assert last_error(2.0) < 0.01


def test_jumps_of_the_reference_are_let_through_gently() -> None:
    """The jerk jumps. The commanded rates do not, and arrive after some tenths of a second."""
    controller = Controller(load_settings(None, []), BODY, Output.RATES)
    state = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)

    def rates(tick: int, jerk: float) -> Array:
        now = START_NS + tick * TICK_NS
        reference = Reference(np.zeros((6, 3)))
        reference.rows[3, 0] = jerk
        wanted = controller.acceleration_command(state, now, now, reference, BODY.mass_kg, False)
        out, _ = controller.attitude_command(wanted, now, reference, BODY.mass_kg)
        return out[RATES]

    for tick in range(10):
        rates(tick, 0.0)
    course = [rates(10 + tick, 10.0)[1] for tick in range(200)]
    assert abs(course[-1]) == pytest.approx(10.0 / GRAVITY, rel=0.1)
    steps = np.diff([0.0, *course])
    assert np.abs(steps).max() < 0.1 * abs(course[-1])
    assert np.abs(np.diff(steps)).max() < 0.05 * abs(course[-1])


def test_rates_that_their_own_derivative_explains_pass_untouched() -> None:
    """Only jumps are faded; the error of the trapezium rule is a thousandth of one."""
    memory = np.zeros(1, MEMORY)
    dt, rate = 0.004, 2.0 * math.pi
    for tick in range(500):
        phase = rate * tick * dt + np.array([0.0, 1.0, 2.0])
        fade_jumps(tuple(np.sin(phase)), tuple(rate * np.cos(phase)), dt if tick else 0.0, memory[0])
        assert np.abs(memory["rate_jump"]).max() < 1e-3 and np.abs(memory["rate_jump_change"]).max() < 2e-2
    memory["reference_rates"] += 0.5
    fade_jumps(tuple(np.sin(phase)), tuple(rate * np.cos(phase)), dt, memory[0])
    assert np.abs(memory["rate_jump"]).max() > 0.4


@pytest.mark.parametrize("climb", [2.0, -2.0])
def test_thrust_that_takes_time_is_asked_for_ahead(climb: float) -> None:
    """The thrust grows by what the reference will need more of it a rotor's lag later."""
    state = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    thrusts = []
    for soon in (0.0, climb):
        controller = Controller(load_settings(None, []), BODY, Output.RATES)
        reference, ahead = Reference(np.zeros((6, 3))), Reference(np.zeros((6, 3)))
        ahead.rows[2, 2] = -soon
        wanted = controller.acceleration_command(state, START_NS, START_NS, reference, BODY.mass_kg, False)
        out, _ = controller.attitude_command(wanted, START_NS, ahead, BODY.mass_kg)
        thrusts.append(float(out[THRUST]) * BODY.max_thrust_n)
    assert thrusts[1] - thrusts[0] == pytest.approx(BODY.mass_kg * climb, rel=1e-6)


def turned(controller: Controller, now: int, rates: Array, yaw_rate: float = 0.0) -> Array:
    """CONTROL_FIELDS of a vehicle that hovers level and turns, with a reference that heads north and is to turn."""
    state = VehicleState(now, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), rates, 0)
    reference = Reference(np.zeros((6, 3)))
    reference.rows[5, 1] = yaw_rate
    wanted = controller.acceleration_command(state, now, now, reference, BODY.mass_kg, False)
    return controller.attitude_command(wanted, now, reference, BODY.mass_kg)[0]


def test_torque_makes_up_for_the_gyroscopic_one() -> None:
    """All else of it is odd in the rates; it is remembered as the acceleration that Euler's equation makes of it."""
    inertia, full, rates = np.array(BODY.inertia_kgm2), np.array(BODY.full_torque_nm), np.array([0.3, -0.2, 0.1])
    torques = []
    for sign in (1.0, -1.0):
        controller = Controller(load_settings(None, []), BODY, Output.ACTUATORS)
        torque = full * turned(controller, START_NS, sign * rates)[TORQUE]
        assert (np.abs(torque) < full).all()
        spin = np.cross(rates, inertia * rates)
        assert controller._memory["commands"]["input"][0, 0] == pytest.approx((torque - spin) / inertia)
        torques.append(torque)
    assert sum(torques) == pytest.approx(2.0 * spin, abs=1e-12)


@pytest.mark.parametrize("design", ["continuous", "sampled"])
def test_torque_turns_the_vehicle_as_the_rates_change_that_are_asked_for(design: str) -> None:
    """A jump of the yaw rate is let through gently, and the torque beyond what the errors ask for is what that takes;
    that there is no angular acceleration yet is an error, too, for one of the designs."""
    body = msgspec.structs.replace(BODY, rate_loop_gain_1_s=(0.0, 0.0, 0.0))
    settings = load_settings(None, [f"control.attitude.design={design}"])
    full, turn = body.full_torque_nm[2], np.array([0.0, 0.0, 0.1])
    damping = -full * turned(Controller(settings, body, Output.ACTUATORS), START_NS, turn)[TORQUE][2] / turn[2]
    controller = Controller(settings, body, Output.ACTUATORS)
    course = []
    for tick in range(100):
        out = turned(controller, START_NS + tick * TICK_NS, np.zeros(3), 0.0 if tick < 3 else 0.2)
        course.append((out[RATES][2], full * out[TORQUE][2]))
    rates, torques = np.array(course).T
    lacking = controller._parameters["torque_gain"][0, 2, 2]
    assert (lacking > 0.0) == (design == "sampled")
    accelerations = (torques - damping * rates) / (body.inertia_kgm2[2] + lacking)
    assert np.abs(torques).max() < full and accelerations.max() > 1.0
    assert np.diff(rates) / 0.004 == pytest.approx(0.5 * (accelerations[1:] + accelerations[:-1]), abs=0.05)


def test_the_tilt_is_kept_below_its_limit_above_loops_that_are_the_vehicles_own() -> None:
    """Whose they are is known when the vehicle is."""
    settings = load_settings(None, [])
    controller = Controller(settings, BODY, Output.ATTITUDE)
    limits = []
    for motors in (Motors(), Motors(own_loops=True), Motors(own_loops=True, spooling=True)):
        controller.flies(nominal().state(START_NS), START_NS, BODY.mass_kg, False, motors)
        limits.append(float(controller._parameters["max_tilt"][0]) / settings.limits.tilt)
    assert limits == pytest.approx([1.0, 0.92, 0.92])


YAW_LOOPS = (2.4, 0.5, 0.1), (2.3, 1.1, 0.05), (4.2, 7.4, 0.08), (1.9, 2.7, 0.05)
"""Gain (1/s), integral gain (1/s2) and lag (s) of rate loops as they fit flights: PX4's two, ArduCopter's two."""


@pytest.mark.parametrize("vehicle", ["px4_sih", "x500", "iris", "paper_quad"])
@pytest.mark.parametrize(("gain", "integral", "lag"), YAW_LOOPS)
def test_the_heading_is_damped_above_a_flight_controllers_own_loop(
    vehicle: str, gain: float, integral: float, lag: float
) -> None:
    """By the poles of angle, rate, angular acceleration and the integral of the rate's error; with another vehicle's
    file, whose loops are fast, once the firmware is known."""
    controller = Controller(load_settings(None, []), load_body(vehicle), Output.RATES)
    if vehicle == "paper_quad":
        controller.flies(nominal().state(START_NS), START_NS, BODY.mass_kg, False, Motors(own_loops=True))
    turn = controller._parameters["rates_gain"][0, 2, 0]
    loop = [[0, 1, 0, 0], [0, 0, 1, 0], [-gain * turn / lag, -gain / lag, -1 / lag, integral / lag], [-turn, -1, 0, 0]]
    poles = np.linalg.eigvals(np.array(loop))
    assert poles.real.max() < -0.15
    assert (-poles.real / np.abs(poles)).min() > 0.3
