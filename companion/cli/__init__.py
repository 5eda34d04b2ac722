"""The command line."""

import sys


def main() -> None:
    """The program `companion`."""
    from protocol.standard_files import open_closed

    try:
        open_closed()
        from companion.cli.app import main as run_app

        run_app()
    except KeyboardInterrupt:
        sys.exit(130)
