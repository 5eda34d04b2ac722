"""The command line: `python -m studies NAME ...`; the name of a page runs all of its studies.

`python -m studies worlds NAME` makes a place to fly through, `python -m studies campaign FILE` flies a campaign.
"""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from protocol.toml_files import TomlFileError
from studies.avoidance_page import AVOIDANCE
from studies.beyond import CONTROL
from studies.faults.page import FAULTS_PAGE
from studies.paper import PAPER
from studies.report import DOCS, Choice, Page, Report, Study, keep, markdown, write_page

PAGES = (PAPER, CONTROL, AVOIDANCE, FAULTS_PAGE)

MISSED = 1
"""Exit code: a check was not met."""
UNUSABLE = 2
"""Exit code: nothing was run."""

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
places = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def studies(
    names: Annotated[list[str] | None, typer.Argument(help="Studies, or pages: all of their studies.")] = None,
    show: Annotated[bool, typer.Option("--list", help="Print what there is.")] = False,
    seeds: Annotated[
        int, typer.Option(min=0, help="Campaigns: flights of each case at most; 0: tell of what was flown before.")
    ] = Choice().seeds,
    methods: Annotated[list[str] | None, typer.Option("--method", help="Campaigns: these alone; repeatable.")] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", help="Campaigns: KEY=VALUE, a setting of the companion; repeatable.")
    ] = None,
) -> None:
    """Run studies: print their sections, keep them with their figures in docs/PAGE/ and write docs/PAGE.md anew.

    `worlds` makes a place by its seed, `campaign` flies a campaign: each has a --help of its own.
    """
    catalogue = {study.NAME: (study, page) for page in PAGES for study in _studies(page)}
    if show or not names:
        for name, (study, _) in catalogue.items():
            typer.echo(f"{name:16} {study.TITLE}")
        for page in PAGES:
            typer.echo(f"{page.name:16} all of docs/{page.name}.md")
        return
    chosen: dict[str, tuple[Study, Page]] = {}
    for name in names:
        of_page = {key: found for key, found in catalogue.items() if name in (key, found[1].name)}
        if not of_page:
            known = ", ".join((*catalogue, *(page.name for page in PAGES)))
            typer.echo(f"studies: {name}: no such study (there: {known})", err=True)
            raise typer.Exit(UNUSABLE)
        chosen |= of_page
    choice = Choice(seeds, tuple(methods or ()), tuple(overrides or ()))
    try:
        _check_choice(choice, [study for study, _ in chosen.values()])
        met = _run(chosen, choice)
        for page in PAGES:
            if any(each is page for _, each in chosen.values()):
                typer.echo(f"written: {write_page(page, [study.NAME for study in _studies(page)])}", err=True)
    except TomlFileError as error:
        typer.echo(f"studies: {error}", err=True)
        raise typer.Exit(UNUSABLE) from None
    if not met:
        raise typer.Exit(MISSED)


def _studies(page: Page) -> list[Study]:
    return [cast(Study, importlib.import_module(module)) for module in page.studies]


def _check_choice(choice: Choice, chosen: Sequence[Study]) -> None:
    """Raises TomlFileError for what the companion would refuse, before anything is flown."""
    from companion.runtime.files import load_settings
    from studies import flyable
    from studies.campaign import DEFAULT, chooses_method

    if chooses_method(choice.overrides):
        raise TomlFileError("--set avoidance.method: flights are listed by their method; choose it by --method")
    for method in choice.methods:
        load_settings(None, [f'avoidance.method="{method}"'])
    load_settings(None, list(choice.overrides))
    if choice.methods or choice.overrides:
        setups = [setup for study in chosen for setup in getattr(study, "SETUPS", ())]
        flyable.check(setups, choice.methods or (DEFAULT,), overrides=choice.overrides)


@places.command()
def worlds(
    name: Annotated[str | None, typer.Argument(help="A kind of place; left out: list them.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the place.")] = 1,
    folder: Annotated[Path, typer.Option(help="Where to write it.")] = Path(),
    speed: Annotated[float, typer.Option(min=0.1, max=100.0, help="Of the mission (m/s).")] = 5.0,
    picture: Annotated[bool, typer.Option("--picture", help="Draw it, too, as it is at the start.")] = False,
) -> None:
    """Make a place by its seed: NAME_SEED.toml, and NAME_SEED_mission.toml that flies through it."""
    from studies import style
    from studies.sites import SITES
    from studies.worlds import picture as draw

    if name not in SITES:
        what = f"worlds {name}: no such place" if name is not None else "worlds NAME"
        typer.echo(f"studies: {what} (there: {', '.join(SITES)})", err=True)
        raise typer.Exit(UNUSABLE)
    site = SITES[name](seed)
    try:
        written = [*site.save(folder, speed)]
        if picture:
            stem = folder / site.name
            style.save(draw(site), stem, f"python -m studies worlds {name} --seed {seed} --picture")
            written += [stem.with_suffix(".png"), stem.with_suffix(".svg")]
    except OSError as error:
        typer.echo(f"studies: {folder}: {error.strerror}", err=True)
        raise typer.Exit(UNUSABLE) from None
    for path in written:
        typer.echo(path)


def _run(chosen: dict[str, tuple[Study, Page]], choice: Choice) -> bool:
    """Run studies and write their sections; whether all checks were met."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    met = True
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bars:

        def track(iterable: Any, label: str) -> Any:
            task = bars.add_task(label)
            yield from bars.track(list(iterable), task_id=task)
            bars.remove_task(task)

        for study, page in bars.track(chosen.values(), description="studies"):
            report = Report(study.NAME, study.TITLE, DOCS / page.name, track, choice)
            study.run(report)
            section = report.section()
            keep(section, DOCS / page.name)
            typer.echo(markdown(section, page.name))
            met = met and all(check.ok for check in section.checks)
    return met


def main() -> None:
    """`worlds` and `campaign` are commands of their own; the names of studies are arguments without a command."""
    if sys.argv[1:2] == ["campaign"]:
        from studies.campaigns import command

        command.main(sys.argv[2:])
    if sys.argv[1:2] == ["worlds"]:
        places(sys.argv[2:], prog_name="python -m studies worlds")
    app(prog_name="python -m studies")


if __name__ == "__main__":
    main()
