"""Which rows of a campaign's folder count: those of its file, as it is now."""

import dataclasses
import errno
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from studies import worlds
from studies.campaign import Job, Setup
from studies.campaigns import command
from studies.campaigns.runner import Campaign, lost
from studies.campaigns.table import ENDS, PARTS, Table, counting, naming, read

POLE = Setup("pole", "pole", worlds.pole, (3.0,))


def jobs(folder: Path, first: int, last: int, name: str = "pole") -> list[Job]:
    setup = dataclasses.replace(POLE, name=name)
    return [Job(setup, "none", 3.0, seed, folder) for seed in range(first, last + 1)]


def flown(folder: Path, todo: list[Job]) -> None:
    """All of them arrived."""
    Table(folder).add([lost(job, "reached") for job in todo])


@pytest.mark.parametrize(
    ("now", "name"), [((1, 2), "pole"), ((2, 5), "pole"), ((4, 9), "pole"), ((1, 5), "renamed"), ((7, 9), "pole")]
)
def test_what_the_file_has_no_more_does_not_count(now: tuple[int, int], name: str, tmp_path: Path) -> None:
    flown(tmp_path, jobs(tmp_path, 1, 5))
    campaign = Campaign(jobs(tmp_path, *now, name), tmp_path)
    flown(tmp_path, campaign.todo)
    again = Campaign(jobs(tmp_path, *now, name), tmp_path)
    page = again.finish()
    assert [row.seed for row in page] == list(range(now[0], now[1] + 1))
    assert counting(tmp_path) == page and len(read(tmp_path)) >= 5


def test_two_campaigns_are_compared_by_their_files(tmp_path: Path) -> None:
    for name, last in (("a", 1), ("b", 2)):
        folder = tmp_path / name
        flown(folder, jobs(folder, 1, 2))
        Campaign(jobs(folder, 1, last), folder)
    done = CliRunner().invoke(command.app, ["compare", str(tmp_path / "a"), str(tmp_path / "b")])
    assert done.exit_code == 0 and "1 of 1" in done.output and "of 2" not in done.output, done.output


def test_a_full_disk_is_said_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the library of the table nor Python says which file it was."""

    def full(*arguments: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, "Error writing bytes to file")

    (job,), table = jobs(tmp_path, 1, 1), Table(tmp_path)
    monkeypatch.setattr(parquet, "write_table", full)
    monkeypatch.setattr(Path, "write_text", full)
    writes: dict[str, Callable[[], None]] = {
        f"{PARTS}/00000001.parquet": lambda: table.add([lost(job, "reached")]),
        ENDS: lambda: table.end({job.key[:3]: (1, 1)}),
    }
    for path, write in writes.items():
        with pytest.raises(OSError, match="No space left on device") as raised:
            write()
        assert raised.value.filename == str(tmp_path / path)


@pytest.mark.parametrize(
    "refusal",
    [OSError(errno.EACCES, "Permission denied", "/else/where"), OSError("the library says nothing but this")],
)
def test_what_says_itself_which_file_it_was_or_what_was_wrong_stays(refusal: OSError, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"/else/where|nothing but this") as raised, naming(tmp_path):
        raise refusal
    assert raised.value is refusal


@pytest.mark.parametrize("ends", [None, [], [["pole", "none", 3.0, 4]]])
def test_all_rows_of_an_older_campaign_count(ends: list[object] | None, tmp_path: Path) -> None:
    flown(tmp_path, jobs(tmp_path, 1, 5))
    if ends is not None:
        (tmp_path / ENDS).write_text(json.dumps(ends), encoding="utf-8")
    assert len(counting(tmp_path)) == 5


def test_all_rows_of_a_study_count(tmp_path: Path) -> None:
    """Its page tells of all that was flown before, too."""
    flown(tmp_path, jobs(tmp_path, 1, 5))
    Campaign(jobs(tmp_path, 1, 2), tmp_path, alone=False)
    assert len(counting(tmp_path)) == 5
