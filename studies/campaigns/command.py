"""The command line of campaigns: `courier-campaign`, or `python -m studies campaign`."""

import errno
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from protocol import toml_files
from protocol.toml_files import TomlFileError

if TYPE_CHECKING:  # both take seconds to import, and `--help` needs neither
    from distributed import Client

    from studies.campaigns.runner import Campaign

FAILED, UNUSABLE, ABANDONED = 1, 2, 130
"""Exit codes: a worker had other code, the scheduler went away or the disk is full; nothing was flown; interrupted."""

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="Fly campaigns of many flights (docs/campaigns.md). `courier-campaign FILE` is `courier-campaign fly FILE`.",
)

Folder = Annotated[Path, typer.Option("--folder", help="Where each campaign has a folder of its name.")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a dask scheduler; none: workers of this machine.", metavar="ADDRESS")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Of this machine; by default one a core.")]
LOGS = Path("logs/campaigns")


@app.command()
def fly(
    file: Annotated[str, typer.Argument(help="A name in campaigns/, or a path.", metavar="FILE.toml")],
    scheduler: Scheduler = None,
    workers: Workers = None,
    folder: Folder = LOGS,
) -> None:
    """Fly a campaign, or what is left of it; write its table and its page."""
    with _errors():
        from studies.campaigns import files
        from studies.campaigns.page import write
        from studies.campaigns.runner import Campaign
        from studies.campaigns.table import alone, naming
        from studies.engine import cluster, dashboard

        path = toml_files.find("campaigns", file)
        given = files.load(path)
        setups, own = given.setups(), folder / given.name
        with alone(own):
            flying = Campaign(given.jobs(setups, own), own, given.stopping)
            todo = flying.todo
            if len(todo) < len(flying.jobs):
                _say(f"{len(flying.jobs) - len(todo)} of {len(flying.jobs)} flights are there already")
            if todo:
                with cluster(scheduler, workers) as client:
                    if (link := dashboard(client)) is not None:
                        _say(f"dashboard: {link}")
                    _fly(flying, client, given.wall_limit_s)
            rows = flying.finish()
            with naming(own):
                page = write(f"Campaign {given.name}", f"campaign {file}", own, setups, rows)
        typer.echo(page.read_text(encoding="utf-8"))
        _say(f"written: {page}")


def _fly(flying: "Campaign", client: "Client", limit_s: float) -> None:
    """With a bar."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, console=Console(stderr=True)) as bars:
        bar, failed = bars.add_task("flights", total=len(flying.todo)), 0
        for row in flying.fly(client, limit_s):
            failed += not row.succeeded
            bars.update(bar, advance=1, description=f"flights, {failed} failed")


@app.command()
def search(
    file: Annotated[str, typer.Argument(help="A name in campaigns/, or a path; it has a table 'search'.")],
    sampler: Annotated[str, typer.Option(help="cma, or random.")] = "cma",
    scheduler: Scheduler = None,
    workers: Workers = None,
    into: Annotated[Path, typer.Option(help="Where each failure is written as a campaign's file.")] = Path("campaigns"),
) -> None:
    """Search for flights that fail, and write each as a file that flies it again."""
    with _errors("interrupted; the same command searches from the beginning"):
        from studies.campaigns.search import SAMPLERS, SearchFile, keep
        from studies.campaigns.search import search as tries
        from studies.engine import cluster

        given = SearchFile.load(toml_files.find("campaigns", file))
        if sampler not in SAMPLERS:
            _refuse(f"--sampler {sampler}: there are {', '.join(SAMPLERS)}")
        _check_writable(into)
        with cluster(scheduler, workers) as client:
            for tried in tries(given, sampler, client):
                values = ", ".join(f"{name} {value:g}" for name, value in tried.values.items())
                typer.echo(f"{tried.number:4} {tried.score:7.3f} m  {tried.outcome}  ({values}, seed {tried.seed})")
                if tried.score <= 0.0:
                    _say(f"written: {keep(tried, into)}")


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a campaign.")],
    second: Annotated[Path, typer.Argument(help="Folder of another one over the same seeds.")],
) -> None:
    """Compare two campaigns, seed by seed: McNemar's exact test of success, bootstrap intervals of the rest."""
    from studies.campaigns.statistics import compared
    from studies.campaigns.table import counting

    for folder in (first, second):
        if not folder.is_dir():
            _refuse(f"{folder}: no such folder")
    with _errors():
        lines = compared(counting(first), counting(second))
    if not lines:
        _refuse(f"{first} and {second} have no flight of the same set-up, speed and seed")
    for line in lines:
        typer.echo(line)


def _check_writable(folder: Path) -> None:
    """Ends the program where nothing can be written into a folder, before anything is flown."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        _refuse(f"{folder}: {error.strerror}")


@contextmanager
def _errors(interrupted: str = "interrupted; the same command goes on from here") -> Iterator[None]:
    """What the user can mend is one line."""
    from studies.campaigns.table import TableError
    from studies.engine import EngineError

    try:
        yield
    except (TomlFileError, TableError) as error:
        _refuse(str(error))
    except EngineError as error:
        _say(str(error))
        raise typer.Exit(FAILED) from None
    except OSError as error:  # a disk that is full or goes away
        if error.errno == errno.EPIPE:  # nobody reads any more, which typer knows
            raise
        _say(f"{error.filename}: {error.strerror}" if error.filename is not None else str(error))
        raise typer.Exit(FAILED) from None
    except KeyboardInterrupt:
        _say(interrupted)
        raise typer.Exit(ABANDONED) from None


def _refuse(text: str) -> NoReturn:
    _say(text)
    raise typer.Exit(UNUSABLE)


def _say(text: str) -> None:
    typer.echo(f"campaign: {text}", err=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """`fly` may be left out."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    names = [command.callback.__name__ for command in app.registered_commands if command.callback is not None]
    if given and given[0] not in (*names, "--help"):
        given.insert(0, "fly")
    app(given, prog_name="courier-campaign")
