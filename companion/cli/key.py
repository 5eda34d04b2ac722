"""The command that makes a key for signing: key."""

from pathlib import Path
from typing import Annotated

import typer

from companion.cli.shell import exit_on_user_error, say


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(key)


def key(file: Annotated[Path, typer.Argument(help="The new file; one that is there is not overwritten.")]) -> None:
    """Make a random key for MAVLink 2 signing, in a file that its owner alone may read. Both sides need the same."""
    from protocol.key_files import make_key

    exit_on_user_error(make_key, file)
    say(f"companion: {file}: copy it safely to the other side, with mode 0600; both take --signing-key FILE")
