"""`vehicle-sim`: fly a simulated vehicle that speaks MAVLink."""

import json
import signal
import sys
from typing import Annotated, NoReturn

import typer

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
) -> None:
    """A quadcopter with a LiDAR in a world of obstacles, flown by its own autopilot or by a companion over MAVLink.

    At its end it prints one JSON object: how the flight went.
    """
    factor = _factor(pace)

    from protocol.datafile import DataFileError, find  # what --help does not need is slow to import
    from protocol.transport import TransportError, open_url
    from vehicle_sim.airframe import Airframe
    from vehicle_sim.runner import Runner
    from vehicle_sim.vehicle import Vehicle, warm_up
    from vehicle_sim.world import World

    try:
        airframe = Airframe.load(find("vehicles", vehicle))
        place = World.load(find("worlds", world))
        transport = open_url(bind)
    except (DataFileError, TransportError) as error:
        _fail(str(error))
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)
    flown = Vehicle(airframe, place, seed=seed, lockstep=factor is None, datagrams=transport.preserves_datagrams)
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
