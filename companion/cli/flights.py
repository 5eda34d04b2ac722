"""The commands that fly: demo, fly."""

import json
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from companion.avoidance_methods import listed
from companion.cli.ending import print_end, print_next
from companion.cli.options import Insecure, options
from companion.cli.shell import (
    exit_as_failed,
    exit_as_undone,
    exit_as_unusable,
    exit_on_interrupt,
    exit_on_user_error,
    leave_gone_readers,
    note,
    say,
    told_if_there_is_room,
)
from companion.cli.values import avoided_by, output_of, pace_of, pinned

if TYPE_CHECKING:
    from companion.mission.files import Place
    from companion.outcomes import Verdict
    from companion.runtime.flight import Plan
    from companion.runtime.side_links import Security, SideLinks
    from companion.state import Adoption
    from protocol.transport import Transport

MissionName = Annotated[
    str,
    typer.Argument(
        help="A file in missions/, by name or path; a .plan of QGroundControl or a .waypoints of Mission Planner."
    ),
]
OutputName = Annotated[
    str,
    typer.Option(
        "--output",
        help="The lowest layer commanded: attitude, rates or actuators (torques). auto: rates where the vehicle drops "
        "the last setpoint within 0.3 s when the companion dies (COM_OF_LOSS_T, GUID_TIMEOUT), attitude elsewhere.",
    ),
]
ConnectUrl = Annotated[
    str,
    typer.Option(
        "--connect",
        help="px4 (udpin:127.0.0.1:14540), ardupilot (udpin:127.0.0.1:14550), udpin:HOST:PORT, udpout:HOST:PORT, "
        "tcp:HOST:PORT (ArduPilot's SITL: tcp:127.0.0.1:5760), tcpin:HOST:PORT, "
        "serial:DEVICE:BAUD (serial:/dev/ttyACM0:921600).",
    ),
]
KeyFile = Annotated[
    Path | None,
    typer.Option(
        "--signing-key",
        help="A file with the key of MAVLink 2 signing (companion key FILE makes one): every message is signed, and of "
        "what comes only signed ones are taken.",
        metavar="FILE",
    ),
]
VehicleSystem = Annotated[
    int | None,
    typer.Option("--vehicle", help="The system id of the vehicle; no other is flown.", metavar="SYSID", min=1, max=255),
]
STORED = "vehicle"
"""In place of a mission: the vehicle's own."""
DEFAULT_URL = "udpin:127.0.0.1:14540"
_GETTING_READY = "getting ready"
PaceName = Annotated[
    str, typer.Option("--pace", help="realtime, lockstep (as fast as it goes, repeatable), or a factor such as 4.")
]
LogFolder = Annotated[Path, typer.Option("--log", help="The folder in which the flight's own folder is made.")]
SettingsFile = Annotated[Path | None, typer.Option("--settings", help="A TOML file of settings (docs/settings.md).")]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change one setting, or with mission. before it a key of the mission's file: "
        "--set avoidance.lateral_margin=2.5 --set mission.speed=8",
        metavar="KEY=VALUE",
    ),
]
DemoOverrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change one setting, or with vehicle., world. or mission. before it a key of that file: "
        "--set avoidance.lateral_margin=2.5 --set vehicle.body.mass_kg=0.9. What is changed in vehicle and world "
        "the simulator alone is told: the companion goes on to think that they are as the files say.",
        metavar="KEY=VALUE",
    ),
]
MethodName = Annotated[
    str | None,
    typer.Option(
        "--avoid",
        help=f"{listed()}: short for --set avoidance.method=...",
        metavar="METHOD",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print all figures at the end as one JSON object.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print all figures at the end, not the eight of most use.")]
Report = Annotated[bool, typer.Option(help="Write report.html beside the log.")]


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """What `companion demo` is asked for."""

    mission: MissionName = "courier"
    output: OutputName = "rates"
    pace: Annotated[
        str | None,
        typer.Option(
            "--pace",
            help="realtime, lockstep (as fast as it goes, repeatable), or a factor such as 4. Lockstep if it is not "
            "given, and realtime with --gcs.",
        ),
    ] = None
    avoid: MethodName = None
    sensors: Annotated[
        str | None,
        typer.Option(
            "--sensors",
            help="What the vehicle flies on: gnss, rtk, vio, perfect (it knows the truth), or a file. gnss where the "
            "vehicle's file names none.",
            metavar="NAME",
        ),
    ] = None
    seed: Annotated[int, typer.Option(help="Of the simulator's noise.", min=0)] = 1
    log: LogFolder = Path("logs")
    settings: SettingsFile = None
    overrides: DemoOverrides = None
    signing_key: KeyFile = None
    truth: Annotated[
        bool, typer.Option("--truth", help="Leave the true motion of every tick beside the log, as truth.npy.")
    ] = False
    gcs: Annotated[
        list[str] | None,
        typer.Option(
            "--gcs",
            help="A ground station to which the vehicle shows itself, not in lockstep: qgc (where QGroundControl "
            "listens, udpout:127.0.0.1:14550), or a URL; as often as wanted.",
            metavar="URL",
        ),
    ] = None
    report: Report = True
    as_json: AsJson = False
    verbose: Verbose = False


@dataclass(frozen=True, slots=True)
class FlyOptions:
    """What `companion fly` is asked for."""

    mission: MissionName = ""
    named: Annotated[
        str,
        typer.Option(
            "--mission",
            help=f"MISSION, as an option; {STORED}: the one that the vehicle has stored, which is downloaded.",
            metavar="MISSION",
        ),
    ] = ""
    connect: ConnectUrl = DEFAULT_URL
    vehicle: VehicleSystem = None
    signing_key: KeyFile = None
    insecure: Insecure = False
    output: OutputName = "auto"
    gcs: Annotated[
        list[str] | None,
        typer.Option(
            "--gcs",
            help="A ground station that watches and commands beside the companion, as often as wanted: qgc (where "
            "QGroundControl listens, udpout:127.0.0.1:14550), or a URL as of --connect; tcpin:HOST:PORT waits for one.",
            metavar="URL",
        ),
    ] = None
    lidar: Annotated[
        str | None,
        typer.Option(help="A URL by which a scanner's driver sends OBSTACLE_DISTANCE (docs/lidar.md).", metavar="URL"),
    ] = None
    pace: PaceName = "realtime"
    avoid: MethodName = None
    log: LogFolder = Path("logs")
    settings: SettingsFile = None
    overrides: Overrides = None
    adopt: Annotated[
        bool,
        typer.Option(
            "--adopt",
            help="Take over a vehicle that is in the air: hold, then fly what is left of the mission, from the nearest "
            "step on. Without it an armed vehicle is refused.",
        ),
    ] = False
    orders: Annotated[
        bool,
        typer.Option(
            "--orders",
            help="Take orders on standard input (docs/api.md), with a mission that waits for them. Its end lands.",
        ),
    ] = False
    land: Annotated[bool, typer.Option("--land", help="With --adopt: land the vehicle where it is.")] = False
    report: Report = True
    as_json: AsJson = False
    verbose: Verbose = False


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    for command in (demo, fly):
        app.command()(command)


@options(DemoOptions)
def demo(asked: DemoOptions) -> None:
    """Fly MISSION against the simulator, both started here as processes of their own, and print how it went."""
    with _abandoned():
        plan = exit_on_user_error(_plan, asked, asked.seed)
        say(_GETTING_READY)
        from companion.runtime.demo import demo as fly_demo
        from companion.runtime.demo import prepare_both

        plan = exit_on_user_error(prepare_both, plan, asked.gcs or ())
    logs: list[Path] = []
    with _abandoned(logs=logs):
        result = exit_on_user_error(
            fly_demo,
            plan,
            asked.log,
            console=True,
            truth=asked.truth,
            key=asked.signing_key,
            stations=asked.gcs or (),
            opened=logs.append,
        )
    leave_gone_readers()
    with told_if_there_is_room():
        print_end(result, as_json=asked.as_json, verbose=asked.verbose)
    with _abandoned(), told_if_there_is_room():
        print_next(result.log, report=asked.report)
    _exit_by(result.verdict)


@options(FlyOptions)
def fly(asked: FlyOptions) -> None:
    """Fly MISSION with the vehicle that answers at a URL. Ctrl-C lands it."""
    if bool(asked.mission) is bool(asked.named):
        exit_as_unusable("name one mission: companion fly MISSION, or companion fly --mission MISSION")
    asked = replace(asked, mission=asked.mission or asked.named)
    with TemporaryDirectory(prefix="companion-") as folder:  # of a mission that is downloaded, until the log has it
        _fly(asked, Path(folder))


def _fly(asked: FlyOptions, folder: Path) -> None:
    with _abandoned():
        plan, adoption = exit_on_user_error(_plan, asked, None), exit_on_user_error(_adoption, asked)
        plan = replace(plan, adoption=adoption, connect=asked.connect)
        from companion.runtime.files import is_geodetic
        from companion.runtime.flight import fly as fly_plan
        from companion.runtime.flight import prepare
        from companion.runtime.side_links import open_vehicle_link
        from protocol.guarded_link import inmost
        from protocol.transport import Udp

        security = exit_on_user_error(security_of, asked.signing_key, asked.insecure)
        wanted, lockstep = plan.settings.identity.vehicle, plan.pace == "lockstep"
        transport = exit_on_user_error(open_vehicle_link, asked.connect, security, wanted, lockstep=lockstep)
        beside = exit_on_user_error(_beside, asked, transport, security)
        say(_GETTING_READY)
        if asked.mission == STORED or is_geodetic(asked.mission):
            plan = exit_on_user_error(_located, asked, plan, transport, folder)
        plan = exit_on_user_error(prepare, plan)
        end = inmost(transport)
        if isinstance(end, Udp) and asked.connect.endswith(":0"):
            say(f"companion: waiting at {asked.connect[:-1]}{end.port}")
        for place in beside.places():
            say(f"companion: {place}")
    logs: list[Path] = []

    def opened(log: Path) -> None:
        logs.append(log)
        if asked.orders:
            _say_log(log)

    with _abandoned("; a vehicle in the air holds and lands by itself", logs):
        result = exit_on_user_error(fly_plan, plan, transport, asked.log, console=True, beside=beside, opened=opened)
    leave_gone_readers()
    if result.landed is not None or asked.as_json:
        with told_if_there_is_room():
            print_end(result, as_json=asked.as_json, verbose=asked.verbose)
        with _abandoned(), told_if_there_is_room():
            print_next(result.log, report=asked.report and result.landed is not None)
    _exit_by(result.verdict)


def _say_log(log: Path) -> None:
    from companion.runtime.orders import LOG_AT

    say(f"{LOG_AT}{log}")


def _located(asked: FlyOptions, plan: "Plan", transport: "Transport", folder: Path) -> "Plan":
    """The plan around where the vehicle stands, or took off if it is taken over in flight. If its own mission is asked
    for, that gets a file in `folder`. Raises PlanError, TomlFileError and TransportError."""
    from companion.mission.files import MissionFileError, to_waypoints
    from companion.runtime.flight import PlanError
    from companion.runtime.locate import download, locate
    from companion.runtime.side_links import unheard

    if plan.pace == "lockstep":
        raise PlanError(f"{asked.mission}: not with --pace lockstep; companion demo flies files so")
    try:
        place = locate(plan.settings, transport, home=asked.adopt)
    except MissionFileError as error:
        raise PlanError(f"{error} at {unheard(asked.connect, plan.settings.identity.vehicle)}") from error
    if place is None:
        where = "took off (HOME_POSITION)" if asked.adopt else "stands (GLOBAL_POSITION_INT)"
        raise PlanError(f"{asked.mission}: the vehicle does not say where on earth it {where}")
    if asked.mission == STORED:
        try:
            file = download(plan.settings, transport, place)
        except MissionFileError as error:
            raise PlanError(f"the vehicle's mission: {error}") from error
        path = folder / f"{STORED}.waypoints"
        path.write_text(to_waypoints(file), encoding="utf-8")
        say(f"companion: downloaded the vehicle's mission, {len(file.items)} items")
        asked = replace(asked, mission=str(path))
    return replace(_plan(asked, None, place), adoption=plan.adoption, connect=plan.connect)


def _exit_by(verdict: "Verdict") -> None:
    """End with exit code 1 unless the mission was done, and say how it came out."""
    if verdict.outcome.succeeded:
        return
    if verdict.outcome.wanted:
        exit_as_undone(verdict.text)
    exit_as_failed(verdict.text)


def security_of(key: Path | None, insecure: bool) -> "Security":
    """What links are opened with. Raises KeyFileError."""
    from companion.runtime.side_links import Security
    from protocol.key_files import Keeper

    return Security(None if key is None else Keeper.of(key), insecure)


def _beside(asked: FlyOptions, transport: "Transport", security: "Security") -> "SideLinks":
    """Open what is beside the vehicle's link. Raises TransportError and PlanError."""
    from companion.runtime.flight import PlanError
    from companion.runtime.orders import Orders
    from companion.runtime.side_links import open_side_links

    if asked.orders and sys.stdin is None:
        raise PlanError("--orders: standard input is closed")
    if asked.pace == "lockstep" and (asked.gcs or asked.lidar):
        raise PlanError("--gcs and --lidar: not with --pace lockstep, in which time is the vehicle's alone")
    beside = open_side_links(transport, asked.gcs or (), asked.lidar, security)
    if asked.orders:
        beside.orders = Orders(sys.stdin.fileno())
    return beside


def _abandoned(consequence: str = "", logs: Sequence[Path] = ()) -> AbstractContextManager[None]:
    """Ends the program at an interrupt, which has this consequence, and says which `logs` there are by then."""

    def say_logs() -> None:
        for log in logs:
            say(f"log, as far as it got: {log}")

    return exit_on_interrupt(f"companion: abandoned{consequence}", say_logs)


def _plan(asked: DemoOptions | FlyOptions, seed: int | None, place: "Place | None" = None) -> "Plan":
    """Read and check all that a flight needs. `seed`: the simulator's; None for a vehicle that is no simulator of ours.
    `place`: where the vehicle stands, for a mission with places on earth.

    Raises TomlFileError and PlanError.
    """
    from companion.mission.plan import Mission
    from companion.runtime.demo import SIMULATOR_FILES
    from companion.runtime.files import at_pad, load_body, load_mission, load_settings
    from companion.runtime.flight import Plan, PlanError, check, softened
    from companion.runtime.station_files import fenced, is_of_station, load_of_station
    from protocol import toml_files

    overrides = list(asked.overrides or ())
    if isinstance(asked, FlyOptions):
        overrides += pinned(asked.vehicle)
    elif asked.sensors is not None:
        overrides.insert(0, f"vehicle.estimator.sensors={json.dumps(asked.sensors)}")
    if asked.avoid is not None:  # the last word
        overrides.append(avoided_by(asked.avoid))
    changes = toml_files.by_first_word(overrides, ("mission", *SIMULATOR_FILES))
    if seed is None and any(changes[word] for word in SIMULATOR_FILES):
        raise PlanError("--set vehicle... and world...: these are the simulator's own: vehicle-sim --set ...")
    settings = load_settings(asked.settings, changes[""])
    origin = None if place is None else (lambda mission: place)
    origin = origin if seed is None else at_pad
    if asked.mission == STORED:
        mission, path = Mission(STORED, waits=True), None  # as long as the vehicle's is not known
    elif is_of_station(asked.mission):
        mission, path, radius, notes = load_of_station(asked.mission, changes["mission"], origin)
        settings = fenced(settings, path, radius)
        for each in notes if place or seed is not None else ():  # once
            note(f"{path}: {each}")
    else:
        mission, path = load_mission(asked.mission, changes["mission"], origin)
    files = {
        **({} if path is None else {"mission": path}),
        "vehicle": toml_files.find("vehicles", mission.vehicle),
        "world": toml_files.find("worlds", mission.world),
    }
    output = output_of(asked.output)
    body = load_body(mission.vehicle)
    pace = pace_of(("realtime" if asked.gcs else "lockstep") if asked.pace is None else asked.pace)
    plan = Plan(settings, body, mission, output, pace, files, seed, tuple(overrides))
    check(plan)
    plan, limited = softened(plan)
    for each in limited + (_seen_too_late(plan) if seed is not None else []):
        note(each)
    return plan


def _seen_too_late(plan: "Plan") -> list[str]:
    """What there is in the simulated world that the scan shows too late, in words."""
    import numpy as np

    from companion.mission.plan import steps
    from companion.view.unseen import seen_too_late
    from protocol.toml_files import content

    avoidance, mission = plan.settings.avoidance, plan.mission
    if not avoidance.needs_scan:
        return []
    late = seen_too_late(mission, steps(mission, np.zeros(3)), content(plan.files["world"]), avoidance, plan.body)
    return [f"the LiDAR shows too late: {each}" for each in late]


def _adoption(asked: FlyOptions) -> "Adoption | None":
    """Raises PlanError."""
    from companion.runtime.flight import PlanError
    from companion.state import Adoption

    if asked.land and not asked.adopt:
        raise PlanError("--land goes with --adopt; Ctrl-C lands a flight of this program's own")
    if not asked.adopt:
        return None
    return Adoption.LAND if asked.land else Adoption.MISSION
