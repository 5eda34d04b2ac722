"""The command that prints all settings: settings."""

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(settings)


def settings() -> None:
    """Print every setting with its default and its meaning (Markdown)."""
    from companion.cli.settings_page import page

    typer.echo(page(), nl=False)
