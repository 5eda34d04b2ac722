"""One flight of the matrix again: `python -m studies.faults FAULT MISSION SEED` prints what was said, and its row."""

import sys

import msgspec
import typer

from studies.faults.catalogue import FAULTS
from studies.faults.flights import FLIGHT_S, Job, fly


def main(fault: str, mission: str, seed: int) -> None:
    """FAULT as in docs/faults.md, MISSION courier or square."""
    if fault not in FAULTS or mission not in FLIGHT_S:
        typer.echo(f"studies.faults: there are {', '.join(map(repr, FAULTS))}; {', '.join(FLIGHT_S)}", err=True)
        sys.exit(2)
    row = fly(Job(fault, mission, seed, ""), said=typer.echo)
    typer.echo(msgspec.json.format(msgspec.json.encode(row)).decode())


if __name__ == "__main__":
    typer.run(main)
