"""A campaign that is killed at a third and goes on, beside one that is left alone.

    python -m studies.campaigns.resume [FILE] [--seeds 40] [--folder FOLDER]

FILE is `forest` by default, flown with so many seeds and to their end. SIGKILL goes to the campaign and to all of its
workers at once. Exit code 1 unless both tables have each flight once and are equal but for their wall times. What is in
FOLDER already is not flown again.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from protocol import toml_files as toml_files
from studies.campaigns import files
from studies.campaigns.table import PARTS, digest, read
from studies.worlds import toml

UNDISTURBED, KILLED = "undisturbed", "killed"
POLL_S = 0.2


def fly(file: Path, folder: Path, cut: Callable[[], bool] = lambda: False) -> bool:
    """Fly a campaign in a process of its own, killed with all its workers as soon as `cut` holds; whether it was.
    Raises RuntimeError if it ends by itself with an error."""
    command = [sys.executable, "-m", "studies", "campaign", str(file), "--folder", str(folder)]
    folder.mkdir(parents=True, exist_ok=True)
    said = folder / "said.txt"
    with said.open("wb") as out:
        flying = subprocess.Popen(command, start_new_session=True, stdout=out, stderr=out)
    while True:
        try:
            code = flying.wait(POLL_S)
        except subprocess.TimeoutExpired:
            if cut():
                os.killpg(flying.pid, signal.SIGKILL)
                flying.wait()
                return True
        else:
            break
    if code != 0:
        raise RuntimeError(said.read_text(encoding="utf-8", errors="replace"))
    return False


def parts(folder: Path) -> int:
    """Number of files of rows that are not merged yet."""
    return sum(1 for _ in (folder / PARTS).glob("*.parquet"))


def given(file: str, seeds: int, folder: Path) -> tuple[Path, int]:
    """The campaign's file with so many seeds, and without a rule to stop; the number of its flights."""
    tables: dict[str, Any] = toml_files.load(toml_files.find("campaigns", file), dict)
    tables.pop("stop", None)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{tables['name']}.toml"
    path.write_text(toml({**tables, "seeds": seeds}), encoding="utf-8")
    campaign = files.load(path)
    return path, len(campaign.jobs(campaign.setups(), folder))


def compare(file: str, seeds: int, folder: Path) -> dict[str, Any]:
    """Fly both. Raises RuntimeError if one of them ends with an error, or the other before it was killed."""
    path, count = given(file, seeds, folder)
    name = path.stem
    tables = {each: folder / each / name for each in (UNDISTURBED, KILLED)}
    killed_at = len(read(tables[KILLED]))
    if killed_at < count:
        if not fly(path, folder / KILLED, lambda: parts(tables[KILLED]) >= (count + 2) // 3):
            raise RuntimeError("the campaign ended before it was killed")
        killed_at = len(read(tables[KILLED]))
    for each in (KILLED, UNDISTURBED):
        fly(path, folder / each)
    rows = {each: read(tables[each]) for each in tables}
    return {
        "flights": count,
        "rows_when_killed": killed_at,
        "rows": {each: len(found) for each, found in rows.items()},
        "digests": {each: digest(found) for each, found in rows.items()},
        "reached": sum(row.succeeded for row in rows[KILLED]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="?", default="forest", help="a name in campaigns/, or a path")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--folder", type=Path, help="kept, and gone on with; none: a new one that is removed")
    arguments = parser.parse_args()
    with TemporaryDirectory() as new:
        result = compare(arguments.file, arguments.seeds, arguments.folder or Path(new))
    print(json.dumps(result, indent=1))  # noqa: T201
    equal = len(set(result["digests"].values())) == 1
    sys.exit(0 if equal and set(result["rows"].values()) == {result["flights"]} else 1)


if __name__ == "__main__":
    main()
