"""A campaign on two local workers, one of which is killed meanwhile: `python -m studies.campaigns.smoke [FILE]`.

Exit code 1 if a row is missing, there twice or other than that of a flight, or if the worker was not killed.
"""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from distributed import Client

from protocol import toml_files
from studies.campaign import Row
from studies.campaigns import files
from studies.campaigns.runner import Campaign
from studies.campaigns.table import digest
from studies.engine import cluster

WORKERS = 2


def fly(file: str, folder: Path) -> tuple[list[Row], int]:
    """Fly a campaign into a folder, and kill a worker, which is busy with a flight, at a third; its rows, and the
    number of workers that there were. Raises EngineError and TomlFileError."""
    given = files.load(toml_files.find("campaigns", file))
    campaign = Campaign(given.jobs(given.setups(), folder), folder, given.stopping)
    with cluster(workers=WORKERS) as client:
        seen = _workers(client)
        for number, _ in enumerate(campaign.fly(client, given.wall_limit_s), start=1):
            if number == (len(campaign.jobs) + 2) // 3:
                os.kill(min(seen), signal.SIGKILL)
            seen |= _workers(client)
    return campaign.finish(), len(seen)


def _workers(client: Client) -> set[int]:
    """Their processes."""
    return {nanny.pid for nanny in client.cluster.workers.values() if nanny.pid}


def wrong(file: str, rows: list[Row], workers: int) -> Iterator[str]:
    """What is not as it should be."""
    given = files.load(toml_files.find("campaigns", file))
    asked = sorted(job.key for job in given.jobs(given.setups(), Path()))
    if [row.key for row in rows] != asked:
        yield f"{len(rows)} rows of {len(asked)} flights"
    yield from (f"{row.key}: {row.outcome}" for row in rows if row.simulated_s == 0.0)
    if workers <= WORKERS:
        yield "no worker came in place of the one that was killed"


def main() -> None:
    file = sys.argv[1] if len(sys.argv) > 1 else "smoke"
    with TemporaryDirectory() as folder:
        rows, workers = fly(file, Path(folder))
    problems = list(wrong(file, rows, workers))
    reached = sum(row.succeeded for row in rows)
    print(f"{len(rows)} flights, {reached} reached their goal, {workers} workers, {digest(rows)}")  # noqa: T201
    sys.exit("\n".join(problems) or None)


if __name__ == "__main__":
    main()
