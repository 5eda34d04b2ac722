"""A flight against the simulator, each in a process of its own, and the verdict on it."""

import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.runtime.flight import Plan, PlanError, Result, end_table, fly, prepare
from companion.runtime.summary import Summary, summarize
from companion.state import Output
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.toml_files import by_first_word
from protocol.transport import Udp

TRUTH_NAME = "truth.npy"
SIMULATOR_FILES = ("vehicle", "world")
"""First words of the overrides that only the simulator is told."""

_GRACE_S = 60.0
"""Time (s) that the simulator has to end after the flight."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A flight as the companion, its log and the simulator's ground truth report it."""

    outcome: str
    """"delivered", or "flown" for a mission without a parcel; otherwise what happened, in one sentence."""
    succeeded: bool
    result: Result
    summary: Summary
    contacts: int
    least_clearance_m: float | None
    """Least true distance between the hull and an obstacle (m); None if the world has none."""

    def table(self) -> dict[str, object]:
        """The verdict as names and values, for a table or JSON."""
        least = None if self.least_clearance_m is None else round(self.least_clearance_m, 3)
        truth = {"contacts": self.contacts, "least_clearance_m": least}
        return {"outcome": self.outcome, **truth, **end_table(self.result, self.summary)}


def demo(plan: Plan, logs: Path, *, console: bool, truth: bool = False, key: Path | None = None) -> Verdict:
    """Start the simulator, fly the plan against it, end it, and judge the flight.

    `key`: the file of signing, for both sides. `truth`: the simulator writes the true motion to truth.npy beside the
    log. Overrides of vehicle and world go to the simulator only. Raises PlanError and RehearsalError if the plan can't
    be flown, PlanError if the simulator does not start or can't write, KeyFileError, and FlightLogError if the log
    can't be written.
    """
    prepare(plan)  # before the simulator starts, or both would compile the same functions at the same time
    if not truth:
        return _fly_and_judge(plan, logs, None, key, console=console)
    with tempfile.TemporaryDirectory() as folder:  # the log's own folder is made after the simulator has answered
        file = Path(folder) / TRUTH_NAME
        verdict = _fly_and_judge(plan, logs, file, key, console=console)
        shutil.move(file, verdict.result.log.parent / TRUTH_NAME)
    return verdict


def _fly_and_judge(plan: Plan, logs: Path, truth: Path | None, key: Path | None, *, console: bool) -> Verdict:
    keeper = None if key is None else Keeper.of(key)
    link = Udp("127.0.0.1", 0, bind=True)
    simulator = _start_simulator(plan, link.port, truth, key)
    try:
        while not link.waiting(0.1):
            if simulator.poll() is not None:
                raise PlanError("the simulator did not start, for the reason above")
        result = fly(plan, GuardedLink(link, keeper), logs, console=console)
    except BaseException:
        simulator.terminate()
        simulator.wait()
        raise
    finally:
        link.close()
    report = _end(simulator)
    if truth is not None and simulator.returncode != 0:
        raise PlanError(f"{TRUTH_NAME}: the simulator could not write it, for the reason above")
    return _judge(plan, result, report)


def _start_simulator(plan: Plan, port: int, truth: Path | None, key: Path | None) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "vehicle_sim", "--once", "--bind", f"udpout:127.0.0.1:{port}"]
    command += ["--param", "NAV_DLL_ACT=3", "--firmware", "1.13" if plan.output is Output.ACTUATORS else "1.16"]
    command += ["--world", str(plan.files["world"]), "--vehicle", str(plan.files["vehicle"])]
    command += ["--pace", "realtime" if plan.pace == 1.0 else str(plan.pace), "--seed", str(plan.seed or 0)]
    command += [part for override in simulator_overrides(plan) for part in ("--set", override)]
    if truth is not None:
        command += ["--truth", str(truth)]
    if key is not None:
        command += ["--signing-key", str(key)]
    # The simulator has a session of its own, so that Ctrl-C reaches only the companion, which lands the vehicle.
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)


def simulator_overrides(plan: Plan) -> list[str]:
    """The overrides of the vehicle and the world, which the companion is not told."""
    groups = by_first_word(plan.overrides, SIMULATOR_FILES)
    return [f"{word}.{override}" for word in SIMULATOR_FILES for override in groups[word]]


def _end(simulator: "subprocess.Popen[str]") -> dict[str, Any]:
    """The report of the simulator, which ends by itself after the flight; empty if there is none."""
    try:
        text, _ = simulator.communicate(timeout=_GRACE_S)
    except subprocess.TimeoutExpired:
        simulator.terminate()
        text, _ = simulator.communicate()
    try:
        report: dict[str, Any] = json.loads(text.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return {}
    return report


def _judge(plan: Plan, result: Result, report: dict[str, Any]) -> Verdict:
    contacts = int(report.get("contacts", 0))
    delivers = plan.mission.delivery is not None
    if not report:
        outcome = "the simulator ended without a report"
    elif contacts:
        outcome = f"crashed: the vehicle hit {report.get('contact_with')}"
    elif result.fault is not None:
        outcome = result.fault
    elif delivers and not (result.delivered and report.get("released")):
        outcome = "the parcel was not delivered"
    elif report.get("outcome") != "landed":
        outcome = f"the vehicle did not land: {report.get('outcome')}"
    else:
        outcome = "delivered" if delivers else "flown"
    return Verdict(
        outcome,
        outcome in ("delivered", "flown"),
        result,
        summarize(result.log),
        contacts,
        report.get("least_clearance_m"),
    )
