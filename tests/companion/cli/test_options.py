"""A command whose options are the fields of a record."""

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.options import options


@dataclass(frozen=True, slots=True)
class Asked:
    place: Annotated[str, typer.Argument(help="Where to.")]
    times: Annotated[int, typer.Option("--times", help="How often.", min=1)] = 2
    words: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None
    loud: Annotated[bool, typer.Option(help="Or not.")] = True


def made() -> tuple[typer.Typer, list[Asked]]:
    program, calls = typer.Typer(), list[Asked]()

    @program.command()
    @options(Asked)
    def go(asked: Asked) -> None:
        """Go to PLACE."""
        calls.append(asked)

    return program, calls


def test_fields_are_options_with_their_defaults_and_bounds() -> None:
    program, calls = made()
    assert CliRunner().invoke(program, ["home"]).exit_code == 0
    given = ["away", "--times", "3", "--set", "a=1", "--set", "b=2", "--no-loud"]
    assert CliRunner().invoke(program, given).exit_code == 0
    assert calls == [Asked("home"), Asked("away", 3, ["a=1", "b=2"], loud=False)]
    for refused in ([], ["home", "--times", "0"], ["home", "--nothing"]):
        assert CliRunner().invoke(program, refused).exit_code == 2
    assert len(calls) == 2


def test_the_help_names_the_command_s_own_text_and_every_field() -> None:
    program, _ = made()
    shown = CliRunner().invoke(program, ["--help"]).output
    for text in ("Go to PLACE.", "Where to.", "--times", "KEY=VALUE", "--no-loud"):
        assert text in shown


def test_every_command_has_help() -> None:
    names = [each.callback.__name__ for each in app.registered_commands if each.callback is not None]
    assert names[:2] == ["demo", "fly"] and len(names) == 15
    for name in names:
        assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0, name
