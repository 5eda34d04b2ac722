"""The trace: its records hold what a control step had, and nothing that happened at one step is lost in the log."""

import math

import numpy as np
import pytest

from companion.avoidance.guard import Verdict
from companion.control.controller import SIZE
from companion.mission.plan import Phase
from companion.records import CONTROL_FIELDS, LOGGED, TRACE
from companion.state import AvoidanceDecision, Reason, Reference, VehicleState
from companion.supervision.states import State
from companion.trace import ControlStep, Thinning, pack

STEP_NS = 4_000_000
STEPS = 1000


def steps(seed: int) -> "np.ndarray[tuple[int], np.dtype[np.void]]":
    """Traces with everything at random; state, phase and step change at times of their own."""
    generator = np.random.default_rng(seed)
    table = np.zeros(STEPS, TRACE.dtype)
    for name in TRACE.dtype.names or ():
        if table[name].dtype.kind == "f":
            table[name] = generator.normal(size=table[name].shape)
    for name in ("position_age", "guard_change"):
        table[name] = np.abs(table[name])
    for name in ("blocked", "limited"):
        table[name] = generator.random(STEPS) < 0.03
    table["guard_reason"] = generator.integers(0, 5, STEPS) * (generator.random(STEPS) < 0.05)
    table["clearance"][generator.random(STEPS) < 0.5] = np.inf
    table["state"] = 5 + (np.arange(STEPS) > 703)
    table["phase"] = np.arange(STEPS) // 331
    table["step"] = np.arange(STEPS) // 97
    return table


@pytest.mark.parametrize("guarded", [False, True])
def test_a_record_holds_the_step(guarded: bool) -> None:
    rng = np.random.default_rng(1)
    position, velocity, rates = rng.normal(size=(3, 3))
    vehicle = VehicleState(0, position, velocity, rng.normal(size=4), rates, 7_000_000)
    reference, control = Reference(rng.normal(size=(6, 3))), rng.normal(size=SIZE)
    decision = AvoidanceDecision(rng.normal(size=3), 3.5, math.inf, True)
    verdict = Verdict(acceleration_ned=rng.normal(size=3), changed=1.5, reason=Reason.STOP) if guarded else None
    step = ControlStep(State.FLY, Phase.ROUTE, 3, vehicle, reference, control, True, decision, 12.5, verdict)
    (record,) = np.frombuffer(pack(step), TRACE.dtype)
    assert (record["state"], record["phase"], record["step"]) == (State.FLY, Phase.ROUTE, 3)
    assert record["blocked"] and record["limited"]
    for name in ("position_ned", "velocity_ned", "attitude_ned_frd", "rates_frd"):
        assert np.array_equal(record[name], getattr(vehicle, name))
    for row, name in enumerate(("position", "velocity", "acceleration")):
        assert np.array_equal(record[f"reference_{name}_ned"], reference.rows[row])
    assert np.array_equal(record["target_ned"], decision.target_ned)
    assert np.array_equal(np.concatenate([np.atleast_1d(record[name]) for name, _ in CONTROL_FIELDS]), control)
    assert (record["reference_yaw"], record["reference_yaw_rate"]) == (reference.yaw, reference.yaw_rate)
    assert (record["position_age"], record["speed_limit"], record["clearance"]) == (7e-3, 3.5, math.inf)
    assert record["free_distance"] == 12.5
    expected = (Reason.STOP, 1.5) if guarded else (Reason.NONE, 0.0)
    assert (record["guard_reason"], record["guard_change"]) == expected


@pytest.mark.parametrize("rate", [1.0, 25.0, 50.0, 60.0, 250.0, 1000.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_each_record_is_a_step_and_the_worst_since_the_one_before(rate: float, seed: int) -> None:
    table = steps(seed)
    late = np.random.default_rng(seed).integers(0, 1_500_000, STEPS)
    times = np.arange(STEPS) * STEP_NS + late  # as steps come in real time
    thinning = Thinning(rate)
    found = [each for at, row in zip(times.tolist(), table, strict=True) for each in thinning.step(at, row.tobytes())]
    found += thinning.rest()
    assert thinning.rest() == []
    logged = np.frombuffer(b"".join(data for _, data in found), LOGGED.dtype)
    where = np.searchsorted(times, [at for at, _ in found])
    assert (times[where] == [at for at, _ in found]).all() and (np.diff(where) > 0).all()
    assert where[-1] == STEPS - 1, "the last step is not lost"
    error = np.linalg.norm(table["position_ned"] - table["reference_position_ned"], axis=1)
    first = 0
    for last, record in zip(where, logged, strict=True):
        span = table[first : last + 1]
        for name in ("state", "phase", "step"):
            assert (span[name] == record[name]).all(), "a record never spans a change"
        for name in ("position_ned", "attitude_ned_frd", "torque_command", "reference_yaw", "disturbance_ned"):
            assert (record[name] == table[last][name].astype("<f4")).all()
        assert record["blocked"] == span["blocked"].any() and record["limited"] == span["limited"].any()
        assert record["guard_reason"] == span["guard_reason"].max()
        for name in ("clearance", "free_distance", "speed_limit"):
            assert record[name] == span[name].min().astype("<f4")
        for name in ("position_age", "guard_change"):
            assert record[name] == span[name].max().astype("<f4")
        assert record["worst_error"] == pytest.approx(error[first : last + 1].max(), rel=1e-6)
        assert abs(record["worst_thrust"]) == np.abs(span["thrust_command"]).max().astype("<f4")
        for axis in range(3):
            torque = span["torque_command"][:, axis]
            assert record["worst_torque"][axis] == torque[np.abs(torque).argmax()].astype("<f4")
        first = last + 1


def test_as_many_records_as_wanted() -> None:
    table = np.zeros(STEPS, TRACE.dtype)
    for rate, kept in ((1000.0, STEPS), (250.0, STEPS), (50.0, STEPS // 5), (60.0, STEPS * 60 // 250)):
        thinning = Thinning(rate)
        found = [each for index, row in enumerate(table) for each in thinning.step(index * STEP_NS, row.tobytes())]
        assert len(found) == pytest.approx(kept, abs=1)


def test_after_a_silence_there_is_no_burst() -> None:
    thinning = Thinning(50.0)
    row = np.zeros(1, TRACE.dtype).tobytes()
    thinning.step(0, row)
    after = [len(thinning.step(10_000_000_000 + index * STEP_NS, row)) for index in range(10)]
    assert after == [1, 0, 0, 0, 0, 1, 0, 0, 0, 0]
