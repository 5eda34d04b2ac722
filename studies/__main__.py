"""The command line: `python -m studies NAME ...`; the name of a page runs all of its studies."""

import importlib
from typing import Annotated, Any, cast

import typer

from protocol.datafile import DataFileError
from studies.beyond import CONTROL
from studies.paper import PAPER
from studies.report import DOCS, Page, Report, Study, keep, markdown, write_page

PAGES = (PAPER, CONTROL)

MISSED = 1
"""Exit code: a check was not met."""
UNUSABLE = 2
"""Exit code: nothing was run."""

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def studies(
    names: Annotated[list[str] | None, typer.Argument(help="Studies, or pages: all of their studies.")] = None,
    show: Annotated[bool, typer.Option("--list", help="Print what there is.")] = False,
) -> None:
    """Run studies: print their sections, keep them with their figures in docs/PAGE/ and write docs/PAGE.md anew."""
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
    try:
        met = _run(chosen)
        for page in PAGES:
            if any(each is page for _, each in chosen.values()):
                typer.echo(f"written: {write_page(page, [study.NAME for study in _studies(page)])}", err=True)
    except DataFileError as error:
        typer.echo(f"studies: {error}", err=True)
        raise typer.Exit(UNUSABLE) from None
    if not met:
        raise typer.Exit(MISSED)


def _studies(page: Page) -> list[Study]:
    return [cast(Study, importlib.import_module(module)) for module in page.studies]


def _run(chosen: dict[str, tuple[Study, Page]]) -> bool:
    """Whether all checks were met."""
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
            report = Report(study.NAME, study.TITLE, DOCS / page.name, track)
            study.run(report)
            section = report.section()
            keep(section, DOCS / page.name)
            typer.echo(markdown(section, page.name))
            met = met and all(check.ok for check in section.checks)
    return met


if __name__ == "__main__":
    app(prog_name="python -m studies")
