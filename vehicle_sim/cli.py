"""`vehicle-sim`: fly a simulated vehicle that speaks MAVLink."""

import json
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from vehicle_sim.truth import TruthRecorder

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def vehicle_sim(
    world: Annotated[str, typer.Option(help="A world: a name in worlds/, or a file.")] = "neighbourhood",
    vehicle: Annotated[str, typer.Option(help="A vehicle: a name in vehicles/, or a file.")] = "paper_quad",
    bind: Annotated[
        str,
        typer.Option(
            metavar="URL", help="Where the companion is: udpout:HOST:PORT, udpin:HOST:PORT, tcp:.., serial:.."
        ),
    ] = "udpout:127.0.0.1:14540",
    pace: Annotated[str, typer.Option(metavar="realtime|lockstep|FACTOR", help="How time passes.")] = "realtime",
    seed: Annotated[int, typer.Option(min=0, help="Of all noise.")] = 0,
    once: Annotated[bool, typer.Option("--once", help="End after one flight.")] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Change one key of the vehicle's or the world's file: --set vehicle.body.mass_kg=0.9, "
            '--set "world.wind.mean_ned=[6, 0, 0]".',
            metavar="KEY=VALUE",
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true motion of every tick to this .npy file.")
    ] = None,
) -> None:
    """A quadcopter with a LiDAR in a world of obstacles, flown by its own autopilot or by a companion over MAVLink.

    At its end it prints one JSON object: how the flight went.
    """
    factor = _factor(pace)

    from protocol.toml_files import TomlFileError, find  # what --help does not need is slow to import
    from protocol.transport import TransportError, open_url
    from vehicle_sim.airframe import Airframe
    from vehicle_sim.runner import Runner
    from vehicle_sim.truth import TruthRecorder
    from vehicle_sim.vehicle import Vehicle, warm_up
    from vehicle_sim.world import World

    try:
        changes = _sorted(overrides or [])
        airframe = Airframe.load(find("vehicles", vehicle), changes["vehicle"])
        place = World.load(find("worlds", world), changes["world"])
        recorder = None if truth is None else TruthRecorder(truth)
        transport = open_url(bind)
    except (TomlFileError, TransportError) as error:
        _fail(str(error))
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)
    flown = Vehicle(
        airframe,
        place,
        seed=seed,
        lockstep=factor is None,
        datagrams=transport.preserves_datagrams,
        truth=recorder,
    )
    runner = Runner(flown, transport, once=once)
    try:
        warm_up(airframe, place)
        if factor is None:
            runner.run_lockstep()
        else:
            runner.run_timed(factor)
    except KeyboardInterrupt:
        pass
    except TransportError as error:
        _fail(str(error))
    finally:
        transport.close()
        typer.echo(json.dumps(flown.summary().as_dict()))
        if recorder is not None:
            _write(recorder)


def _sorted(overrides: list[str]) -> dict[str, list[str]]:
    """The vehicle's and the world's. Raises DataFileError for any other."""
    from protocol.toml_files import TomlFileError, by_first_word

    changes = by_first_word(overrides, ("vehicle", "world"))
    for other in changes[""]:
        raise TomlFileError(f"--set {other}: write it as vehicle.KEY=VALUE or world.KEY=VALUE")
    return changes


def _write(recorder: "TruthRecorder") -> None:
    from protocol.toml_files import TomlFileError

    try:
        recorder.write()
    except TomlFileError as error:
        _fail(str(error))


def _factor(pace: str) -> float | None:
    """How many times as fast as real time; None: lockstep."""
    if pace == "lockstep":
        return None
    if pace == "realtime":
        return 1.0
    try:
        factor = float(pace)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor <= 1000.0:
        _fail(f"--pace {pace}: write realtime, lockstep or a factor above 0 and up to 1000")
    return factor


def _fail(text: str) -> NoReturn:
    typer.echo(f"vehicle-sim: {text}", err=True)
    sys.exit(2)


def main() -> None:
    """Entry point of the console script."""
    app()
