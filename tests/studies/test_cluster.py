"""Campaigns on a cluster that dask's own command lines started, and campaigns that are killed and go on."""

from pathlib import Path

import pytest
from distributed import Client

from protocol import toml_files as toml_files
from studies import campaign
from studies.campaigns import files, resume
from studies.campaigns.runner import Campaign
from studies.campaigns.table import digest
from studies.engine import cluster
from tests.studies.clusters import NoNamespaceError, by_command_lines

WORKERS = 4
FOUR = "tests/data/campaign.toml"


def test_four_workers_one_of_them_in_a_network_of_its_own_fly_the_same_rows(tmp_path: Path) -> None:
    given = files.load(toml_files.find("campaigns", FOUR))
    jobs = given.jobs(given.setups(), tmp_path / "cluster")
    try:
        with by_command_lines(tmp_path, WORKERS) as (file, inside):
            with Client(scheduler_file=str(file), timeout="120s") as waiting:
                waiting.wait_for_workers(WORKERS, timeout=300)
                address = waiting.scheduler.address
            with cluster(address) as client:
                client.get_task_stream()  # from now on it is kept
                flying = Campaign(jobs, tmp_path / "cluster")
                rows = list(flying.fly(client))
                flew = {entry["worker"] for entry in client.get_task_stream()}
    except NoNamespaceError as error:
        pytest.skip(f"no network namespace: {error}")
    assert sorted(row.seed for row in rows) == [1, 2, 3, 4]
    assert any(inside in worker for worker in flew)
    alone = [campaign.fly(job) for job in given.jobs(given.setups(), tmp_path / "alone")]
    assert digest(flying.finish()) == digest(alone)


def test_a_campaign_killed_with_its_workers_goes_on_to_the_same_rows(tmp_path: Path) -> None:
    found = resume.compare("forest", 6, tmp_path)
    assert 2 <= found["rows_when_killed"] < 6 and found["rows"] == {resume.UNDISTURBED: 6, resume.KILLED: 6}
    assert found["digests"][resume.UNDISTURBED] == found["digests"][resume.KILLED]
