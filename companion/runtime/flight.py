"""One flight from settings to result: everything is checked and opened before the vehicle is asked for anything."""

import json
import logging
import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import msgspec

from companion.autopilot import Autopilot
from companion.config import Settings
from companion.config_avoidance import Avoidance
from companion.link.bandwidth import fitted
from companion.link.vehicle_link import Traffic
from companion.mission.files import to_toml
from companion.mission.plan import Mission, all_delivered
from companion.outcomes import Outcome, Testimony, Verdict, judge
from companion.records import RECORD_TYPES
from companion.runtime.compiling import first_start, planner_compiled_beside
from companion.runtime.feasibility import PlanError as PlanError
from companion.runtime.feasibility import check_curves, check_gains, feasible, out_of_reach, within_reach
from companion.runtime.files import is_geodetic
from companion.runtime.planning import InProcessPlanner, PlannerBackend, PlannerProcess, Planning
from companion.runtime.plugin_time import refuse_slow_plugins
from companion.runtime.rehearsal import OpenField, rehearse
from companion.runtime.runner import TICK_NS, Runner
from companion.runtime.side_links import NONE, SideLinks, unheard
from companion.runtime.station_files import is_of_station
from companion.runtime.summary import Axes, Summary
from companion.state import Adoption, Output
from companion.supervision.states import State
from protocol import toml_files
from protocol.clock import RealClock
from protocol.compiling import compiling_shown
from protocol.flightlog import FlightLog, FlightLogError, RecorderProcess
from protocol.guarded_link import GuardedLink, inmost
from protocol.transport import Transport, bytes_per_s
from protocol.vehicle_parameters import VehicleParameters

Pace = Literal["lockstep"] | float
"""Lockstep, or how many times as fast as real time."""

AUTO = "auto"
"""The output of a plan that leaves it to the vehicle, in words."""
LIBRARIES = ("control", "mcap", "numba", "numpy", "pymavlink", "ruckig", "scipy")


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be flown, read and checked."""

    settings: Settings
    body: VehicleParameters
    mission: Mission
    output: Output | None
    """None: chosen once the vehicle's parameters are known."""
    pace: Pace
    files: Mapping[str, Path]
    """Mission, vehicle and world, as they were found: attached to the log."""
    seed: int | None = None
    overrides: tuple[str, ...] = ()
    """All of `--set`, for the log; settings and mission have theirs already."""
    adoption: Adoption | None = None
    """A vehicle in flight is taken over, for this."""
    connect: str = ""
    """The vehicle's URL or name, as it was asked for."""
    planner: PlannerProcess | None = None
    """The planner's process,"""
    recorder: RecorderProcess | None = None
    """and the log's, if they were started already (`prepare`)."""


@dataclass(frozen=True, slots=True)
class Result:
    """How it ended."""

    verdict: Verdict
    delivered: bool | None
    """None: there was nothing to deliver."""
    landed: bool | None
    """Disarmed, as the vehicle says, and neither crashed nor lost; None: it was not flown."""
    testimony: Testimony | None
    """What the simulator knows of it."""
    log: Path
    output: Output
    duration_s: float
    """The flight's time: from the first event to the last, on the companion's clock; also where the log does not reach
    so far."""
    wall_s: float
    traffic: Traffic
    refused: Mapping[str, int]
    """Frames by the reason for which signing refused them; empty without a key."""
    implausible: Mapping[str, int]
    """Attitudes and positions, and rings, that well-formed messages brought and nobody believed."""
    missed_deadlines: int
    records_dropped: int
    """The recorder was too slow for them,"""
    records_lost: int
    """or could not write them."""
    log_fault: str | None


def prepare(plan: Plan) -> Plan:
    """Check the plan and rehearse it, so that all is compiled; the plan with the processes of planner and log, which
    get ready meanwhile. Raises PlanError, RehearsalError and PluginError."""
    check(plan)
    settings, recorder = plan.settings, RecorderProcess()
    with compiling_shown():
        compiles_all = first_start()
        check_gains(settings, plan.body, plan.output)
        if compiles_all and settings.avoidance.looks_around:
            straight = msgspec.structs.replace(settings, avoidance=settings.avoidance.by("none"))
            with planner_compiled_beside(settings.avoidance):
                rehearse(straight, plan.body, plan.mission, plan.output)
        planner = PlannerProcess(settings.avoidance) if _has_planner_process(plan) else None
        rehearse(settings, plan.body, plan.mission, plan.output, planner_to_rehearse_with(plan))
    if plan.pace != "lockstep":
        outputs = (Output.ATTITUDE, Output.RATES) if plan.output is None else (plan.output,)
        refuse_slow_plugins(settings.control, outputs, TICK_NS * 1e-9 / plan.pace)
    return replace(plan, planner=planner, recorder=recorder)


def planner_to_rehearse_with(plan: Plan) -> Callable[[Avoidance], PlannerBackend]:
    """The one that flies, unless it has a process of its own, where it is rehearsed; one of another package in any
    case: what is wrong with it is said here."""
    apart = _has_planner_process(plan) and plan.settings.avoidance.plugin is None
    return OpenField if apart else InProcessPlanner


def _has_planner_process(plan: Plan) -> bool:
    return plan.pace != "lockstep" and plan.settings.avoidance.looks_around


def _planning(plan: Plan) -> Planning:
    avoidance = plan.settings.avoidance
    if not _has_planner_process(plan):
        return Planning(InProcessPlanner(avoidance), avoidance.answer_delay)
    return Planning(plan.planner or PlannerProcess(avoidance), None)


def check(plan: Plan) -> None:
    """Raises PlanError for what can be known before any vehicle is there."""
    feasible(plan.settings, plan.body, plan.mission, plan.output)


def softened(plan: Plan) -> tuple[Plan, list[str]]:
    """See `feasibility.within_reach`, `check_curves` and `out_of_reach`, of a plan that was checked."""
    settings, slower = within_reach(plan.settings, plan.body)
    first_start()  # asked, and remembered, before anything is compiled
    check_curves(settings, plan.mission)
    beyond = out_of_reach(settings, plan.body, plan.mission)
    return replace(plan, settings=settings), [note for note in (slower, beyond) if note]


def fitted_to(plan: Plan, transport: Transport) -> tuple[Plan, str]:
    """The plan with telemetry rates that the link carries, and what that changed, in words; PlanError if it carries no
    flight."""
    capacity, rates = bytes_per_s(inmost(transport)), plan.settings.rates
    signed = isinstance(transport, GuardedLink) and transport.signed
    if capacity is None:
        return plan, ""
    try:
        slower = fitted(rates, capacity, scans=plan.settings.avoidance.needs_scan, signed=signed)
    except ValueError as error:
        raise PlanError(f"the link to the vehicle is too slow: {error}; raise its baud rate") from None
    if slower == rates:
        return plan, ""
    note = (
        f"the link carries {capacity:.0f} bytes a second: attitude at {slower.attitude:.0f}, position at "
        f"{slower.position:.0f}, rings at {slower.scan:.0f}, odometry at {slower.odometry:.0f} Hz"
    )
    return replace(plan, settings=msgspec.structs.replace(plan.settings, rates=slower)), note


def fly(
    plan: Plan,
    transport: Transport,
    logs: Path,
    *,
    console: bool,
    beside: SideLinks = NONE,
    witness: Callable[[], Testimony] | None = None,
    opened: Callable[[Path], None] | None = None,
) -> Result:
    """Fly a prepared plan and leave a log in a new folder of `logs`. `witness` is heard before the log is closed,
    `opened` is told where the log is.

    Raises FlightLogError, before anything is sent, if the log can't be written.
    """
    plan, note = fitted_to(plan, transport)
    with closing(_planning(plan)) as planning:
        autopilot = Autopilot(plan.settings, plan.body, plan.mission, plan.output, plan.adoption)
        began = time.time()
        clock = None if plan.pace == "lockstep" else RealClock(plan.pace)
        log = _open_log(
            new_folder(logs, plan.mission.name, began),
            metadata={"flight": {**_metadata(plan, began), "whole_datagrams": str(transport.preserves_datagrams)}},
            attachments=_attachments(plan),
            types=RECORD_TYPES,
            on_full="wait" if clock is None else "drop",
            console=console,
            epoch_ns=round(began * 1e9),
            preserves_datagrams=transport.preserves_datagrams,
            recorder=plan.recorder,
        )
        if opened is not None:
            opened(log.path)
        if note:
            log.text(0, logging.INFO, "companion", note)
        runner = Runner(autopilot, transport, log, clock, planning, console=console, beside=beside)
        wall, wall_s, testimony = time.monotonic(), 0.0, None
        try:
            try:
                runner.run()
            finally:
                wall_s = time.monotonic() - wall
            testimony = None if witness is None else witness()
        finally:
            result = _result(plan, autopilot, runner, log, transport, testimony, wall_s)
            tables = {"result": result_table(result), "vehicle": _vehicle(autopilot)}
            log.close({name: {key: str(value) for key, value in table.items()} for name, table in tables.items()})
    return replace(result, log_fault=log.fault, records_lost=log.lost)


def _open_log(folder: Path, **options: Any) -> FlightLog:
    """A log in a new folder, of which nothing is left if there is none."""
    try:
        return FlightLog.open(folder, **options)
    except FlightLogError:
        with suppress(OSError):
            folder.rmdir()
        raise


def _result(
    plan: Plan,
    autopilot: Autopilot,
    runner: Runner,
    log: FlightLog,
    transport: Transport,
    testimony: Testimony | None,
    wall_s: float,
) -> Result:
    """How it came out, which the log is told, too."""
    verdict, delivered = _judge(plan, autopilot, runner, testimony)
    runner.say(logging.INFO if verdict.outcome.wanted else logging.CRITICAL, f"outcome: {verdict.text}")
    landed = verdict.outcome.leaves_it_whole and not autopilot.link.said.status.armed
    return Result(
        verdict=verdict,
        delivered=delivered,
        landed=landed if autopilot.supervisor.flew else None,
        testimony=testimony,
        log=log.path,
        output=autopilot.link.readiness.output,
        duration_s=runner.flown_s,
        wall_s=wall_s,
        traffic=traffic_of(autopilot, transport),
        refused=transport.refused if isinstance(transport, GuardedLink) else {},
        implausible=autopilot.sensing.implausible,
        missed_deadlines=runner.missed_deadlines,
        records_dropped=log.dropped,
        records_lost=log.lost,
        log_fault=log.fault,
    )


def traffic_of(autopilot: Autopilot, transport: Transport) -> Traffic:
    """The link's counts; with a key, what is no frame ends in front of the autopilot."""
    traffic = autopilot.link.traffic
    beyond = transport.bad_frames if isinstance(transport, GuardedLink) else 0
    return replace(traffic, frames_bad=traffic.frames_bad + beyond)


def _judge(
    plan: Plan, autopilot: Autopilot, runner: Runner, testimony: Testimony | None
) -> tuple[Verdict, bool | None]:
    """The verdict, and whether each parcel was delivered, if there was one to deliver."""
    navigator, lands = autopilot.navigator, plan.adoption is Adoption.LAND
    delivered = None if lands else all_delivered(plan.mission, navigator.steps, navigator.released)
    found = autopilot.supervisor.verdict
    if found is not None and found.outcome is Outcome.NOT_STARTED and autopilot.link.vehicle is None and plan.connect:
        where = unheard(plan.connect, plan.settings.identity.vehicle)
        found = msgspec.structs.replace(found, cause=f"{found.cause} at {where}")
    supervisor, failure = autopilot.supervisor, runner.failure
    began = supervisor.flew or supervisor.state in (State.ARM, State.DISARM)
    return judge(found, delivered, testimony, failure=failure, ended=autopilot.ended, began=began), delivered


def _ending(result: Result) -> dict[str, object]:
    """How it came out, without what has no meaning for the flight."""
    told = result.testimony
    ending: dict[str, object] = {"delivered": result.delivered, "landed": result.landed}
    if told is not None and not told.problem:
        least = None if told.least_clearance_m is None else round(told.least_clearance_m, 3)
        ending |= {"contacts": told.contacts, "least_clearance_m": least}
    return {name: value for name, value in ending.items() if value is not None}


def result_table(result: Result) -> dict[str, object]:
    """The log's metadata "result"."""
    return {
        "outcome": result.verdict.outcome.value,
        "cause": result.verdict.cause,
        **_ending(result),
        "output": result.output.value,
        **asdict(result.traffic),
        **result.refused,
        **result.implausible,
        "missed_deadlines": result.missed_deadlines,
        "ended_unix_s": time.time(),
    }


def _vehicle(autopilot: Autopilot) -> dict[str, object]:
    """Firmware and parameters of the vehicle that was flown."""
    firmware, readiness = autopilot.link.firmware, autopilot.link.readiness
    if firmware is None or readiness.audit is None:
        return {}
    values = {each.parameter: "" if each.value is None else f"{each.value:g}" for each in readiness.audit.findings}
    return {"firmware": firmware.name, "version": version_text(readiness.version), **values}


def version_text(version: int | None) -> str:
    """AUTOPILOT_VERSION.flight_sw_version as people write it."""
    return "" if version is None else ".".join(str(version >> shift & 0xFF) for shift in (24, 16, 8))


def end_table(result: Result, summary: Summary) -> dict[str, object]:
    """What is known of a flight, for a table or JSON; per axis north, east, down.

    What is measured along the flight is as the log has it: where that was cut, up to there.
    """
    factor = result.duration_s / result.wall_s if result.wall_s else None
    return {
        "outcome": result.verdict.text,
        **_ending(result),
        "duration_s": _rounded(result.duration_s, 3),
        "wall_s": _rounded(result.wall_s, 3),
        "real_time_factor": _rounded(factor, 2),
        "distance_m": _rounded(summary.distance_m, 1),
        "tracking_mae_m": _axes(summary.mae_m),
        "tracking_rmse_m": _axes(summary.rmse_m),
        "seen_clearance_m": _rounded(summary.seen_clearance_m, 3),
        "messages_in": summary.messages_in,
        "messages_out": summary.messages_out,
        **asdict(result.traffic),
        **result.refused,
        **result.implausible,
        "latency_p50_us": _rounded(summary.latency_p50_us, 1),
        "latency_p99_us": _rounded(summary.latency_p99_us, 1),
        "missed_deadlines": result.missed_deadlines,
        "log_records_dropped": result.records_dropped,
        "log_records_lost": result.records_lost,
        "log_fault": result.log_fault,
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _axes(values: Axes | None) -> list[float | None] | None:
    return None if values is None else [_rounded(value, 4) for value in values]


def new_folder(logs: Path, name: str, began: float) -> Path:
    """`<start time>_<name>`, made, with a number behind it if several flights start in one second. Why it can't be,
    the log says."""
    stem = time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(began)) + f"_{name}"
    folder, number = logs / stem, 1
    while _is_taken(folder):
        number += 1
        folder = logs / f"{stem}_{number}"
    return folder


def _is_taken(folder: Path) -> bool:
    """By another flight, perhaps at this moment; otherwise it is made now."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        return os.path.lexists(folder)
    except OSError:
        return False
    return False


def _metadata(plan: Plan, began: float) -> dict[str, str]:
    return {
        "mission": plan.mission.name,
        "output": AUTO if plan.output is None else plan.output.value,
        "pace": str(plan.pace),
        "seed": "" if plan.seed is None else str(plan.seed),
        "overrides": json.dumps(plan.overrides),
        "connect": plan.connect,
        "adopted": "" if plan.adoption is None else plan.adoption.value,
        "started_unix_s": repr(began),
        "host": platform.platform(),
        "cpus": str(os.cpu_count()),
        "python": platform.python_version(),
        "git": git_hash(),
        "courier": metadata.version("courier-autopilot"),
        **{library: metadata.version(library) for library in LIBRARIES},
        **{each.kind.value: each.text for each in plan.settings.plugins},
    }


def git_hash() -> str:
    """The hash of the checkout that this runs from, "+" behind it if it was changed; empty outside one."""
    command = ["git", "--no-optional-locks", "-C", str(toml_files.ROOT), "status", "--porcelain=v2", "--branch", "-uno"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, ValueError, subprocess.SubprocessError):
        return ""
    lines = done.stdout.splitlines()
    changed = any(not line.startswith("#") for line in lines)
    return next((line.split()[-1] for line in lines if line.startswith("# branch.oid ")), "") + "+" * changed


def _attachments(plan: Plan) -> dict[str, bytes]:
    files = {f"{kind}.toml": toml_files.content(path) for kind, path in plan.files.items()}
    mission = plan.files["mission"]
    if is_geodetic(str(mission)):  # kept as it is, beside what was made of it
        name = mission.name if is_of_station(mission.name) else "mission.geodetic.toml"
        files |= {name: mission.read_bytes(), "mission.toml": to_toml(plan.mission).encode()}
    return {**files, "settings.json": msgspec.json.encode(plan.settings)}
