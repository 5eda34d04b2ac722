"""The commands for missions: show, convert."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.shell import exit_as_unusable, exit_on_user_error, note

if TYPE_CHECKING:
    from collections.abc import Sequence

    from companion.mission.plan import Mission, Step

File = Annotated[str, typer.Argument(metavar="FILE", help="A .plan, a .waypoints, or a mission by name or path.")]

mission = typer.Typer(help="Look at missions and convert them.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.add_typer(mission, name="mission")


@mission.command()
def show(
    file: File,
    html: Annotated[
        Path | None, typer.Option("--html", help="Write a page with a map of it, a new file.", metavar="FILE")
    ] = None,
) -> None:
    """List what is flown, step by step, with the places around the take-off, draw it from above, and say what of its
    surroundings the LiDAR does not show. Exit code 2 if it can't be flown, as beyond the fence of its file."""
    import numpy as np

    from companion.cli.logs import table
    from companion.config import Settings
    from companion.mission.plan import steps
    from companion.runtime.feasibility import check_curves
    from companion.runtime.files import load_body
    from companion.view.mission_map import page, sketch
    from companion.view.unseen import unseen, words
    from protocol.toml_files import content, find

    (found, fence_radius), rows, settings = _mission(file), [], Settings()
    body = exit_on_user_error(load_body, found.vehicle)
    exit_on_user_error(check_curves, settings, found)
    plan = steps(found, np.zeros(3))
    for number, step in enumerate(plan, 1):
        north, east, height = ("", "", "")
        if step.target_ned is not None:
            x, y, z = step.target_ned.tolist()
            north, east, height = f"{x:.1f}", f"{y:.1f}", f"{-z:.1f}"
        speed = f"{step.speed or found.speed:g}" if step.target_ned is not None else ""
        hold = f"{step.hold_s:g}" if step.hold_s else ""
        rows.append((str(number), step.phase.name.lower(), north, east, height, speed, hold))
    table(("step", "what", "north, m", "east, m", "height, m", "speed, m/s", "hold, s"), rows)
    typer.echo(f"\n{sketch(plan)}")
    typer.echo(f"\n{words(unseen(found, plan, _world(found), settings.avoidance, body))}")
    if html is not None:
        world = content(exit_on_user_error(find, "worlds", found.world))
        exit_on_user_error(_write, html, page(found, plan, world, fence_radius))
        typer.echo(f"map: {html}")
    exit_on_user_error(_keep_within, file, fence_radius, plan)


@mission.command()
def convert(
    file: File,
    to: Annotated[Path, typer.Argument(metavar="TO", help="A new file .toml, or .waypoints from a .plan.")],
) -> None:
    """Write a ground station's mission as a file for missions/, with its places around where it was planned from; or a
    .plan as .waypoints. What the new file can't hold is said."""
    from companion.mission.files import to_toml, to_waypoints
    from companion.runtime.station_files import is_of_station, read_of_station

    left: list[str] = []
    if to.suffix == ".toml":
        found, radius = _mission(file)
        text = to_toml(found)
        if radius is not None:
            left.append(f"the fence: --set geofence.radius={math.floor(radius)}")
    elif to.suffix == ".waypoints" and is_of_station(file):
        read = exit_on_user_error(read_of_station, file)
        text = to_waypoints(read)
        left += [] if read.speed is None else [f"the speed: --set mission.speed={read.speed:g}"]
        left += ["the fence"] if read.fences else []
    else:
        exit_as_unusable(f"{to}: what is written is a .toml, and a .waypoints from a ground station's file")
    exit_on_user_error(_write, to, text)
    for each in left:
        note(f"{to} does not hold {each}")
    typer.echo(f"mission: {to}")


def _keep_within(file: str, radius: float | None, plan: "Sequence[Step]") -> None:
    """Raises TomlFileError for steps beyond the file's own fence, inside of which the default margin is kept."""
    import numpy as np

    from companion.config import Settings
    from companion.fence import fence_of, first_beyond
    from companion.runtime.station_files import fenced
    from protocol.toml_files import TomlFileError

    settings = fenced(Settings(), Path(file), radius).geofence
    fence = fence_of(settings, np.zeros(3))
    places = [(step.phase.name.lower(), step.target_ned) for step in plan if step.target_ned is not None]
    beyond = None if fence is None else first_beyond(fence.shrunk(settings.margin), places)
    if beyond is not None:
        raise TomlFileError(f"{file}: the mission leaves its fence: {beyond}")


def _world(found: "Mission") -> bytes:
    """The file of its world; empty without one, as for a real vehicle."""
    from protocol.toml_files import TomlFileError, content, find

    try:
        return content(find("worlds", found.world))
    except (TomlFileError, OSError):
        return b""


def _write(to: Path, text: str) -> None:
    from companion.logs.target import output

    with output(to) as draft:
        draft.write_text(text, encoding="utf-8")


def _mission(file: str) -> "tuple[Mission, float | None]":
    """The mission, and the radius (m) of its fence around the take-off."""
    from companion.runtime.files import load_mission
    from companion.runtime.station_files import is_of_station, load_of_station

    if not is_of_station(file):
        return exit_on_user_error(load_mission, file)[0], None
    found = exit_on_user_error(load_of_station, file)
    for each in found.notes:
        note(f"{file}: {each}")
    return found.mission, found.fence_radius
