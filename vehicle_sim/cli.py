"""`vehicle-sim`: fly a simulated vehicle that speaks MAVLink."""

import inspect
import json
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from protocol.standard_files import open_closed

# What --help does not need is imported where it is used: loading the compiled code takes seconds.
if TYPE_CHECKING:
    from protocol.key_files import Keeper
    from vehicle_sim.airframe import Airframe
    from vehicle_sim.opening import Opened
    from vehicle_sim.truth import TruthRecorder
    from vehicle_sim.vehicle import Vehicle
    from vehicle_sim.world import World

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

SENSORS = "gnss"
"""The sensors of a vehicle whose file names none."""


@dataclass(frozen=True, slots=True)
class Options:
    """The options of the command line."""

    world: Annotated[str, typer.Option(help="A world: a name in worlds/, or a file.")] = "neighbourhood"
    vehicle: Annotated[str, typer.Option(help="A vehicle: a name in vehicles/, or a file.")] = "paper_quad"
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What it flies on and tells: gnss, rtk or vio (a name in vehicles/sensors/, or a file), or perfect: "
            "the truth. gnss where the vehicle's file names none.",
        ),
    ] = None
    bind: Annotated[
        list[str] | None,
        typer.Option(
            metavar="URL",
            help="A link of a companion: udpout:HOST:PORT, udpin:HOST:PORT, tcp:.., tcpin:.., serial:..; may be given "
            "more than once. Without --bind and --gcs: PX4's two links, see --instance.",
        ),
    ] = None
    gcs: Annotated[
        list[str] | None,
        typer.Option(metavar="URL", help="A link of ground stations, with their streams and rates; as --bind."),
    ] = None
    instance: Annotated[
        int,
        typer.Option(
            min=0,
            max=249,
            metavar="N",
            help="As PX4 in SITL: system N + 1, port 14580 + N to a companion at 14540 + N, port 18570 + N to a ground "
            "station at 14550.",
        ),
    ] = 0
    firmware: Annotated[
        str, typer.Option(metavar="MAJOR.MINOR", help="The PX4 that it is; up to 1.13 it takes actuator controls.")
    ] = "1.16"
    parameters: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Read the parameters from this file, if there is one, and keep them in it."),
    ] = None
    param: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Start with another value of a parameter: --param NAV_DLL_ACT=3."),
    ] = None
    signing_key: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A file with the key of MAVLink 2 signing (companion key FILE makes one): every message is signed, "
            "and of what comes only signed ones are obeyed.",
        ),
    ] = None
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Bind an address beyond this machine though there is no key.")
    ] = False
    pace: Annotated[str, typer.Option(metavar="realtime|lockstep|FACTOR", help="How time passes.")] = "realtime"
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise.")] = 0
    once: Annotated[bool, typer.Option("--once", help="End after one flight.")] = False
    warm_up: Annotated[bool, typer.Option("--warm-up", help="Compile what is compiled once on a machine, and end.")] = (
        False
    )
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Change one key of the vehicle's or the world's file: --set vehicle.body.mass_kg=0.9, "
            '--set "world.wind.mean_ned=[6, 0, 0]".',
            metavar="KEY=VALUE",
        ),
    ] = None
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true motion of every tick to this .npy file.")
    ] = None


def _takes_options(command: Callable[[Options], None]) -> Callable[..., None]:
    """Show typer, which reads a command's signature, the fields of `Options` as its parameters."""

    def with_keywords(**values: Any) -> None:
        command(Options(**values))

    with_keywords.__doc__ = command.__doc__
    with_keywords.__annotations__ = Options.__annotations__
    with_keywords.__signature__ = inspect.signature(Options)  # type: ignore[attr-defined]
    return with_keywords


@app.command()
@_takes_options
def vehicle_sim(options: Options) -> None:
    """A quadcopter with a LiDAR in a world of obstacles, flown by its own autopilot or by a companion over MAVLink.

    At its end it prints one JSON object: how the flight went.
    """
    from protocol.compiling import compiling_shown
    from protocol.key_files import Keeper, KeyFileError
    from protocol.toml_files import TomlFileError
    from protocol.transport import TransportError
    from vehicle_sim.parameter_files import ParameterFileError, keep
    from vehicle_sim.services.identity import Identity
    from vehicle_sim.truth import TruthRecorder
    from vehicle_sim.vehicle import Vehicle, warm_up

    factor = _factor(options.pace)
    identity = Identity(options.instance + 1, _release(options.firmware))
    try:
        airframe, world = load_files(options)
        if options.warm_up:
            with compiling_shown():
                warm_up(airframe, world)
            return
        recorder = None if options.truth is None else TruthRecorder(options.truth)
        keeper = None if options.signing_key is None else Keeper.of(options.signing_key)
        opened = _open(options, keeper, lockstep=factor is None)
        vehicle = Vehicle(
            airframe,
            world,
            seed=options.seed,
            lockstep=factor is None,
            datagrams=opened.first is None or opened.first.preserves_datagrams,
            truth=recorder,
            identity=identity,
        )
        keep(vehicle.parameters, options.parameters, options.param or [], factor or 1.0)
    except (TomlFileError, KeyFileError, TransportError, ParameterFileError) as error:
        _fail(str(error))
    _fly(options, factor, vehicle, opened, recorder)


def load_files(options: Options) -> "tuple[Airframe, World]":
    """Read the vehicle's and the world's file. Raises TomlFileError."""
    from protocol.toml_files import TomlFileError, by_first_word, find
    from vehicle_sim.airframe import Airframe
    from vehicle_sim.world import World

    changes = by_first_word(options.overrides or [], ("vehicle", "world"))
    for other in changes[""]:
        raise TomlFileError(f"--set {other}: write it as vehicle.KEY=VALUE or world.KEY=VALUE")
    for change in changes["world"]:
        if change.partition("=")[0].strip() == "name":
            raise TomlFileError(
                f"--set world.{change}: that is a label; the world is chosen by --world (companion demo: --set "
                "mission.world=NAME)"
            )
    chosen = [] if options.sensors is None else [f"estimator.sensors={json.dumps(options.sensors)}"]
    airframe = Airframe.load(find("vehicles", options.vehicle), [*chosen, *changes["vehicle"]], SENSORS)
    return airframe, World.load(find("worlds", options.world), changes["world"])


def _open(options: Options, keeper: "Keeper | None", *, lockstep: bool) -> "Opened":
    """Raises TransportError."""
    from vehicle_sim.opening import Request, open_instance, open_links
    from vehicle_sim.services.profiles import Profile

    requests = [Request(url, Profile.ONBOARD) for url in options.bind or []]
    requests += [Request(url, Profile.GROUND) for url in options.gcs or []]
    if not requests:
        return open_instance(options.instance, keeper, lockstep=lockstep)
    return open_links(requests, keeper, insecure=options.insecure, lockstep=lockstep)


def _fly(
    options: Options,
    factor: float | None,
    vehicle: "Vehicle",
    opened: "Opened",
    recorder: "TruthRecorder | None",
) -> None:
    """Fly until the end or a signal, and print the summary."""
    from protocol.compiling import compiling_shown
    from protocol.transport import TransportError
    from vehicle_sim.runner import Runner
    from vehicle_sim.vehicle import MotionError, warm_up

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)
    try:
        with compiling_shown():
            warm_up(vehicle.airframe, vehicle.world)
        links = opened.links(vehicle)
        runner = Runner(vehicle, opened.first, once=options.once, links=links, takes_keys=opened.local)
        if factor is None:
            runner.run_lockstep()
        else:
            runner.run_timed(factor)
    except KeyboardInterrupt:
        pass
    except (TransportError, MotionError) as error:
        _fail(str(error))
    finally:
        opened.close()
        typer.echo(json.dumps(vehicle.summary().as_dict() | opened.refused))
        if recorder is not None:
            _write(recorder)


def _write(recorder: "TruthRecorder") -> None:
    from protocol.toml_files import TomlFileError

    try:
        recorder.write()
    except TomlFileError as error:
        _fail(str(error))


def _factor(pace: str) -> float | None:
    """The speed of time relative to real time; None: lockstep."""
    if pace == "lockstep":
        return None
    if pace == "realtime":
        return 1.0
    try:
        factor = float(pace)
    except ValueError:
        factor = 0.0
    if not 0.001 <= factor <= 1000.0:
        _fail(f"--pace {pace}: write realtime, lockstep or a factor from 0.001 to 1000")
    return factor


def _release(firmware: str) -> tuple[int, int]:
    major, _, minor = firmware.partition(".")
    for part in (major, minor):  # a byte each of AUTOPILOT_VERSION
        if not (part.isascii() and part.isdigit() and len(part) < 4 and int(part) < 256):
            _fail(f"--firmware {firmware}: write it as 1.16")
    return int(major), int(minor)


def _fail(text: str) -> NoReturn:
    typer.echo(f"vehicle-sim: {text}", err=True)
    sys.exit(2)


def main() -> None:
    """Entry point of the console script."""
    open_closed()
    app()
