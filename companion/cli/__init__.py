"""The command line."""


def main() -> None:
    """The program `companion`."""
    from companion.cli.app import main as run_app

    run_app()
