"""Each way to end a flight has its word, and everybody who shows the flight says the same of it."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from companion.cli.ending import figures, print_end, print_next
from companion.config import Settings
from companion.link.vehicle_link import Traffic
from companion.logs.info import info
from companion.logs.writer import Writer
from companion.outcomes import Outcome, Testimony, Verdict, judge, recorded
from companion.records import TICK
from companion.runtime.flight import Result, result_table
from companion.runtime.summary import Summary
from companion.state import FlightMode, Output
from companion.supervision.health import Health, Plight
from companion.supervision.states import State
from companion.supervision.supervisor import Supervisor
from protocol.flightlog import Direction
from protocol.messages import Encoder, dialect
from tests.companion.said_alike import assert_all_say
from tests.companion.supervision.test_supervisor import EMPTY, ENGAGED, IDLE, LOW, OTHERS, SECOND, WELL, flying

DONE = replace(WELL, mission_done=True)
LANDING = replace(WELL, mode=FlightMode.LAND)
DOWN = replace(LANDING, armed=False)
STUCK = replace(WELL, plight=Plight(risen=False))
UNHEARD = replace(STUCK, telemetry_age=0.6)
ARMED = tuple(replace(each, plight=Plight(risen=False)) for each in (IDLE, IDLE, IDLE, ENGAGED, WELL, WELL))
HEAVY = Plight(risen=False, full_thrust=True)
FALLEN = Plight(emergency="crash: hit ground", crash="hit ground")
HELD = replace(WELL, scan_age=0.6)
RELEASED = Testimony(released=True)
EMPTY_SUMMARY = Summary(0.0, None, None, None, None, None, 0, 0)

Way = tuple[Outcome, str, Sequence[Health], bool | None, dict[str, Any]]
"""The outcome, a part of the cause, what was seen of the flight, whether the parcel was delivered, and what else
`judge` is told."""
IN_FLIGHT: list[Way] = [
    (Outcome.DELIVERED, "", (DONE, LANDING, DOWN), True, {}),
    (Outcome.DELIVERED, "", (HELD, WELL, WELL, DONE, LANDING, DOWN), True, {"testimony": RELEASED}),
    (Outcome.FLOWN, "", (DONE, LANDING, DOWN), None, {}),
    (Outcome.FLOWN, "", (OTHERS, WELL, WELL, DONE, LANDING, DOWN), None, {"testimony": Testimony()}),
    (Outcome.NOT_DELIVERED, "did not release", (DONE, LANDING, DOWN), False, {}),
    (Outcome.NOT_DELIVERED, "did not release", (DONE, LANDING, DOWN), True, {"testimony": Testimony()}),
    (Outcome.EMERGENCY, "critical state", (DONE, replace(LANDING, failsafe=True), DOWN), True, {}),
    (Outcome.EMERGENCY, "motor 3", (replace(WELL, plight=Plight(emergency="motor 3")), DONE, LANDING, DOWN), True, {}),
    (Outcome.CALLED_OFF, "in flight", (replace(WELL, land_requested=True), LANDING, DOWN), False, {}),
    (Outcome.OPERATOR, "", (OTHERS, replace(OTHERS, landed=True), replace(OTHERS, armed=False)), False, {}),
    (Outcome.OPERATOR, "by others", (DONE, OTHERS, replace(LANDING, mode=FlightMode.MANUAL), DOWN), True, {}),
    (Outcome.NO_TAKE_OFF, "does not rise", (replace(STUCK, armed=False),), False, {}),
    (Outcome.NO_TAKE_OFF, "too heavy?", (replace(WELL, overdue=0.1, plight=HEAVY), LANDING, DOWN), None, {}),
    (Outcome.RETURNED, "battery at 14 %", (replace(WELL, limits=LOW), DONE, LANDING, DOWN), False, {}),
    (Outcome.RETURNED, "battery at 14 %", (replace(WELL, limits=LOW), DONE, LANDING, DOWN), True, {}),
    (
        Outcome.CALLED_OFF,
        "in flight",
        (replace(WELL, limits=LOW), replace(WELL, land_requested=True), LANDING, DOWN),
        False,
        {},
    ),
    (
        Outcome.LANDED_EARLY,
        "telemetry",
        (replace(WELL, telemetry_age=0.6), OTHERS, replace(OTHERS, armed=False)),
        False,
        {},
    ),
    (Outcome.LANDED_EARLY, "battery at 6 %", (replace(WELL, limits=EMPTY), LANDING, DOWN), False, {}),
    (
        Outcome.LANDED_EARLY,
        "than the 60 s",
        (replace(WELL, overdue=0.1, plight=Plight(allowed=60.0)), LANDING, DOWN),
        None,
        {},
    ),
    (Outcome.LEFT, "who fly", (OTHERS, replace(OTHERS, land_requested=True)), False, {}),
    (Outcome.LEFT, "abandoned", (), False, {"ended": False}),
    (Outcome.CALLED_OFF, "before the start", (), False, {"ended": False, "began": False}),
    (Outcome.FAILED, "the link is gone", (), False, {"failure": "the link is gone: unplugged"}),
    (Outcome.FAILED, "loop", (DONE,), True, {"failure": "the companion's loop failed: KeyError('x')"}),
    (Outcome.LOST, "silent", (replace(WELL, silence=11.0, telemetry_age=11.0),), True, {}),
    (
        Outcome.LOST,
        "rebooted",
        (replace(WELL, telemetry_age=0.6), replace(DOWN, plight=Plight(rebooted=True))),
        True,
        {},
    ),
    (
        Outcome.LOST,
        "without a report",
        (DONE, LANDING, DOWN),
        True,
        {"testimony": Testimony(problem="without a report")},
    ),
    (Outcome.CRASHED, "hit ground", (DONE, replace(DOWN, plight=FALLEN)), True, {}),
    (Outcome.CRASHED, "in flight", (replace(WELL, armed=False),), False, {}),
    (Outcome.CRASHED, "hit tree", (DONE, LANDING, DOWN), True, {"testimony": Testimony("tree", 1, -0.01)}),
]
BEFORE: list[Way] = [
    (Outcome.CALLED_OFF, "before the start", (IDLE, replace(IDLE, land_requested=True)), False, {}),
    (Outcome.CALLED_OFF, "before the start", (replace(IDLE, seen=False, land_requested=True),), False, {}),
    (Outcome.NOT_STARTED, "GUID_OPTIONS", (IDLE, replace(IDLE, refusal="GUID_OPTIONS is 0")), None, {}),
    (Outcome.NOT_STARTED, "no vehicle", (replace(IDLE, seen=False),) * 7, False, {}),
    (
        Outcome.NO_TAKE_OFF,
        "battery at 14 %",
        (*ARMED, replace(STUCK, limits=LOW), replace(STUCK, mission_done=True), replace(STUCK, armed=False)),
        False,
        {},
    ),
    (Outcome.NO_TAKE_OFF, "telemetry lost", (*ARMED, UNHEARD, replace(STUCK, armed=False)), False, {}),
    (
        Outcome.LANDED_EARLY,
        "telemetry lost",
        (*ARMED, UNHEARD, replace(STUCK, airborne=True), replace(STUCK, armed=False)),
        False,
        {},
    ),
]


def flown_out(scripts: Sequence[Health], supervisor: Supervisor, now: int) -> Supervisor:
    """Each health, 2 s after the one before."""
    for health in scripts:
        supervisor.update(health, now)
        now += 2 * SECOND
    return supervisor


def log_of(folder: Path, result: dict[str, object] | None) -> Path:
    """A log of nothing but its beginning and, if there is one, its result."""
    tables = {"flight": {"mission": "made", "pace": "lockstep"}}
    if result is not None:
        tables["result"] = {name: str(value) for name, value in result.items()}
    (folder / "one").mkdir()
    with Writer(folder / "one" / "flight.mcap", 1_700_000_000 * SECOND, tables) as writer:
        writer.record(TICK, 0, 0, TICK.pack(0))
        writer.record(TICK, SECOND, 1, TICK.pack(0))
    return folder / "one" / "flight.mcap"


def result_of(log: Path, verdict: Verdict, delivered: bool | None, testimony: Testimony | None) -> Result:
    return Result(
        verdict, delivered, True, testimony, log, Output.RATES, 1.0, 1.0, Traffic(*[0] * 7), {}, {}, 0, 0, 0, None
    )


@pytest.mark.parametrize("way", IN_FLIGHT + BEFORE)
def test_console_info_logs_report_and_view_say_the_same(
    way: Way,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "250")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    outcome, cause, script, delivered, facts = way
    supervisor = flown_out(script, *((Supervisor(Settings()), 0) if way in BEFORE else flying()))
    assert supervisor.state is State.ENDED or not facts.get("ended", True) or "failure" in facts
    verdict = judge(supervisor.verdict, delivered, **facts)
    assert verdict.outcome is outcome and cause in verdict.cause
    result = result_of(tmp_path / "one" / "flight.mcap", verdict, delivered, facts.get("testimony"))
    log = log_of(tmp_path, result_table(result))
    assert ("delivered" in info(log).result) == (delivered is not None), "what has no meaning is not there"
    assert_all_say(log, verdict, capsys)
    print_end(result, as_json=False)
    assert verdict.sentence in capsys.readouterr().out
    print_end(result, as_json=False, verbose=True)
    assert "latency p99 us" in capsys.readouterr().out
    print_end(result, as_json=True)
    assert json.loads(capsys.readouterr().out)["outcome"] == verdict.text


def test_the_end_is_told_in_eight_rows_at_most_and_without_what_has_no_meaning() -> None:
    told = Testimony("a wall", 1, 0.02, True)
    traffic = Traffic(*[3] * 7)
    most = result_of(Path("flight.mcap"), Verdict(Outcome.CRASHED), False, told)
    most = dataclasses.replace(most, duration_s=65.0, traffic=traffic, records_dropped=7, missed_deadlines=2)
    rows = figures(most, Summary(120.0, None, (0.03, 0.04, 0.0), 0.5, 400.0, 900.0, 1000, 20))
    assert len(rows) == 8 and rows["flight time"] == "1:05, 65 times as fast as real time"
    assert rows["parcel"] == "not delivered" and rows["off the path"] == "5.0 cm (rms)"
    assert rows["nearest obstacle"] == "0.02 m, hit a wall" and rows["log"] == "7 records dropped"
    assert rows["link"] == "1000 messages from the vehicle, 3 lost" and rows["loop"].endswith("2 late ticks")
    least = figures(result_of(Path("flight.mcap"), Verdict(Outcome.FLOWN), None, None), EMPTY_SUMMARY)
    assert least == {"flight time": "0:01", "link": "0 messages from the vehicle, none lost"}


def test_the_last_words_are_where_the_flight_can_be_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_of(tmp_path, {"outcome": "flown", "cause": ""})
    print_next(log, report=True)
    said = capsys.readouterr().err
    assert f"report: {log.with_name('report.html')}\n" in said and log.with_name("report.html").stat().st_size > 1000
    assert f"  companion view {log}\n" in said and f"companion report {log}" not in said
    print_next(log, report=False)
    assert f"  companion report {log}\n" in capsys.readouterr().err
    log.unlink()
    for report in (True, False):
        print_next(log, report=report)
        said = capsys.readouterr().err
        assert "No such file" in said, "no reason to end otherwise than the flight"
        assert "look at it with" not in said


def test_a_log_without_its_end_is_judged_by_what_the_vehicle_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Old ones have no outcome, and cut ones nothing: whoever crashed in them has crashed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    old = {"delivered": "True", "landed": "True", "fault": ""}
    for number, (result, texts, state, expected) in enumerate(
        (
            (old, (), 4, Verdict(Outcome.DELIVERED)),
            ({**old, "delivered": "False"}, (), 4, Verdict(Outcome.FLOWN)),
            (old, ((0, "crash: hit ground"),), 4, Verdict(Outcome.CRASHED, "hit ground")),
            (old, ((2, "Low battery"),), 4, Verdict(Outcome.DELIVERED)),
            (old, ((0, "Motor 3 lost"),), 4, Verdict(Outcome.EMERGENCY, "Motor 3 lost")),
            (old, (), 5, Verdict(Outcome.EMERGENCY, "the vehicle reports a critical state")),
            (old, (), 6, Verdict(Outcome.CRASHED, "the vehicle reports an emergency")),
            ({**old, "fault": "no ring"}, (), 4, Verdict(Outcome.FAILED, "no ring")),
            ({**old, "fault": "called off in flight"}, (), 4, Verdict(Outcome.CALLED_OFF, "called off in flight")),
            ({**old, "landed": "False"}, (), 4, Verdict(Outcome.LOST, "the vehicle was not seen to land")),
            (None, (), 4, Verdict(Outcome.UNFINISHED)),
            (None, (), 6, Verdict(Outcome.CRASHED, "the vehicle reports an emergency")),
        )
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        log = told_log(folder, result, texts, state)
        assert info(log).verdict == expected, number
        if number in (2, 10):
            assert_all_say(log, expected, capsys)


def told_log(folder: Path, result: dict[str, str] | None, texts: Sequence[tuple[int, str]], state: int) -> Path:
    """A log in which the vehicle is in a critical state before it is armed, says `texts` in flight, and is disarmed in
    a `state` at last."""
    vehicle = Encoder(1, 1)
    beats = [(0, 5), (128, 4), (0, state)]

    def beat(mode: int, status: int) -> bytes:
        fields = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_PX4, mode, 0, status, 3
        return vehicle.encode_fields(dialect.MAVLink_heartbeat_message, *fields)

    def say(severity: int, text: str) -> bytes:
        return vehicle.encode_fields(dialect.MAVLink_statustext_message, severity, text.encode(), 0, 0)

    said = [say(0, "nothing before the flight"), *(beat(*each) for each in beats[:2]), *(say(*each) for each in texts)]
    tables = {"flight": {"mission": "made"}} | ({} if result is None else {"result": result})
    (folder / "one").mkdir()
    with Writer(folder / "one" / "flight.mcap", 0, tables) as writer:
        for number, data in enumerate((*said, beat(*beats[2]))):
            writer.datagram(number * SECOND, number, Direction.IN, "", data)
    return folder / "one" / "flight.mcap"


def test_the_words_of_the_table() -> None:
    """Each outcome is told twice above; its word is its own, and comes once."""
    told = [outcome for outcome, *_ in IN_FLIGHT + BEFORE]
    assert all(told.count(outcome) >= 2 for outcome in set(Outcome) - {Outcome.UNFINISHED})
    page = (Path(__file__).resolve().parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| ")]
    listed = {row[0].removeprefix("| "): row[1] for row in rows}
    for outcome in set(Outcome) - {Outcome.UNFINISHED}:
        assert listed[outcome.value] == ("0" if outcome.succeeded else "1")
    order = [word for word in listed if word in {outcome.value for outcome in Outcome}]
    assert order == [outcome.value for outcome in Outcome], "the last that applies counts"
    assert Verdict(Outcome.CALLED_OFF, "called off in flight").text == "called off in flight"
    assert Verdict(Outcome.CRASHED, "hit tree").text == "crashed: hit tree"
    assert recorded({}) is None
    succeeded = {outcome for outcome in Outcome if outcome.succeeded}
    assert succeeded == {Outcome.DELIVERED, Outcome.FLOWN}
    assert {outcome for outcome in Outcome if outcome.wanted} == succeeded | {Outcome.CALLED_OFF, Outcome.OPERATOR}


def test_nothing_makes_an_emergency_a_success() -> None:
    """Whatever else happens on the way."""
    for distress in (
        {"failsafe": True},
        {"plight": Plight(emergency="Battery empty: motors stop")},
        {"plight": FALLEN},
    ):
        for _, _, script, delivered, facts in IN_FLIGHT:
            struck = [*script[:-1], replace(script[-1], **distress)] if script else []
            supervisor = flown_out(struck, *flying())
            if struck:
                assert not judge(supervisor.verdict, delivered, **facts).outcome.succeeded
