"""The companion and the simulator as two processes, and the verdict on the flight."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.flight import Plan, PlanError, Result, end_table, fly, prepare
from companion.summary import Summary, summarize
from protocol.transport import Udp

_GRACE_S = 60.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """The flight as the companion, its log and the world's truth have it."""

    outcome: str
    """"delivered" or "flown" (a mission without a parcel), otherwise what happened, in one sentence."""
    succeeded: bool
    result: Result
    summary: Summary
    contacts: int
    least_clearance_m: float | None
    """True distance between the hull and the nearest obstacle; None where the world has none."""

    def table(self) -> dict[str, object]:
        """Names and values for a table or JSON."""
        least = None if self.least_clearance_m is None else round(self.least_clearance_m, 3)
        truth = {"contacts": self.contacts, "least_clearance_m": least}
        return {"outcome": self.outcome, **truth, **end_table(self.result, self.summary)}


def demo(plan: Plan, logs: Path, *, console: bool) -> Verdict:
    """Start the simulator, fly the plan against it, end it, and judge."""
    prepare(plan)  # before the simulator starts: the two would compile the same functions at the same time
    link = Udp("127.0.0.1", 0, bind=True)
    simulator = _start_simulator(plan, link.port)
    try:
        while not link.waiting(0.1):
            if simulator.poll() is not None:
                raise PlanError("the simulator did not start, for the reason above")
        result = fly(plan, link, logs, console=console)
    except BaseException:
        simulator.terminate()
        simulator.wait()
        raise
    finally:
        link.close()
    report = _end(simulator)
    return _judge(plan, result, report)


def _start_simulator(plan: Plan, port: int) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "vehicle_sim", "--once", "--bind", f"udpout:127.0.0.1:{port}"]
    command += ["--world", str(plan.files["world"]), "--vehicle", str(plan.files["vehicle"])]
    command += ["--pace", "realtime" if plan.pace == 1.0 else str(plan.pace), "--seed", str(plan.seed or 0)]
    # In a session of its own: Ctrl-C is for the companion, which lands the vehicle.
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)


def _end(simulator: "subprocess.Popen[str]") -> dict[str, Any]:
    """Its own report; it ends by itself after the flight."""
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
