"""The command line."""

import gc

_MADE_UNTIL_COLLECTED = 100_000
"""Objects. To import what a flight needs makes some 300,000, hardly any of them garbage: as rarely as that, collections
take a fifth less of a start."""


def main() -> None:
    """The program `companion`."""
    gc.set_threshold(_MADE_UNTIL_COLLECTED)
    from companion.cli.app import main as run_app

    run_app()
