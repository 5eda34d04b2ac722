"""A flight against the simulator, each in a process of its own."""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from companion.outcomes import Testimony
from companion.runtime.compiling import first_start
from companion.runtime.flight import Plan, PlanError, Result, fly, prepare
from companion.runtime.side_links import NAMES
from companion.state import Output
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.toml_files import by_first_word
from protocol.transport import Udp

TRUTH_NAME = "truth.npy"
SIMULATOR_FILES = ("vehicle", "world")
"""First words of the overrides that only the simulator is told."""

_SIMULATOR = (sys.executable, "-m", "vehicle_sim")
_REFUSAL = "vehicle-sim: "
"""How a line of the simulator begins that says what it can't do."""
_GRACE_S = 60.0
"""Time (s) that the simulator has to end after the flight."""
_PARAMETERS = (
    "NAV_DLL_ACT=3",
    # The companion's clock is the vehicle's, at any pace: the times of the failsafes are not to be scaled.
    "COM_OF_LOSS_T=1",
    "COM_DL_LOSS_T=10",
    # Below the companion's own limits: the second net.
    "BAT_CRIT_THR=0.05",
    "BAT_EMERGEN_THR=0.03",
)
"""Parameters of the simulator: the vehicle's failsafes."""


def prepare_both(plan: Plan, stations: Sequence[str]) -> Plan:
    """The plan checked and rehearsed (`flight.prepare`), and the simulator compiled. `stations`: see `demo`. Raises
    PlanError and RehearsalError if the plan can't be flown."""
    if stations and plan.pace == "lockstep":
        raise PlanError("--gcs: not with --pace lockstep, in which time is the companion's alone; --pace realtime")
    with _simulator_compiled_beside(plan):
        return prepare(plan)


def demo(
    plan: Plan,
    logs: Path,
    *,
    console: bool,
    truth: bool = False,
    key: Path | None = None,
    stations: Sequence[str] = (),
    opened: Callable[[Path], None] | None = None,
) -> Result:
    """Start the simulator, fly the prepared plan against it, and end it.

    `key`: the file of signing, for both sides. `stations`: URLs or names of ground stations, to which the vehicle shows
    itself. `truth`: the simulator writes the true motion to truth.npy beside the log. `opened` is told where the log
    is. Overrides of vehicle and world go to the simulator only. Raises PlanError if the simulator does not start,
    KeyFileError, and FlightLogError if the log can't be written.
    """
    if not truth:
        return _fly(plan, logs, None, key, stations, console=console, opened=opened)
    with tempfile.TemporaryDirectory() as folder:  # the log's own folder is made after the simulator has answered
        file = Path(folder) / TRUTH_NAME
        result = _fly(plan, logs, file, key, stations, console=console, opened=opened)
        _keep(file, result.log.parent / TRUTH_NAME)
    return result


def _keep(file: Path, whole: Path) -> None:
    """Move a file to its place, whole or not at all. Where that fails it is said: the flight is flown."""
    draft = whole.with_suffix(".part")
    try:
        if not file.exists():
            raise FileNotFoundError(None, "the simulator could not write it, for the reason above")
        shutil.move(file, draft)
        draft.rename(whole)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        sys.stderr.write(f"companion: {whole}: {error.strerror}\n")


def _fly(
    plan: Plan,
    logs: Path,
    truth: Path | None,
    key: Path | None,
    stations: Sequence[str],
    *,
    console: bool,
    opened: Callable[[Path], None] | None,
) -> Result:
    keeper = None if key is None else Keeper.of(key)
    link = Udp("127.0.0.1", 0, bind=True)
    simulator = _start_simulator(plan, link.port, truth, key, stations)
    try:
        while not link.waiting(0.1):
            if simulator.poll() is not None:
                raise PlanError("the simulator did not start, for the reason above")
        witness, end = (lambda: _testimony(simulator)), GuardedLink(link, keeper)
        result = fly(plan, end, logs, console=console, witness=witness, opened=opened)
    except BaseException:
        simulator.terminate()
        simulator.wait()
        raise
    finally:
        link.close()
    if truth is not None and simulator.returncode != 0:
        truth.unlink(missing_ok=True)
    return result


@contextmanager
def _simulator_compiled_beside(plan: Plan) -> Iterator[None]:
    """A block during which the simulator compiles its own code, at the first start on a machine.

    Raises PlanError for what it refuses of the overrides that it alone is told: it says so before it compiles.
    """
    if not first_start():
        yield
        return
    # The companion's two processes, which take longer and wait for each other, go first.
    command = ["nice", "-n", "5", *_SIMULATOR, "--warm-up", *_model(plan)]
    compiler = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert compiler.stderr is not None
        told = compiler.stderr.readline() if simulator_overrides(plan) else ""
        if told.startswith(_REFUSAL):
            raise PlanError(told.removeprefix(_REFUSAL).strip())
        yield
        compiler.wait()
    finally:
        compiler.kill()
        compiler.wait()


def _model(plan: Plan) -> list[str]:
    """The options that name the vehicle and the world."""
    return ["--world", str(plan.files["world"]), "--vehicle", str(plan.files["vehicle"])] + [
        part for override in simulator_overrides(plan) for part in ("--set", override)
    ]


def _start_simulator(
    plan: Plan, port: int, truth: Path | None, key: Path | None, stations: Sequence[str]
) -> "subprocess.Popen[str]":
    command = [*_SIMULATOR, "--once", "--bind", f"udpout:127.0.0.1:{port}", *_model(plan)]
    command += [part for each in _PARAMETERS for part in ("--param", each)]
    command += ["--firmware", "1.13" if plan.output is Output.ACTUATORS else "1.16"]
    command += ["--pace", "realtime" if plan.pace == 1.0 else str(plan.pace), "--seed", str(plan.seed or 0)]
    command += [part for station in stations for part in ("--gcs", NAMES.get(station, station))]
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


def _testimony(simulator: "subprocess.Popen[str]") -> Testimony:
    report = _end(simulator)
    if not report:
        return Testimony(problem="the simulator ended without a report")
    return Testimony(
        contact_with=report["contact_with"],
        contacts=report["contacts"],
        least_clearance_m=report["least_clearance_m"],
        released=report["released"],
        landed=report["outcome"] == "landed" or report["flight_time_s"] == 0.0,
    )
