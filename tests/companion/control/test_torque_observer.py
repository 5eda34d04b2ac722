"""The torque observer beside a turning vehicle that is integrated here: what turns it beside the commands is found."""

import numpy as np
import pytest

from companion.control import prediction, torque_observer
from companion.control.lqr import attitude_error
from companion.outputs import TurningInput
from protocol.arrays import Array
from protocol.frames import from_rotation_vector, multiply, to_rotation_vector

TICK_NS, DT, STEPS = 4_000_000, 0.004, 8
LAG, LOOP, ATTITUDE_LOOP = 0.03, np.array([20.0, 20.0, 10.0]), 8.0
BANDWIDTH = 2.0
BOUND = np.array([40.0, 60.0, 20.0])
OFFSET = np.array([6.0, -15.0, 1.5])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
MODEL = prediction.Model(LAG, LOOP, ATTITUDE_LOOP, 1.3, np.zeros(3), np.zeros(3))


def asked(turning_input: TurningInput, command: Array, attitude: Array, rates: Array) -> Array:
    """rad/s2, by the vehicle's own loops."""
    if turning_input is TurningInput.ANGULAR_ACCELERATION:
        return command
    if turning_input is TurningInput.ATTITUDE:
        command = ATTITUDE_LOOP * attitude_error(attitude, from_rotation_vector(command))
    return np.asarray(LOOP * (command - rates))


def observed(turning_input: TurningInput, offset: Array, share: float, seconds: float, sway: float) -> Array:
    """Offsets (n, 3) that are estimated of a vehicle with so many hovers of thrust, whose commands sway and make up for
    what is estimated, as the controller's do."""
    observer, commands = np.zeros(1, torque_observer.TORQUE_OBSERVER), np.zeros(prediction.HISTORY, prediction.COMMAND)
    attitude, rates, turning, count, found = LEVEL, np.zeros(3), np.zeros(3), 0, []
    for tick in range(round(seconds / DT)):
        now = (tick + 1) * TICK_NS
        state = prediction.Measured(np.zeros(3), np.zeros(3), attitude, rates)
        if count:
            tuning = share, BANDWIDTH, BOUND
            torque_observer.update(observer[0], now, state, commands, count, MODEL, tuning)
        made_up = observer["offset"][0] * share
        wanted = sway * np.sin(3.0 * tick * DT + np.arange(3.0))
        if turning_input is TurningInput.ATTITUDE:
            turn = from_rotation_vector(-made_up / LOOP / ATTITUDE_LOOP)
            sent = to_rotation_vector(multiply(from_rotation_vector(wanted), turn))
        elif turning_input is TurningInput.RATES:
            wanted = wanted - 4.0 * to_rotation_vector(attitude)
            sent = wanted - made_up / LOOP
        else:
            wanted = wanted - 40.0 * to_rotation_vector(attitude) - 12.0 * rates
            sent = wanted - made_up
        count = prediction.remember(commands, count, now, 13.0, int(turning_input), wanted)
        for _ in range(STEPS):
            step = DT / STEPS
            turning = turning + step / LAG * (asked(turning_input, sent, attitude, rates) - turning)
            rates = rates + step * (turning + share * offset)
            attitude = multiply(attitude, from_rotation_vector(step * rates))
        found.append(observer["offset"][0].copy())
    return np.array(found)


@pytest.mark.parametrize("share", [0.7, 1.0, 1.6])
@pytest.mark.parametrize("turning_input", TurningInput)
def test_what_turns_the_vehicle_beside_the_commands_is_found(turning_input: TurningInput, share: float) -> None:
    """To a tenth and at hover thrust, whatever the thrust is, with the commands moving all the time; about the yaw axis
    nothing is estimated but for torques."""
    found = observed(turning_input, OFFSET, share, 8.0, 0.2)
    axes = 3 if turning_input is TurningInput.ANGULAR_ACCELERATION else 2
    assert found[-1, :axes] == pytest.approx(OFFSET[:axes], rel=0.1, abs=0.25) and not found[:, axes:].any()
    early = found[round(1.5 / BANDWIDTH / DT)]
    assert (np.sign(early) == np.sign(OFFSET))[:axes].all() and np.abs(early / OFFSET).max() < 1.0


@pytest.mark.parametrize("turning_input", TurningInput)
def test_without_one_none_is_found(turning_input: TurningInput) -> None:
    assert np.abs(observed(turning_input, np.zeros(3), 1.0, 4.0, 0.5)).max() < 0.6


def test_what_is_found_is_bounded_and_a_gap_teaches_nothing() -> None:
    observer, commands = np.zeros(1, torque_observer.TORQUE_OBSERVER), np.zeros(prediction.HISTORY, prediction.COMMAND)
    count = prediction.remember(commands, 0, 0, 13.0, int(TurningInput.ANGULAR_ACCELERATION), np.zeros(3))

    def update(now: int, rates: Array) -> Array:
        state = prediction.Measured(np.zeros(3), np.zeros(3), LEVEL, rates)
        torque_observer.update(observer[0], now, state, commands, count, MODEL, (1.0, BANDWIDTH, BOUND))
        offset: Array = observer["offset"][0]
        return offset

    assert not update(TICK_NS * 100, np.full(3, 30.0)).any()
    assert not update(TICK_NS * 200, np.full(3, -30.0)).any()
    for tick in range(201, 1200):
        offset = update(TICK_NS * tick, np.full(3, 500.0))
        assert (np.abs(offset) <= BOUND).all()
    assert offset == pytest.approx(BOUND)
