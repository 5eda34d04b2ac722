"""Each accumulator by itself: its result does not depend on how the flight is cut into batches."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from companion.mission.plan import Phase
from companion.records import LOGGED, TICK, TRACE
from companion.supervision.states import State
from companion.view.accumulators.clearance import BIN_M, Clearance
from companion.view.accumulators.estimator import EstimatorJumps
from companion.view.accumulators.exceedances import Exceedances
from companion.view.accumulators.interventions import Interventions
from companion.view.accumulators.parameters import Parameters
from companion.view.accumulators.paths import Paths
from companion.view.accumulators.power import Energy
from companion.view.accumulators.scans import Scans, ScansBySender
from companion.view.accumulators.senders import Senders
from companion.view.accumulators.texts import Texts
from companion.view.accumulators.timing import Timing
from companion.view.accumulators.tracking import Tracking
from companion.view.batches import Table
from companion.view.columns import message_columns
from companion.view.lines import Floats
from protocol.flightlog import RecordType
from protocol.flightlog.mavlink_records import message_type
from protocol.messages import dialect

STEPS = 200
TIMES = 0.02 * np.arange(STEPS)
CUTS = st.lists(st.integers(1, STEPS - 1), max_size=5, unique=True).map(sorted)


def flown(kind: RecordType = LOGGED) -> Table:
    """Control steps of a flight along a circle of 3 m radius, in two phases, with flags that come and go."""
    generator = np.random.default_rng(2)
    table = np.zeros(STEPS, kind.dtype)
    turns = TIMES * 0.5
    table["position_ned"] = np.column_stack((3.0 * np.cos(turns), 3.0 * np.sin(turns), np.full(STEPS, -2.0)))
    table["reference_position_ned"] = table["position_ned"] + generator.normal(0.0, 0.1, (STEPS, 3))
    table["state"] = np.where(TIMES < 3.0, State.FLY.value, State.HOLD.value)
    table["phase"] = np.where(TIMES < 1.0, Phase.TAKEOFF.value, Phase.ROUTE.value)
    table["clearance"] = np.where(TIMES < 2.0, generator.uniform(0.2, 20.0, STEPS), np.inf)
    table["limited"], table["blocked"] = generator.random((2, STEPS)) < 0.3
    table["guard_reason"] = generator.integers(0, 3, STEPS)
    table["guard_change"] = generator.uniform(0.1, 5.0, STEPS)
    if kind is LOGGED:
        error = np.linalg.norm(table["position_ned"] - table["reference_position_ned"], axis=1)
        table["worst_error"] = error + 0.05
    return table


def batched(add: Callable[[Floats, NDArray[Any]], Any], table: NDArray[Any], cuts: list[int]) -> None:
    for start, stop in zip([0, *cuts], [*cuts, len(table)], strict=True):
        add(TIMES[start:stop], table[start:stop])


@given(CUTS)
def test_tracking_is_the_errors_of_each_phase_while_the_companion_flies(cuts: list[int]) -> None:
    table, tracking = flown(), Tracking()
    batched(tracking.add_steps, table, cuts)
    error = (table["position_ned"] - table["reference_position_ned"]).astype(np.float64)
    assert set(tracking.phases) == {Phase.TAKEOFF, Phase.ROUTE}
    for phase, errors in tracking.phases.items():
        chosen = (table["phase"] == phase) & (table["state"] == State.FLY.value)
        assert errors.count == chosen.sum()
        assert errors.rms_ned == pytest.approx(np.sqrt((error[chosen] ** 2).mean(axis=0)), rel=1e-5)
        assert errors.largest == pytest.approx(table["worst_error"][chosen].max())
        assert errors.largest_at == TIMES[chosen][table["worst_error"][chosen].argmax()]
    assert tracking.worst is max(tracking.phases.values(), key=lambda errors: errors.largest)


def test_a_whole_trace_has_each_step_s_own_error() -> None:
    table, tracking = flown(TRACE), Tracking()
    tracking.add_steps(TIMES, table)
    assert tracking.worst is not None
    error = np.linalg.norm(table["position_ned"] - table["reference_position_ned"], axis=1)
    assert tracking.worst.largest == error[table["state"] == State.FLY.value].max()


@given(CUTS)
def test_clearance_is_counted_of_what_was_near(cuts: list[int]) -> None:
    table, clearance = flown(), Clearance(safe_distance=1.5)
    batched(clearance.add_steps, table, cuts)
    near = table["clearance"][np.isfinite(table["clearance"])]
    assert clearance.total == len(near)
    assert clearance.near_steps == (near < 1.5).sum()
    assert clearance.least == (near.min(), TIMES[table["clearance"].argmin()])
    assert clearance.counts[:4].sum() == (near < 4 * BIN_M).sum()
    assert clearance.counts[-1] == (near >= BIN_M * (len(clearance.counts) - 1)).sum(), "all that is farther"


def test_what_is_near_a_vehicle_on_the_ground_is_not_counted() -> None:
    table, clearance = flown(), Clearance(1.2)
    ground = np.arange(STEPS) < 10
    table["phase"][ground], table["clearance"][ground] = Phase.PREPARE.value, 0.01
    table["state"][-5:], table["clearance"][-5:] = State.ENDED.value, 0.02
    near = np.isfinite(table["clearance"]).sum() - 15
    clearance.add_steps(TIMES, table)
    assert clearance.least is not None and clearance.least[0] > 0.1
    assert clearance.total == clearance.counts.sum() == near


def test_without_anything_near_there_is_no_least_clearance() -> None:
    table, clearance = flown(), Clearance(1.2)
    table["clearance"] = np.inf
    clearance.add_steps(TIMES, table)
    assert clearance.least is None and clearance.total == 0


@given(CUTS)
def test_interventions_are_stretches_of_their_flags(cuts: list[int]) -> None:
    table, whole, parts = flown(), Interventions(), Interventions()
    whole.add_steps(TIMES, table)
    batched(parts.add_steps, table, cuts)
    for name in ("limited", "blocked", "guard"):
        of_whole, of_parts = getattr(whole, name), getattr(parts, name)
        assert len(of_whole.finish()) == len(of_parts.finish())
        assert of_parts.count == of_whole.count
    assert whole.limited.finish()[-1].value == 0, "the companion holds in the end"
    changed = table["guard_change"][table["guard_reason"] > 0]
    assert parts.guard_changes.count == len(changed)
    assert parts.guard_changes.examples[0][0] == changed.max()


def test_a_path_across_the_date_line_has_no_leap() -> None:
    table = np.zeros(100, message_type(dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, "/x")[0].dtype)
    turned = 1_799_900_000 + 4_000 * np.arange(100)
    table["lat"], table["lon"] = -170_000_000, np.where(turned > 1_800_000_000, turned - 3_600_000_000, turned)
    paths = Paths()
    paths.add_message("1/1", "GLOBAL_POSITION_INT", 0.1 * np.arange(100), table)
    assert np.allclose(paths.told["1/1 global"].rows()[:, 2], 42.53 * np.arange(100), rtol=1e-3)


def test_a_place_that_is_none_is_no_part_of_a_path() -> None:
    table = np.zeros(6, message_type(dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, "/x")[0].dtype)
    table["x"] = 1.0, np.nan, 2.0, np.inf, 3.0, 1e30
    paths = Paths()
    paths.add_message("1/1", "LOCAL_POSITION_NED", np.arange(6.0), table)
    north = message_columns("LOCAL_POSITION_NED", table)["position_ned"][:, 0]
    assert np.array_equal(np.isfinite(north), [True, False, True, False, True, False])
    assert paths.told["1/1"].rows()[:, :2].tolist() == [[0.0, 1.0], [2.0, 2.0], [4.0, 3.0]]


@given(CUTS)
def test_the_path_s_length_has_no_seams(cuts: list[int]) -> None:
    table, paths = flown(), Paths()
    batched(paths.add_steps, table, cuts)
    assert paths.distance_m == pytest.approx(3.0 * 0.5 * TIMES[-1], rel=1e-4)
    assert paths.traced.rows()[:, 0] == pytest.approx(TIMES)


@given(CUTS, st.integers(10, STEPS - 1))
def test_a_jump_is_found_wherever_the_batches_end(cuts: list[int], at: int) -> None:
    table = np.zeros(STEPS, message_type(dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, "/x")[0].dtype)
    table["time_boot_ms"], table["vx"] = 20 * np.arange(STEPS), 2.0
    table["x"] = 2.0 * TIMES + np.where(np.arange(STEPS) >= at, 1.5, 0.0)
    jumps = EstimatorJumps()
    batched(lambda times, part: jumps.add_message("1/1", "LOCAL_POSITION_NED", times, part), table, cuts)
    ((size, when),) = jumps.position["1/1"].examples
    assert size == pytest.approx(1.5, abs=1e-4) and when == TIMES[at]
    assert jumps.attitude == {}


@given(CUTS)
def test_energy_is_the_integral_of_power(cuts: list[int]) -> None:
    watts, energy = 100.0 + 10.0 * TIMES, Energy()
    batched(lambda times, part: energy.add("1/1/SYS_STATUS", times, part), watts, cuts)
    joules = 100.0 * TIMES[-1] + 5.0 * TIMES[-1] ** 2
    assert energy.watt_hours == {"1/1/SYS_STATUS": pytest.approx(joules / 3600.0)}


@given(CUTS)
def test_late_ticks_are_counted_and_latencies_have_their_quantiles(cuts: list[int]) -> None:
    ticks, timing = np.zeros(STEPS, TICK.dtype), Timing()
    ticks["late_ns"][[20, 150]] = 3_000_000, 9_000_000
    batched(timing.add_ticks, ticks, cuts)
    assert np.array(timing.late_ticks.examples) == pytest.approx(np.array([(9e-3, TIMES[150]), (3e-3, TIMES[20])]))
    assert timing.latency_quantile(0.5) is None
    rows = [{"latency_ns": [100_000] * 9 + [1_000_000]} for _ in range(STEPS)]
    timing.add_latencies(TIMES, rows)
    for share, wanted_us in ((0.5, 100.0), (0.99, 1000.0)):
        quantile = timing.latency_quantile(share)
        assert quantile is not None and quantile == pytest.approx(wanted_us, rel=0.13)
    assert int(timing.latency_counts.sum()) == 10 * STEPS


def test_only_autopilots_are_senders() -> None:
    table = np.zeros(4, message_type(dialect.MAVLINK_MSG_ID_HEARTBEAT, "/x")[0].dtype)
    px4, none = dialect.MAV_AUTOPILOT_PX4, dialect.MAV_AUTOPILOT_INVALID
    table["autopilot"], table["base_mode"] = (px4, none, px4, px4), (0, 255, 128, 128)
    table["custom_mode"], table["system_status"] = 6 << 16, (3, 6, 4, 5)
    senders = Senders()
    senders.add_heartbeats("1/1", TIMES[:4], table)
    senders.add_heartbeats("255/190", TIMES[1:2], table[1:2])
    assert set(senders.modes) == set(senders.armed) == set(senders.critical) == senders.bytewise == {"1/1"}
    assert [stretch.value for stretch in senders.armed["1/1"].finish()] == [0, 1]
    assert [stretch.value for stretch in senders.critical["1/1"].finish()] == [0, 1]
    assert senders.mode("1/1", 6 << 16) == "Offboard"


def test_each_vehicle_s_modes_have_their_own_names() -> None:
    """Number 5 is Loiter of a copter and fly by wire of a plane; a gimbal's heartbeat has modes, too."""
    senders = Senders()
    kinds = {"1/1": dialect.MAV_TYPE_QUADROTOR, "2/1": dialect.MAV_TYPE_FIXED_WING, "1/154": dialect.MAV_TYPE_GIMBAL}
    for sender, kind in kinds.items():
        table = np.zeros(1, message_type(dialect.MAVLINK_MSG_ID_HEARTBEAT, "/x")[0].dtype)
        table["autopilot"] = dialect.MAV_AUTOPILOT_GENERIC if sender == "1/154" else dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        table["type"], table["custom_mode"] = kind, 5
        senders.add_heartbeats(sender, TIMES[:1], table)
    assert [senders.mode(sender, 5) for sender in kinds] == ["Loiter", "Fly by wire a", "mode 5"]


def test_integer_parameters_are_bits_or_values_by_their_sender() -> None:
    parameters = Parameters()
    bits = float(np.array([50], "<u4").view("<f4")[0])
    unsigned = {"param_id": "A", "param_value": bits, "param_type": dialect.MAV_PARAM_TYPE_UINT32}
    real = {"param_id": "B", "param_value": 0.5, "param_type": dialect.MAV_PARAM_TYPE_REAL32}
    parameters.add("1/1", [unsigned, real])
    assert parameters.values("1/1", {"1/1"}) == {"A": 50, "B": 0.5}
    assert parameters.values("1/1", set()) == {"A": bits, "B": 0.5}


def test_a_parameter_that_was_told_again_has_its_last_value() -> None:
    """However often they were read, and however many that is at once."""
    parameters = Parameters()
    rows = [
        {"param_id": f"P{number}", "param_value": float(time), "param_type": 9}
        for time in range(3)
        for number in range(1200)
    ]
    parameters.add("1/1", rows)
    parameters.add("1/1", [{"param_id": f"Q{number}", "param_value": 5.0, "param_type": 9} for number in range(3000)])
    parameters.add("1/1", [{"param_id": "P7", "param_value": 9.0, "param_type": 9}])
    values = parameters.values("1/1", set())
    assert len(values) == 2000 and values.pop("P7") == 9.0
    assert {value for name, value in values.items() if name[0] == "P"} == {2.0}


def test_rings_that_can_not_be_drawn_are_counted_in_each_batch() -> None:
    scans, table = ScansBySender(), np.zeros(3, message_type(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, "/x")[0].dtype)
    table["increment_f"], table["frame"] = 5.0, dialect.MAV_FRAME_BODY_FRD
    table["frame"][:2] = dialect.MAV_FRAME_GLOBAL
    for start in (0.0, 1.0):
        scans.add("1/1", "OBSTACLE_DISTANCE", start + np.arange(3.0), table)
    assert scans.left_out == 4


def test_scans_are_ranges_within_the_lidar_s_reach() -> None:
    table = np.zeros(2, message_type(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, "/x")[0].dtype)
    table["max_distance"], table["distances"], table["increment"] = 500, 501, 5
    table["distances"][1, 9] = 300
    scans = Scans()
    nearest = scans.add(TIMES[:2], table)
    assert np.isnan(nearest[0]) and nearest[1] == pytest.approx(3.0)
    assert (scans.increment_deg, scans.offset_deg) == (5.0, 0.0)
    (_, first), (at, second) = scans.rows.rows()
    assert np.isnan(first).all() and at == TIMES[1] and np.isfinite(second).sum() == 1


def test_exceedances_keep_the_largest_examples() -> None:
    values, exceedances = np.arange(20.0), Exceedances()
    for part in (slice(10, 20), slice(0, 10)):
        exceedances.add(TIMES[part], values[part], 7.5)
    assert exceedances.count == 12
    assert [value for value, _ in exceedances.examples] == [19.0, 18.0, 17.0, 16.0, 15.0]


def test_a_long_text_of_a_vehicle_is_one_line() -> None:
    """The pieces of two vehicles come in turn; one text never ends."""
    long = "Arming denied: Resolve system health failures first, please"
    pieces = [(7, 0, long[:50]), (7, 1, long[50:]), (0, 0, "Disarmed\t"), (8, 0, "x" * 50)]
    table = [{"severity": 2, "id": number, "chunk_seq": k, "text": text} for number, k, text in pieces]
    texts = Texts()
    for row in table:
        for sender in ("1/1", "2/1"):
            texts.add_statustexts(sender, np.array([3.0]), [row])
    texts.finish()
    assert [each.text for each in texts.vehicle if each.source == "2/1"] == [long, "Disarmed", "x" * 50]
    assert [each.time for each in texts.vehicle] == [3.0] * 6, "when it began"
