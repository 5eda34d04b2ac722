"""What is said about a flight whose faults are known, and that nothing is said of one without."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.config import Settings
from companion.logs.writer import Writer
from companion.mission.plan import Phase
from companion.state import Reason
from companion.supervision.states import State
from companion.view.events import events
from companion.view.finding import Finding, Level
from companion.view.findings import findings
from companion.view.gather import GatheredFlight
from companion.view.report_charts import charts
from companion.view.report_tables import tiles
from protocol.flightlog import Direction
from protocol.flightlog.tlog import TlogReader, write
from protocol.messages import Encoder, dialect
from tests.companion.view.made_logs import Values, from_tlog, make

DATA = Path(__file__).resolve().parents[2] / "data"


def about(found: list[Finding], subject: str) -> Finding:
    (finding,) = [finding for finding in found if finding.about == subject]
    return finding


def test_a_clean_flight_has_no_warning(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path))
    found = findings(flight)
    assert {finding.level for finding in found} == {Level.GOOD}
    assert flight.paths.distance_m == pytest.approx(2.0 * 19.996)
    assert flight.vehicle == "1/1"
    tracking = about(found, "tracking")
    assert "10.0 cm" in tracking.text
    assert [row.partition(":")[0] for row in tracking.evidence] == ["route", "return"]
    assert all("rms 10.0, 0.0, 0.0 cm" in row for row in tracking.evidence)
    assert "no gap in 2 streams" in about(found, "telemetry").text.lower()
    assert [event.text for event in events(flight)] == [
        "armed, taking off",
        "route",
        "Offboard",
        "armed",
        "return",
    ]


def test_what_is_said_at_the_end_is_told_whatever_is_said_before(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path, 1.0))
    before, warnings = len(events(flight)), {700: 3, 2500: 4, 4500: 5}
    for number in range(5000):
        level = warnings.get(number, 2)
        line = {"level": level, "name": "companion", "message": f"{'CRASH' if level > 2 else 'noise'} {number}"}
        flight.texts.add_log(np.array([1.0 + 0.001 * number]), [line])
    *told, last = [event.text for event in events(flight)]
    assert len(told) == 600 and told[0] == "armed, taking off" and told[-1] == "noise 4999"
    assert [text for text in told if "CRASH" in text] == [f"CRASH {number}" for number in warnings]
    assert last == f"{before + 5000 - 600} more are left out"


def test_of_too_many_warnings_the_first_and_the_last_are_told(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path, 1.0))
    before = len(events(flight))
    for number in range(5000):
        line = {"level": 3, "name": "companion", "message": f"{number}"}
        flight.texts.add_log(np.array([1.0 + 0.001 * number]), [line])
    *told, last = [event.text for event in events(flight)]
    assert told == [f"{number}" for number in (*range(300), *range(4700, 5000))]
    assert last == f"{before + 5000 - 600} more are left out"


@pytest.mark.parametrize(("trace_rate", "limited"), [(250.0, "1.00"), (50.0, "1.02")])
def test_saturation_avoidance_and_clearance_are_measured(tmp_path: Path, trace_rate: float, limited: str) -> None:
    """To the time between two records."""

    def change(time: float, values: Values) -> None:
        values["limited"] = 5.0 <= time < 6.0
        values["blocked"] = 8.0 <= time < 10.0 or 12.0 <= time < 12.5
        values["clearance"] = math.hypot(0.5, time - 9.0) if time < 19.0 else math.inf

    flight = GatheredFlight(make(tmp_path, change=change, trace_rate=trace_rate))
    found = findings(flight)
    saturation = about(found, "saturation")
    assert saturation.level is Level.WARNING
    assert f"one time, {limited} s in all" in saturation.text
    assert saturation.at == pytest.approx((5.0,))
    avoidance = about(found, "avoidance")
    assert "2 times, 2.5 s in all" in avoidance.text
    assert avoidance.at == pytest.approx((8.0, 12.0))
    clearance = about(found, "clearance")
    assert (clearance.level, clearance.at) == (Level.WARNING, (9.0,))
    assert "0.50 m" in clearance.text
    assert flight.clearance.total == pytest.approx(19 * trace_rate, abs=2)


def test_what_one_step_saw_is_said_of_a_thinned_trace(tmp_path: Path) -> None:
    """Each at a step that the log itself does not keep."""

    def change(time: float, values: Values) -> None:
        step = round(time * 250.0)
        values["limited"] = step == 502
        values["blocked"] = step == 753
        values["clearance"] = 0.45 if step == 1003 else 5.0
        if step == 1253:
            values["reference_position_ned"] = (2.0 * time, 0.7, -3.0)
        if step == 1503:
            values["thrust_command"] = 0.99

    flight = GatheredFlight(make(tmp_path, 8.0, change=change, trace_rate=50.0))
    found = findings(flight)
    texts = {finding.text: finding for finding in found}
    assert any(text.startswith("A limit on thrust or tilt was reached one time, 0.02 s") for text in texts)
    assert texts["The thrust command reached the end of its range."].at == pytest.approx((6.02,))
    assert "one time" in about(found, "avoidance").text
    assert "nearer than 0.45 m" in about(found, "clearance").text
    assert "within 70.0 cm" in about(found, "tracking").text


@pytest.mark.parametrize(("thrust", "torque", "levels"), [(1.0, 0.5, [Level.WARNING]), (0.5, -1.0, [])])
def test_a_command_at_the_end_of_its_range_is_said(
    tmp_path: Path, thrust: float, torque: float, levels: list[Level]
) -> None:
    def change(time: float, values: Values) -> None:
        if 3.0 <= time < 3.1:
            values["thrust_command"], values["torque_command"] = thrust, (0.0, 0.0, torque)

    found = findings(GatheredFlight(make(tmp_path, 6.0, change=change)))
    ends = [finding for finding in found if finding.text.endswith("reached the end of its range.")]
    assert [finding.level for finding in ends] == levels, "the torque is not what is sent with rates"
    assert [finding.at for finding in ends] == [pytest.approx((3.0,))] * len(levels)


@pytest.mark.parametrize(("state", "counts"), [(State.RELINQUISHED, False), (State.FLY, True)])
def test_what_others_fly_is_near_all_the_same_but_none_of_our_commands(
    tmp_path: Path, state: State, counts: bool
) -> None:
    """A second with something 0.3 m away, in which the companion's command is at its limit."""

    def change(time: float, values: Values) -> None:
        if 5.0 <= time < 6.0:
            values |= {"state": state.value, "limited": True, "blocked": True, "clearance": 0.3}

    flight = GatheredFlight(make(tmp_path, 10.0, change=change))
    clearance = about(findings(flight), "clearance")
    assert "0.30 m" in clearance.text and clearance.at == (5.0,)
    assert ("No limit" in about(findings(flight), "saturation").text) is not counts
    assert any(finding.about == "avoidance" for finding in findings(flight)) is counts


def test_the_share_of_steps_with_too_little_room_is_counted_by_the_settings_own_distance(tmp_path: Path) -> None:
    """Half a second each with 1.1 and 1.3 m, of 10: safe_distance is 1.2 m."""
    assert Settings().avoidance.safe_distance == 1.2

    def change(time: float, values: Values) -> None:
        values["clearance"] = 1.1 if time < 0.5 else 1.3 if time < 1.0 else 4.0

    evidence = about(findings(GatheredFlight(make(tmp_path, 10.0, change=change))), "clearance").evidence
    assert evidence[1] == "5.0 % of the steps with something near were within 1.2 m"


@pytest.mark.parametrize("settings", [b"{}", b'{"avoidance": {"method": "of another package"}}', b"{"])
def test_settings_that_can_not_be_read_are_named(settings: bytes, tmp_path: Path) -> None:
    """What is judged by them is judged by the defaults then."""
    found = findings(GatheredFlight(make(tmp_path, 1.0, settings=settings)))
    told = [finding for finding in found if finding.about == "settings"]
    assert len(told) == (settings != b"{}")
    assert all("the defaults stand for them" in each.text and each.evidence[0] for each in told)


def test_a_vehicle_that_falls_silent_for_good_has_a_gap_to_the_log_s_end(tmp_path: Path) -> None:
    found = [
        finding
        for finding in findings(GatheredFlight(make(tmp_path, silent=(16.0, 20.0))))
        if finding.about == "telemetry"
    ]
    assert [finding.level for finding in found] == [Level.WARNING], "one cause"
    assert found[0].evidence[0].startswith("4016 ms from 15.98 s")


@pytest.mark.parametrize(("silent", "part"), [((2.0, 16.0), False), ((4.0, 20.0), True)])
def test_a_long_silence_in_the_middle_is_a_pause(silent: tuple[float, float], part: bool, tmp_path: Path) -> None:
    """One to the end may be a recording that goes on longer."""
    told = about(findings(GatheredFlight(make(tmp_path, silent=silent))), "telemetry")
    assert told.level is (Level.NOTE if part else Level.WARNING)
    assert ("for a part of the flight only" in told.text) is part and ("paused for up to 14" in told.text) is not part


def test_telemetry_gaps_and_late_ticks_are_found_where_they_are(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path, 8.0, silent=(6.0, 6.6), late_ms={750: 7.0, 1000: 1.9}))
    found = findings(flight)
    gap = about(found, "telemetry")
    assert gap.evidence[-1] == "ATTITUDE_QUATERNION, LOCAL_POSITION_NED", "scans come too seldom to be judged"
    assert gap.level is Level.WARNING and "2 streams at once" in gap.text and gap.chart == "Roll"
    assert gap.at[0] == pytest.approx(5.98)
    assert gap.evidence[0].startswith("620 ms from 5.98 s")
    deadlines = about(found, "deadlines")
    assert deadlines.at == (3.0,)
    assert "one time, 7.0 ms" in deadlines.text


def test_a_position_that_jumps_is_told_from_one_that_moves(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path, 8.0, jump_at=6.0, silent=(3.0, 3.5)))
    jump = about(findings(flight), "estimator")
    assert jump.level is Level.WARNING
    assert "position jumped one time" in jump.text
    assert jump.at == pytest.approx((6.0,))
    assert jump.evidence == ("1.50 m at 6.00 s",)


def test_shaking_is_measured_above_its_frequency(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        values["rates_frd"] = (0.0, 0.6 * math.sin(2.0 * math.pi * 40.0 * time), 2.0 * math.sin(2.0 * math.pi * time))

    shaking = about(
        findings(GatheredFlight(make(tmp_path, change=change, motion_every=1, trace_rate=50.0))), "vibration"
    )
    assert shaking.level is Level.WARNING
    assert f"{np.degrees(0.6 / math.sqrt(2.0)):.2f} deg/s rms" in shaking.text


def test_the_guard_s_changes_are_counted_by_their_reason(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        if 3.0 <= time < 4.0 or 6.0 <= time < 6.5:
            values["guard_reason"], values["guard_change"] = Reason.STOP.value, 1.0 + time
        if 8.0 <= time < 8.1:
            values["guard_reason"], values["guard_change"] = Reason.STALE.value, 0.5

    guard = about(findings(GatheredFlight(make(tmp_path, 10.0, change=change))), "guard")
    assert guard.level is Level.WARNING
    assert "3 times, 1.60 s in all" in guard.text
    assert guard.evidence[0] == "no way to stop was left: 2 times, 1.50 s"
    assert guard.evidence[1] == "nothing was seen for too long: one time, 0.10 s"
    assert guard.evidence[2].startswith("by 7.50 m/s²")
    assert guard.at == pytest.approx((3.0, 6.0, 8.0))


def test_energy_is_voltage_times_current_over_time(tmp_path: Path) -> None:
    """24 W at first, 12 W in the end, falling evenly in 360 s: 1.8 Wh; a silence of 100 s in between counts nothing."""
    path, vehicle = tmp_path / "battery.mcap", Encoder(1, 1)
    with Writer(path, 0, {}) as writer:
        for second in range(461):
            if 180 < second <= 280:
                continue
            passed = second if second <= 180 else second - 100
            centiamperes = round(200 - 100 * passed / 360)
            status = (0, 0, 0, 0, 12_000, centiamperes, 50, 0, 0, 0, 0, 0, 0)
            data = vehicle.encode_fields(dialect.MAVLink_sys_status_message, *status)
            writer.datagram(second * 1_000_000_000, second, Direction.IN, "", data)
    assert GatheredFlight(path).energy.watt_hours == {"1/1/SYS_STATUS": pytest.approx(1.8 - 18.0 / 3600.0, rel=1e-3)}


def test_each_battery_is_one_of_its_own(tmp_path: Path) -> None:
    """48 V of twelve cells and 10 A each for 60 s."""
    path, vehicle = tmp_path / "batteries.mcap", Encoder(1, 1)
    with Writer(path, 0, {}) as writer:
        for second in range(61):
            data = vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 3, 128, 0, 4, 3)
            for number, left in ((0, 90), (2, 30)):
                cells = (0, 0, 0, [4000] * 10, 1000, 0, 0, left - second // 4, 0, 0, [4000, 4000, 0, 0])
                data += vehicle.encode_fields(dialect.MAVLink_battery_status_message, number, *cells)
            writer.datagram(second * 1_000_000_000, second, Direction.IN, "", data)
    flight = GatheredFlight(path)
    assert flight.energy.watt_hours == {f"1/1/BATTERY_STATUS{end}": pytest.approx(8.0) for end in ("", " 2")}
    assert ("energy", "16.00 Wh") in tiles(flight)
    assert [each.text for each in findings(flight) if each.about == "power"] == [
        "The battery 2 went from 30 % to 15 %.",
        "The battery went from 90 % to 75 %.",
    ]
    drawn = {chart.title: [curve.name for curve in chart.curves] for chart in charts(flight)}
    assert drawn["Battery voltage"] == ["voltage", "voltage 2"] and drawn["Battery left"] == ["left", "left 2"]


def test_a_failed_flight_says_so_first(tmp_path: Path) -> None:
    result = {"delivered": "False", "landed": "False", "fault": "no ring for 0.52 s", "messages_lost": "3"}
    found = findings(GatheredFlight(make(tmp_path, 2.0, result=result)))
    assert (found[0].level, found[0].about) == (Level.PROBLEM, "outcome")
    assert "no ring for 0.52 s" in found[0].text
    assert any(finding.text.startswith("3 messages of the vehicle were lost") for finding in found)


def test_the_link_s_counters_are_said_where_they_are_not_zero(tmp_path: Path) -> None:
    ended = {"delivered": "True", "landed": "True", "fault": "", "messages_lost": "0"}
    clean = dict.fromkeys(("frames_bad", "duplicates", "sequence_restarts", "reboots", "messages_late"), "0")
    disordered = clean | {"duplicates": "1", "sequence_restarts": "2"}
    cases: tuple[tuple[dict[str, str], Level, tuple[str, ...]], ...] = (
        (clean, Level.GOOD, ()),
        (disordered, Level.NOTE, ("one duplicate", "2 sequence restarts")),
        (disordered | {"frames_bad": "7"}, Level.WARNING, ("7 damaged frames", "one duplicate", "2 sequence restarts")),
        (clean | {"messages_late": "3"}, Level.NOTE, ("3 late messages",)),
    )
    for number, (counters, level, rows) in enumerate(cases):
        flight = GatheredFlight(make(tmp_path / str(number), 2.0, result=ended | counters))
        telemetry = about(findings(flight), "telemetry")
        assert (telemetry.level, telemetry.evidence) == (level, rows)
        assert telemetry.text.startswith("Not every message") is bool(rows)


@pytest.mark.parametrize("count", ["²", "٣", "5²", "-1", "1e5", "", "9" * 5000])
def test_a_counter_that_is_no_number_is_not_said(tmp_path: Path, count: str) -> None:
    ended = {"delivered": "True", "landed": "True", "fault": "", "messages_lost": count, "duplicates": count}
    telemetry = about(findings(GatheredFlight(make(tmp_path, 2.0, result=ended))), "telemetry")
    assert (telemetry.level, telemetry.evidence) == (Level.GOOD, ())


def test_what_was_not_believed_is_a_warning(tmp_path: Path) -> None:
    result = {"landed": "True", "motion_implausible": "1", "rings_implausible": "12"}
    telemetry = about(findings(GatheredFlight(make(tmp_path, 2.0, result=result))), "telemetry")
    assert telemetry.level is Level.WARNING and "could not always be true" in telemetry.text
    assert telemetry.evidence == ("one implausible pose", "12 implausible rings")


def test_what_signing_refused_is_a_warning_of_its_own(tmp_path: Path) -> None:
    result = {"landed": "True", "signing_forged": "3", "signing_unsigned": "0", "signing_other_link": "4"}
    signing = about(findings(GatheredFlight(make(tmp_path / "some", 2.0, result=result))), "signing")
    assert signing.level is Level.WARNING and signing.text.startswith("7 messages")
    assert signing.evidence == ("forged: 3", "other link: 4")
    none = dict.fromkeys(result, "0") | {"landed": "True"}
    assert not [
        each for each in findings(GatheredFlight(make(tmp_path / "none", 2.0, result=none))) if "sign" in each.about
    ]


def test_a_reboot_of_the_vehicle_is_a_warning_of_its_own(tmp_path: Path) -> None:
    result = {"landed": "True", "reboots": "1", "messages_lost": "4", "duplicates": "nonsense"}
    found = findings(GatheredFlight(make(tmp_path, 2.0, result=result)))
    telemetry = [finding for finding in found if finding.about == "telemetry"]
    assert [finding.level for finding in telemetry] == [Level.WARNING] * 2
    assert telemetry[0].text.startswith("4 messages") and "rebooted one time" in telemetry[1].text


def test_an_error_in_one_phase_is_said_of_that_phase(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        if values["phase"] == Phase.RETURN.value:
            values["reference_position_ned"] = (2.0 * time, 0.8, -3.0)

    tracking = about(findings(GatheredFlight(make(tmp_path, 13.0, change=change))), "tracking")
    assert tracking.level is Level.WARNING
    assert "rms 10.0, 0.0, 0.0 cm" in tracking.evidence[0]
    assert "rms 0.0, 80.0, 0.0 cm" in tracking.evidence[1]
    assert tracking.at[0] >= 10.0


def test_a_log_cut_short_is_reported_on_as_far_as_it_goes(tmp_path: Path) -> None:
    path = make(tmp_path, 4.0)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    found = findings(GatheredFlight(path))
    assert any(finding.about == "log" and "cut off" in finding.text for finding in found)


def test_a_stop_of_the_setpoints_is_the_cause_of_the_failsafe(tmp_path: Path) -> None:
    """PX4's own recording, in which the stream stops for 3 s."""
    found = findings(GatheredFlight(from_tlog(DATA / "px4_offboard.tlog", tmp_path)))
    stop, critical = about(found, "setpoints"), about(found, "failsafe")
    assert stop.level is Level.PROBLEM and stop.chart == "Thrust" and stop.at[0] < critical.at[0] < stop.at[0] + 3.0
    assert critical.text.startswith("The PX4 quadrotor reported a critical state")
    assert critical.evidence[-1] == f"setpoints had stopped at {stop.at[0]:.2f} s"


@pytest.mark.parametrize(("thrust", "cause", "chart"), [(1.0, "too heavy", "Thrust"), (0.5, "wind", "Roll")])
def test_a_long_limit_is_told_with_its_likely_cause(tmp_path: Path, thrust: float, cause: str, chart: str) -> None:
    def change(time: float, values: Values) -> None:
        if 3.0 <= time < 5.0:
            values |= {"thrust_command": thrust, "limited": True}

    found = findings(GatheredFlight(make(tmp_path, 6.0, change=change)))
    (limit,) = (each for each in found if each.text.startswith("A limit"))
    assert limit.level is Level.WARNING and cause in limit.evidence[-1] and limit.chart == chart


def test_each_chart_to_look_at_exists(tmp_path: Path) -> None:
    flight = GatheredFlight(make(tmp_path, 5.0, jump_at=3.0))
    titles = {chart.title for chart in charts(flight)}
    assert {finding.chart for finding in findings(flight) if finding.at} <= titles


def test_of_several_vehicles_one_is_told_of(tmp_path: Path) -> None:
    """The parameters and the vibration are its own, and not those of whoever told of them last."""
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(2000):
            system = 1 if number % 3 else 2
            encoder, of_system = Encoder(system, 1), {1: 5.0, 2: 90.0}[system]
            message, fields = (
                (dialect.MAVLink_heartbeat_message, (2, 12, 209, 6 << 16, 4, 3)),
                (dialect.MAVLink_vibration_message, (number, of_system, 0.0, 0.0, 0, 0, 0)),
                (dialect.MAVLink_param_value_message, (b"MPC_XY_VEL_MAX", of_system, 9, 1, 0)),
                (dialect.MAVLink_param_value_message, (f"ONLY_{system}".encode(), of_system, 9, 1, 0)),
            )[number // 10 % 4]
            data = encoder.encode_fields(message, *fields)
            writer.datagram(number * 5_000_000, number, Direction.IN, "", data)
    flight = GatheredFlight(tmp_path / "flight.mcap")
    assert flight.vehicle == "1/1" and flight.parameters == {"MPC_XY_VEL_MAX": 5.0, "ONLY_1": 5.0}
    (vibration,) = [finding for finding in findings(flight) if finding.about == "vibration"]
    assert vibration.level is Level.GOOD and "reached 5.0" in vibration.text


@pytest.mark.parametrize(
    ("by_s", "said"),
    [
        (3 * 365 * 86_400, "1095.0 days ahead, or nothing was recorded for so long, at 14.02 s"),
        (3600, "1.0 h ahead, or nothing was recorded for so long, at 14.02 s"),
        (-20 * 365 * 86_400, "7300.0 days back at 14.02 s"),
        (-60, "60 s back at 14.02 s"),
    ],
)
def test_a_clock_that_is_set_leaves_the_times_as_they_were(tmp_path: Path, by_s: int, said: str) -> None:
    """As that of a ground station's machine, which hears of the time only then."""
    entries = list(TlogReader(DATA / "px4_offboard.tlog").entries())
    at = len(entries) // 3
    moved = [entry._replace(time_us=entry.time_us + by_s * 1_000_000) for entry in entries[at:]]
    write(tmp_path / "set.tlog", [*entries[:at], *moved])
    plain, flight = (
        GatheredFlight(from_tlog(source, tmp_path / source.stem))
        for source in (DATA / "px4_offboard.tlog", tmp_path / "set.tlog")
    )
    assert flight.begin == 0.0 and flight.end == pytest.approx(plain.end, abs=0.1)
    found = findings(flight)
    finding = about(found, "log")
    assert finding.level is Level.WARNING and finding.evidence == (said,)
    assert [each.text for each in found if each is not finding] == [each.text for each in findings(plain)]
    assert dict(tiles(flight)) == dict(tiles(plain))
    assert [chart.title for chart in charts(flight)] == [chart.title for chart in charts(plain)]
