"""The command line: `companion demo`, `companion fly`, and what the other modules add to it."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from companion.cli import logs as cli_logs
from companion.cli import view as cli_view
from companion.cli.shell import ABANDONED, FAILED, exit_on_user_error, run
from companion.cli.shell import say as _say

app = typer.Typer(
    help="Fly a vehicle over MAVLink: LQR attitude control, backstepping position control, LiDAR avoidance.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)

MissionName = Annotated[str, typer.Argument(help="A file in missions/, by name or path.")]
OutputName = Annotated[
    str, typer.Option("--output", help="The lowest layer commanded: attitude, rates or actuators (torques).")
]
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
Avoid = Annotated[
    str | None,
    typer.Option(
        "--avoid",
        help="astar, rrt, vfh, paper, paper-literal or none: short for --set avoidance.method=...",
        metavar="METHOD",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the end table as one JSON object.")]


@app.command()
def demo(
    mission: MissionName = "courier",
    output: OutputName = "rates",
    pace: PaceName = "lockstep",
    avoid: Avoid = None,
    seed: Annotated[int, typer.Option(help="Of the simulator's noise.", min=0)] = 1,
    log: LogFolder = Path("logs"),
    settings: SettingsFile = None,
    overrides: DemoOverrides = None,
    truth: Annotated[
        bool, typer.Option("--truth", help="Leave the true motion of every tick beside the log, as truth.npy.")
    ] = False,
    report: Annotated[bool, typer.Option(help="Write report.html beside the log.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fly MISSION against the simulator, both started here as processes of their own, and print how it went."""
    plan = _plan(mission, output, pace, settings, _chosen(avoid, overrides), seed)
    _say("getting ready (the first time on a machine, some 20 s of compiling)")
    from companion.runtime.demo import demo as fly_demo

    verdict = _usable(fly_demo, plan, log, console=True, truth=truth)
    _print_table(verdict.table(), verdict.result.log, as_json)
    if report:
        from companion.view.report import write

        _say(f"report: {_usable(write, verdict.result.log)}")
    if not verdict.succeeded:
        _say(f"failed: {verdict.outcome}")
        raise typer.Exit(FAILED)


@app.command()
def fly(
    mission: MissionName,
    connect: Annotated[
        str,
        typer.Option(help="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD."),
    ] = "udpin:127.0.0.1:14540",
    output: OutputName = "rates",
    pace: PaceName = "realtime",
    avoid: Avoid = None,
    log: LogFolder = Path("logs"),
    settings: SettingsFile = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Fly MISSION with the vehicle that answers at a URL. Ctrl-C lands it."""
    plan = _plan(mission, output, pace, settings, _chosen(avoid, overrides), None)
    from companion.runtime.flight import end_table, prepare
    from companion.runtime.flight import fly as fly_plan
    from companion.runtime.summary import summarize
    from protocol.transport import open_url

    transport = _usable(open_url, connect)
    _usable(prepare, plan)
    if connect.endswith(":0"):
        _say(f"companion: waiting at {connect[:-1]}{transport.port}")
    left = "; a vehicle in the air holds and lands by itself"
    result = _usable(fly_plan, plan, transport, log, console=True, left=left)
    outcome = result.fault or ("delivered" if result.delivered else "flown")
    summary = summarize(result.log)
    if summary.distance_m > 0.0 or as_json:
        _print_table({"outcome": outcome, **end_table(result, summary)}, result.log, as_json)
    if result.fault is not None or (plan.mission.delivery is not None and not result.delivered):
        _say(f"failed: {outcome}")
        raise typer.Exit(FAILED)


cli_logs.register(app)
cli_view.register(app)


@app.command()
def settings() -> None:
    """Print every setting with its default and its meaning (Markdown)."""
    from companion.cli.settings_page import page

    typer.echo(page(), nl=False)


def main() -> None:
    """The program `companion`."""
    run(app)


def _chosen(avoid: str | None, overrides: list[str] | None) -> list[str]:
    """The overrides with that of --avoid as the last word."""
    return [*(overrides or ()), *([] if avoid is None else [f"avoidance.method={json.dumps(avoid)}"])]


def _plan(mission: str, output: str, pace: str, settings: Path | None, overrides: list[str], seed: int | None) -> Any:
    def read() -> Any:
        from companion.config import load_body, load_settings
        from companion.mission import plan as missions
        from companion.runtime.demo import SIMULATOR_FILES
        from companion.runtime.flight import Plan, PlanError, check
        from companion.state import Output
        from protocol import toml_files as toml_files

        changes = toml_files.by_first_word(overrides, ("mission", *SIMULATOR_FILES))
        if seed is None and any(changes[word] for word in SIMULATOR_FILES):
            raise PlanError("--set vehicle... and world...: these are the simulator's own: vehicle-sim --set ...")
        read_settings = load_settings(settings, changes[""])
        flown, path = missions.load(mission, changes["mission"])
        files = {
            "mission": path,
            "vehicle": toml_files.find("vehicles", flown.vehicle),
            "world": toml_files.find("worlds", flown.world),
        }
        try:
            chosen = Output(output)
        except ValueError:
            raise PlanError(f"--output {output}: there are attitude, rates and actuators") from None
        body, given = load_body(flown.vehicle), tuple(overrides)
        plan = Plan(read_settings, body, flown, chosen, _pace(pace), files, seed, given)
        check(plan)
        return plan

    return _usable(read)


def _pace(text: str) -> Any:
    from companion.runtime.flight import PlanError

    if text == "lockstep":
        return text
    if text == "realtime":
        return 1.0
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < 1000.0:
        raise PlanError(f"--pace {text}: there are realtime, lockstep and factors such as 4")
    return factor


def _usable(function: Any, *arguments: Any, left: str = "", **options: Any) -> Any:
    """As `shell.usable`; whoever interrupts it is told what is `left` then."""
    try:
        return exit_on_user_error(function, *arguments, **options)
    except KeyboardInterrupt:
        _say(f"companion: abandoned{left}")
        raise typer.Exit(ABANDONED) from None


def _print_table(values: dict[str, object], log: Path, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps({**values, "log": str(log)}))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False)
    for name, value in values.items():
        table.add_row(name.replace("_", " "), ", ".join(map(str, value)) if isinstance(value, list) else str(value))
    Console().print(table)
    typer.echo(f"log: {log}")
