"""The search for failures: its file, its score, its samplers, and what it finds as a file."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from protocol.toml_files import TomlFileError
from studies import worlds
from studies.campaign import Job, Setup
from studies.campaigns import files, search
from studies.campaigns.runner import Flown, lost
from studies.campaigns.search import SAMPLERS, SearchFile, Tried, keep, score
from studies.engine import Done

FILE = """
name = "near"
speeds = ["{speed}"]

[[place]]
world = "popup"
options = { ahead = "{ahead}" }
set = ["wind.mean_ned=[{along}, 0.0, 0.0]"]

[[vehicle]]
set = ["telemetry.delay_s={late}"]

[search]
budget = 20

[search.ranges]
ahead = [2.0, 3.0]
speed = [1.0, 4.0]
along = [-5.0, 5.0]
late = [0.0, 0.05]
"""
VALUES = {"ahead": 2.25, "speed": 3.5, "along": -1.5, "late": 0.02}


def written(folder: Path, text: str = FILE) -> Path:
    path = folder / "near.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_found_is_a_file_that_is_that_flight(tmp_path: Path) -> None:
    found = SearchFile.load(written(tmp_path))
    tried = Tried(7, VALUES, 42, -1.0, "contact", found.filled("near-7", VALUES, 42))
    again = files.load(keep(tried, tmp_path / "campaigns"))
    assert again == found.flight("near-7", VALUES, 42)
    (job,) = again.jobs(again.setups(), tmp_path)
    assert (job.seed, job.speed, job.setup.vehicle_overrides) == (42, 3.5, ("telemetry.delay_s=0.02",))
    site = job.setup.site(42)
    assert site.world().wind.mean_ned == (-1.5, 0.0, 0.0)
    assert site.tables["cylinder"] == worlds.pop_up(42, ahead=2.25).tables["cylinder"]


def test_no_search_writes_over_what_another_one_has_found(tmp_path: Path) -> None:
    found, paths = SearchFile.load(written(tmp_path)), []
    for seed in (42, 43, 42):
        tried = Tried(7, VALUES, seed, -1.0, "contact", found.filled("near-7", VALUES, seed))
        paths.append(keep(tried, tmp_path / "campaigns"))
    assert [path.stem for path in paths] == ["near-7", "near-7_2", "near-7"]
    again = [files.load(path) for path in paths]
    assert [(each.name, each.first_seed) for each in again] == [("near-7", 42), ("near-7_2", 43), ("near-7", 42)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (FILE.replace("[2.0, 3.0]", "[3.0, 3.0]"), "ahead: 3.0 is not below 3.0"),
        (FILE.replace("late = [", "extra = [1.0, 2.0]\nlate = ["), "extra is not in the rest of the file"),
        (
            f'{FILE}near = [0.1, 0.9]\n[[settings]]\nname = "near"\nset = ["avoidance.guard.keep_out={{near}}"]\n',
            "astar: avoidance.guard.keep_out 0.1: less than avoidance.vehicle_radius",
        ),
        (FILE.replace("late = [0.0, 0.05]", ""), "late is not in the table search.ranges"),
        (FILE.replace("budget", "bugdet"), "bugdet"),
        (FILE.split("[search]")[0], "no table [search]"),
        (FILE.replace('"near"', '"near"\nmethods = ["astar", "none"]'), "one place, vehicle, settings, fault, method"),
        (FILE.replace('name = "near"', ""), "missing required field `name`"),
        (FILE.replace('"near"', '"far/near"'), "at `name`"),
    ],
)
def test_what_can_not_be_searched_is_said_before_anything_flies(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(TomlFileError) as raised:
        SearchFile.load(written(tmp_path, text))
    assert says in str(raised.value)


def test_a_search_keeps_to_its_budget_to_its_time_and_to_its_ranges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def fly(client: object, function: object, jobs: list[Job], limit_s: float) -> Iterator[list[Done[Job, Flown]]]:
        asked.append((len(jobs), limit_s))
        rows = (dataclasses.replace(lost(job, "reached"), least_clearance=1.0, route_s=1.0) for job in jobs)
        yield [Done(job, Flown(row, {}, "")) for job, row in zip(jobs, rows, strict=True)]

    monkeypatch.setattr(search, "as_they_end", fly)
    far = FILE.replace("[2.0, 3.0]", "[10001.0, 10002.0]").replace('"near"', '"near"\nwall_limit_s = 30.0')
    tried = list(search.search(SearchFile.load(written(tmp_path, far)), "cma", None))
    assert [each.number for each in tried] == list(range(1, 21)) and asked == [(8, 30.0), (8, 30.0), (4, 30.0)]
    ahead = {each.values["ahead"] for each in tried}
    assert len(ahead) > 10 and min(ahead) >= 10001.0 and max(ahead) <= 10002.0


def test_the_score_falls_towards_contact_and_towards_the_end_of_time() -> None:
    job = Job(Setup("pole", "pole", worlds.pole, (3.0,)), "none", 3.0, 1, Path())
    row = dataclasses.replace(lost(job, "reached"), least_clearance=0.8, route_s=12.0)
    assert score(row, 60.0) == 0.8
    assert score(dataclasses.replace(row, least_clearance=None), 60.0) == pytest.approx(1.6)
    assert score(dataclasses.replace(row, route_s=54.0), 60.0) == pytest.approx(0.2)
    assert 0.0 < score(dataclasses.replace(row, route_s=60.0), 60.0) < 1e-3
    assert score(dataclasses.replace(row, outcome="contact"), 60.0) == -1.0


def nearest(sampler: str, seed: int) -> float:
    """The least of a bowl, whose bottom is in a corner, after 80 points."""
    ask, tell = SAMPLERS[sampler](4, seed)
    best = np.inf
    for _ in range(10):
        points = ask()
        scores = [float(np.linalg.norm(point - (0.1, 0.9, 0.1, 0.9))) for point in points]
        assert len(points) == 8 and all((point >= 0.0).all() and (point <= 1.0).all() for point in points)
        tell(points, scores)
        best = min(best, *scores)
    return best


def test_the_optimiser_comes_nearer_than_chance() -> None:
    by_cma, at_random = ([nearest(sampler, seed) for seed in range(1, 6)] for sampler in ("cma", "random"))
    assert np.median(by_cma) < 0.5 * np.median(at_random)
    assert nearest("cma", 1) == nearest("cma", 1)
