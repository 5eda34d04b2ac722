"""The pages are true: programs understand their commands, links lead somewhere, quoted messages exist."""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperGroup

from companion.cli.app import app as companion_app
from vehicle_sim.cli import app as simulator_app

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
COMMAND = re.compile(r"^\s{4,}(?:\.venv/bin/)?(companion|vehicle-sim) (.*)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PROGRAMS = {"companion": typer.main.get_command(companion_app), "vehicle-sim": typer.main.get_command(simulator_app)}


def commands() -> list[tuple[str, str, str]]:
    """Page, program and arguments of all commands that stand in a block of code."""
    found = []
    for page in PAGES:
        text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
        found += [(page.name, program, arguments) for program, arguments in COMMAND.findall(text)]
    return found


def parse(program: str, arguments: str) -> None:
    """Raises what the program would refuse the arguments with."""
    words = shlex.split(arguments.replace("[", "").replace("]", ""), comments=True)
    cut = next((index for index, word in enumerate(words) if word in (">", "|", "&", "&&")), len(words))
    words = [word.replace("...", "hover") for word in words[:cut]]
    command: Any = PROGRAMS[program]
    context = command.context_class(command, info_name=program)
    while isinstance(command, TyperGroup):
        name, command, words = command.resolve_command(context, words)
        context = command.context_class(command, context, name)
    command.parse_args(context, words)


def test_the_pages_have_commands() -> None:
    assert len(commands()) > 40


@pytest.mark.parametrize(("page", "program", "arguments"), commands())
def test_a_command_of_the_pages_is_understood(page: str, program: str, arguments: str) -> None:
    parse(program, arguments)


def test_a_command_that_does_not_exist_is_found() -> None:
    for arguments in ("fly hover --nosuch 1", "nosuch", "mission nosuch", "fly"):
        with pytest.raises(Exception, match=r"(?i)no such|missing"):
            parse("companion", arguments)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        assert re.match(r"https?:|mailto:", link) or (page.parent / link).exists(), link


@cache
def sources() -> str:
    """The programs' code, with the parts of a string on several lines put together."""
    text = "\n".join(
        path.read_text(encoding="utf-8")
        for folder in ("companion", "protocol")
        for path in (ROOT / folder).rglob("*.py")
    )
    return re.sub(r'"\s*\n\s*f?"', "", text)


def test_the_messages_of_the_troubleshooting_page_are_the_programs_own() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    messages = re.findall(r"^\| ((?:`[^`]+`(?:, )?)+) \|", page, re.MULTILINE)
    assert len(messages) > 15
    for message in messages:
        for part in re.split(r"\.\.\.|`, `|`", message):
            words = part.strip(" :,")
            assert len(words) < 4 or words in sources() or words.startswith("Address already in use"), words
