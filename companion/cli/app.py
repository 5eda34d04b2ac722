"""The program `companion`: its commands in the order of its help."""

import typer

from companion.cli import check, flights, key, logs, mission, settings, view
from companion.cli.shell import run

app = typer.Typer(
    help="Fly a vehicle over MAVLink: LQR attitude control, backstepping position control, LiDAR avoidance.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for commands in (flights, check, mission, key, logs, view, settings):
    commands.register(app)


def main() -> None:
    """Run the program with the arguments of its process."""
    run(app)
