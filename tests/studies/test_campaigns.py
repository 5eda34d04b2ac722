"""Campaigns: who dies, hangs or throws costs a row and no other; tables that resume; files; two campaigns compared."""

import dataclasses
import errno
import io
import itertools
import logging
import os
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pyarrow as pa
import pytest
from dask.utils import parse_timedelta
from distributed import Client, Future, LocalCluster, as_completed
from pyarrow import parquet
from scipy import stats
from typer.testing import CliRunner

from protocol.toml_files import ROOT, TomlFileError, convert
from studies import engine, worlds
from studies.campaign import Job, Row, Setup
from studies.campaigns import command, files, page, smoke
from studies.campaigns.runner import Campaign, Case, Flown, Stop, lost
from studies.campaigns.statistics import compared, paired, wilson
from studies.campaigns.table import ENDS, MERGED, PARTS, Table, TableError, alone, counting, digest, read, write
from studies.engine import EngineError, Failed, as_they_end, cluster, in_order
from tests.studies.harm import harmful, late, once

POLE = Setup("pole", "pole", worlds.pole, (3.0,))


def jobs(seeds: int, folder: Path, **changes: object) -> list[Job]:
    return [Job(dataclasses.replace(POLE, **changes), "none", 3.0, seed, folder) for seed in range(1, seeds + 1)]  # type: ignore[arg-type]


def flown(job: Job, **changes: object) -> Row:
    """A row as of a flight that arrived; its values differ by the seed."""
    row = dataclasses.replace(lost(job, "reached"), least_clearance=0.1 * job.seed, route_s=10.0, wall_s=time.time())
    return dataclasses.replace(row, **changes)  # type: ignore[arg-type]


# --- the engine ---


def test_who_dies_hangs_or_throws_costs_a_row_and_no_other(tmp_path: Path) -> None:
    with cluster(workers=2) as client:
        ((free,),) = as_they_end(client, abs, [-1], limit_s=1e300)
        assert free.result == 1, "beyond what a clock can wait for"
        ended = [done for batch in as_they_end(client, harmful, range(9), limit_s=4.0) for done in batch]
        (second,) = itertools.chain.from_iterable(as_they_end(client, once, [tmp_path / "marker"]))
        assert list(in_order(client, abs, [-3, 2, -1])) == [3, 2, 1]
    expected: dict[int, int | Failed] = {number: number * number for number in range(9)}
    expected[2] = Failed("its worker died")
    expected[4] = Failed("raised ValueError('four')")
    expected[6] = Failed("no end after 4 s")
    assert {done.job: done.result for done in ended} == expected and len(ended) == 9
    assert isinstance(second.result, int) and second.result != os.getpid()


def test_a_result_that_is_lost_with_its_worker_is_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Slow(as_completed):  # type: ignore[misc]
        """Its first batch is handed on when the result in it is there no more."""

        first = True

        def next_batch(self, *arguments: Any, **options: Any) -> list[Future]:
            batch: list[Future] = super().next_batch(*arguments, **options)
            while self.first and batch[0].status == "finished":
                os.sched_yield()
            self.first = False
            return batch

    monkeypatch.setattr(engine, "as_completed", Slow)
    with cluster(workers=1) as client:
        (done,) = itertools.chain.from_iterable(as_they_end(client, late, [tmp_path / "marker"]))
    assert isinstance(done.result, int) and done.result != os.getpid()


def test_most_workers_may_go_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """More jobs are flying then than there are workers."""
    counts = iter([20])
    monkeypatch.setattr(engine, "slots", lambda client: next(counts, 1))
    with cluster(workers=2) as client:
        ended = [done.result for batch in as_they_end(client, abs, range(40)) for done in batch]
    assert Counter(ended) == Counter(range(40))


def test_what_dask_says_of_a_scheduler_that_goes_away_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its client writes pages of it on standard error, beside the one line of ours."""
    shown, logger = io.StringIO(), logging.getLogger("distributed")
    monkeypatch.setattr(logger, "handlers", [logging.StreamHandler(shown)])
    with LocalCluster(1, processes=False, dashboard_address=None) as local, cluster(local.scheduler_address):
        logger.error("lost the connection")
    assert shown.getvalue() == ""
    logger.error("said")
    assert shown.getvalue() == "said\n"


@pytest.mark.parametrize("scheme", ["tls", "ucx"])
def test_an_address_that_needs_what_is_not_there_is_an_error_of_ours(scheme: str) -> None:
    with pytest.raises(EngineError, match=f"^{scheme}://127.0.0.1:1: "):
        cluster(f"{scheme}://127.0.0.1:1").__enter__()


def test_workers_that_die_again_and_again_are_not_given_up() -> None:
    """dask gives up a worker that is away so long after one of its deaths, be it for the next: then all jobs hang."""
    with cluster(workers=1):
        away = parse_timedelta(dask.config.get("distributed.deploy.lost-worker-timeout"))
    assert away > 1000 * engine.LIMIT_S


# --- the table ---


def test_a_table_is_the_same_in_whatever_order_flights_ended(tmp_path: Path) -> None:
    todo = jobs(7, tmp_path)
    tables = []
    for name, order in (("a", todo), ("b", [todo[i] for i in (3, 0, 6, 1, 5, 2, 4)])):
        table = Table(tmp_path / name)
        for job in order:
            table.add([flown(job)])
        assert len(list((tmp_path / name / PARTS).iterdir())) == 7
        rows = table.finish()
        assert not list((tmp_path / name / PARTS).iterdir()) and rows == read(tmp_path / name)
        tables.append(rows)
    assert [row.seed for row in tables[0]] == list(range(1, 8))
    assert digest(tables[0]) == digest(tables[1]) == digest(reversed(tables[1]))
    assert digest([dataclasses.replace(tables[0][0], top_speed=1.0), *tables[0][1:]]) != digest(tables[0])


def test_a_table_that_was_killed_while_it_merged_is_whole(tmp_path: Path) -> None:
    """Rows are in both files then; what was being written has no name yet."""
    todo = jobs(3, tmp_path)
    table = Table(tmp_path)
    table.add([flown(job) for job in todo[:2]])
    write([flown(job) for job in todo[:2]], tmp_path / MERGED)
    (tmp_path / PARTS / "00000002.unfinished").write_bytes(b"PAR1")
    again = Table(tmp_path)
    again.add([flown(todo[2])])
    assert [row.seed for row in again.finish()] == [1, 2, 3]


def test_rows_of_other_code_or_settings_are_flown_anew(tmp_path: Path) -> None:
    (job,) = jobs(1, tmp_path)
    Table(tmp_path).add([flown(job)])
    assert Table(tmp_path).row(job) is not None
    for changed in (
        dataclasses.replace(job, overrides=("limits.tilt_deg=20.0",)),
        dataclasses.replace(job, setup=dataclasses.replace(POLE, fault="loss, 40 %")),
        dataclasses.replace(job, setup=dataclasses.replace(POLE, site=worlds.gap)),
    ):
        assert changed.key == job.key and Table(tmp_path).row(changed) is None
    Table(tmp_path).add([flown(changed)])
    assert Table(tmp_path).row(changed) is not None and Table(tmp_path).row(job) is None


MISSION = """
name = "mine"
takeoff_height = 3.0
world = "{world}"

[[waypoints]]
north = {north}
east = 0.0
height = 3.0
"""


def test_rows_of_a_file_that_was_changed_are_flown_anew(tmp_path: Path) -> None:
    """The user's own, which are none of the project's."""
    mission, vehicle, sensors = (tmp_path / f"{name}.toml" for name in ("mine", "quad", "gnss"))
    vehicle.write_bytes((ROOT / "vehicles" / "paper_quad.toml").read_bytes())
    sensors.write_bytes((ROOT / "vehicles" / "sensors" / "gnss.toml").read_bytes())
    mission.write_text(MISSION.format(north=10.0, world="empty"), encoding="utf-8")
    chosen = {"name": str(vehicle), "set": [f'estimator.sensors="{sensors}"']}

    def job() -> Job:
        one = given(place=[{"mission": str(mission)}], vehicle=[chosen], seeds=1)
        return one.jobs(one.setups(), tmp_path)[0]

    for file, text in (
        (mission, MISSION.format(north=20.0, world="empty")),
        (vehicle, vehicle.read_text(encoding="utf-8") + "# another"),
        (sensors, sensors.read_text(encoding="utf-8") + "# another"),
    ):
        Table(tmp_path).add([flown(before := job())])
        assert Table(tmp_path).row(job()) is not None
        file.write_text(text, encoding="utf-8")
        assert job().key == before.key and Table(tmp_path).row(job()) is None, file.name


# --- a campaign ---


def outcome(job: Job) -> Flown:
    """Two of three arrive, and keep a file otherwise."""
    good = job.seed % 3 > 0
    row = flown(job, outcome="reached" if good else "contact", log=None if good else f"failed/{job.seed}")
    return Flown(row, {} if good else {f"failed/{job.seed}/mission.toml": b'world = "/far/away/w.toml"'}, "/far/away")


def test_a_campaign_that_is_cut_off_goes_on_and_flies_nothing_twice(tmp_path: Path) -> None:
    campaign = Campaign(jobs(30, tmp_path), tmp_path)
    with (
        LocalCluster(2, threads_per_worker=1, processes=False, dashboard_address=None) as local,
        Client(local) as client,
    ):
        for _ in itertools.islice(campaign.fly(client, fly=outcome), 10):
            pass
        campaign = Campaign(jobs(30, tmp_path), tmp_path)
        before = {job.seed for job in campaign.jobs} - {job.seed for job in campaign.todo}
        assert len(before) in (10, 11), "a batch may hold two"
        after = [row.seed for row in campaign.fly(client, fly=outcome)]
    rows = campaign.finish()
    assert sorted([*before, *after]) == [row.seed for row in rows] == list(range(1, 31))
    assert digest(rows) == digest(outcome(job).row for job in jobs(30, tmp_path))
    assert f'world = "{tmp_path}/w.toml"' == (tmp_path / "failed" / "30" / "mission.toml").read_text()


def test_a_case_is_over_by_its_first_seeds_alone(tmp_path: Path) -> None:
    todo, table = jobs(200, tmp_path), Table(tmp_path)
    stop = Stop(0.2, at_least=10)
    rows = [outcome(job).row for job in todo]
    wins = list(itertools.accumulate(row.succeeded for row in rows))
    enough = next(n for n in range(10, 201) if np.ptp(wilson(wins[n - 1], n)) <= 0.2)
    table.add(rows[1 : enough + 20])
    case = Case(todo, stop)
    case.update(table)
    assert not case.over and case.flown == 0, "the first one is still in the air"
    table.add(rows[:1])
    case.update(table)
    assert case.over and case.rows(table) == rows[:enough] and enough > 50
    assert Campaign(todo, tmp_path, stop).todo == []
    assert len(Campaign(todo, tmp_path).todo) == 200 - enough - 20


def test_what_was_in_the_air_when_there_were_enough_is_not_compared(tmp_path: Path) -> None:
    """Nor is what other code flew beyond the end: all that count are of one version."""
    todo, stop = jobs(12, tmp_path), Stop(1.0, at_least=4)
    Table(tmp_path).add([dataclasses.replace(flown(job), code="other") for job in todo[6:]])
    campaign = Campaign(todo, tmp_path, stop)
    with (
        LocalCluster(3, threads_per_worker=1, processes=False, dashboard_address=None) as local,
        Client(local) as client,
    ):
        list(campaign.fly(client, fly=outcome))
    count = campaign.finish()
    assert [row.seed for row in count] == [1, 2, 3, 4] and len(read(tmp_path)) > 4
    assert counting(tmp_path) == count
    Campaign(todo, tmp_path, None)
    with pytest.raises(TableError, match="of two versions"):
        counting(tmp_path)
    (tmp_path / ENDS).write_text("torn")
    with pytest.raises(TableError, match=f"{ENDS}: no ends of cases"):
        counting(tmp_path)


def test_a_smoke_on_two_workers_one_of_which_is_killed(tmp_path: Path) -> None:
    rows, workers = smoke.fly("tests/data/campaign.toml", tmp_path)
    assert not list(smoke.wrong("tests/data/campaign.toml", rows, workers))
    assert [row.outcome for row in rows] == ["reached"] * 4


# --- files ---

WIND = "wind.mean_ned=[3.0, 0.0, 0.0]"


def given(**changes: object) -> files.CampaignFile:
    return convert({"name": "test", "place": [{"world": "forest"}], **changes}, files.CampaignFile, "test.toml")


def test_a_file_is_all_combinations(tmp_path: Path) -> None:
    both = given(
        place=[{"world": "forest", "options": {"density": 0.01}}, {"mission": "courier", "set": [WIND]}],
        vehicle=[{}, {"name": "sun_quad", "set": ["body.mass_kg=2.1"]}],
        settings=[{"name": "plain"}, {"name": "slow", "set": ["limits.tilt_deg=20.0"]}],
        faults=["", "loss, 40 %"],
        methods=["astar", "paper"],
        speeds=[3.0, 5.0],
        seeds=3,
        first_seed=7,
    )  # fmt: skip
    todo = both.jobs(both.setups(), tmp_path)
    assert len(todo) == 2**6 * 3 == len({job.key for job in todo})
    assert [job.seed for job in todo[:64]] == [7] * 64, "seed by seed"
    last = todo[-1].setup
    assert (last.mission, last.vehicle, last.fault) == ("courier", "sun_quad", "loss, 40 %")
    assert last.overrides == ("limits.tilt_deg=20.0",) and last.vehicle_overrides == ("body.mass_kg=2.1",)
    site = last.site(1)
    assert site.goal == (120.0, 0.0) and site.world().wind.mean_ned == (3.0, 0.0, 0.0)
    thin = todo[0].setup.site(5)
    assert thin.tables["cylinder"] == worlds.forest(5, density=0.01).tables["cylinder"]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"place": [{"world": "swamp"}]}, "swamp: no such kind of place"),
        (
            {"place": [{"world": "forest", "options": {"wet": 1.0}}]},
            "no such option wet (there: density, diameter, length)",
        ),
        ({"place": [{"mission": "circle"}]}, "circle: a campaign needs a mission with waypoints"),
        ({"place": [{"world": "forest", "set": ["wind.mean=3"]}]}, "wind.mean"),
        ({"place": [{"world": "forest", "options": {"density": 0.0}}]}, "forest, density 0: seed 1 can't be made"),
        ({"place": [{"world": "forest", "options": {"density": -1.0}}]}, "forest, density -1: seed 1 can't be made"),
        ({"place": [{"world": "forest", "options": {"length": -5.0}}]}, "forest, length -5: seed 1 can't be made"),
        ({"place": [{"world": "maze", "options": {"cells": 2.5}}]}, "maze, cells 2.5: seed 1 can't be made"),
        ({"place": [{"mission": "courier", "options": {"density": 0.1}}]}, "courier: options are of a kind of place"),
        ({"place": [{"mission": "curve"}]}, 'curve: a campaign needs a mission with the profile "smooth"'),
        ({"speeds": [3.0, 3.0]}, "speeds: one of them is there twice"),
        ({"speeds": [3.0, 2000.0]}, "<= 1000.0 - at `speeds[1]`"),
        ({"place": [{"world": "forest", "options": {"length": 20000.0}}]}, "<= 10000.0 - at `waypoints[0].north`"),
        ({"methods": ["astar", "none", "astar"]}, "methods: one of them is there twice"),
        ({"settings": [{"name": "a", "set": ["avoidance.method=vfh"]}]}, "avoidance.method is for the key methods"),
        ({"place": [{}]}, "either a world, or a mission"),
        ({"methods": ["swamp"]}, "method 'swamp'"),
        ({"settings": [{"name": "a", "set": ["limits.swamp=1"]}]}, "swamp"),
        ({"faults": ["swamp"]}, "there is no 'swamp'"),
        ({"vehicle": [{"name": "swamp"}]}, "swamp: no such file"),
        ({"settings": [{"name": "a"}, {"name": "a"}]}, "two cases are the same"),
        ({"place": []}, "place"),
        ({"sedes": 3}, "sedes"),
    ],
)
def test_what_can_not_be_flown_is_said_before_anything_is(changes: dict[str, object], says: str) -> None:
    with pytest.raises(TomlFileError) as raised:
        given(**changes).setups()
    assert says in str(raised.value)


def test_a_world_that_can_not_be_read_is_said_before_anything_is_flown(tmp_path: Path) -> None:
    world, mission = tmp_path / "broken.toml", tmp_path / "mine.toml"
    world.write_text("name = ", encoding="utf-8")
    mission.write_text(MISSION.format(north=10.0, world=world), encoding="utf-8")
    with pytest.raises(TomlFileError, match=r"broken\.toml: Invalid value"):
        given(place=[{"mission": str(mission)}]).setups()


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(command.app, ["fly", "swamp"])
    assert done.exit_code == command.UNUSABLE and done.output.count("\n") == 1
    assert "swamp: no such file" in done.output and "forest" in done.output


# --- the page ---


def test_the_page_has_intervals_distributions_and_the_worst_flights_first(tmp_path: Path) -> None:
    todo = jobs(6, tmp_path)
    rows = [outcome(job).row for job in todo[:5]] + [lost(todo[5], "its worker died")]
    text = page.write("Campaign test", "campaign test", tmp_path, [POLE], rows).read_text()
    assert "| pole, none, 3 m/s | 4 of 6 (30-90 %) |" in text and digest(rows) in text
    worst = [line for line in text.splitlines() if line.startswith("| pole, none, 3 m/s, seed")]
    assert [line.split("|")[1].split()[-1] for line in worst] == ["3", "6", "1", "2", "4", "5"]
    assert "[folder](failed/3/)" in worst[0] and "its worker died" in worst[1]
    assert {path.stem for path in (tmp_path / "pictures").iterdir()} == {"campaign", "distributions"}


# --- two campaigns ---


def sides(tmp_path: Path) -> Iterator[list[Row]]:
    rng = np.random.default_rng(5)
    for wins, shift in ((0.6, 0.0), (0.9, 0.5)):
        yield [
            flown(job, outcome="reached" if rng.random() < wins else "contact",
                  least_clearance=float(rng.normal(2.0 + shift, 0.1)))
            for job in jobs(60, tmp_path)
        ]  # fmt: skip


def test_two_campaigns_are_compared_seed_by_seed(tmp_path: Path) -> None:
    first, second = sides(tmp_path)
    (pairs,) = paired(first, reversed(second[:50]))
    assert [row.seed for row in pairs.first] == [row.seed for row in pairs.second] == list(range(1, 51))
    both = [(a.succeeded, b.succeeded) for a, b in zip(first[:50], second[:50], strict=True)]
    assert pairs.only == (both.count((True, False)), both.count((False, True))) and 0 < pairs.only[0] < pairs.only[1]
    theirs = stats.binomtest(min(pairs.only), sum(pairs.only)).pvalue
    assert pairs.mcnemar == pytest.approx(theirs) and pairs.mcnemar < 0.05
    found = pairs.difference(lambda row: row.least_clearance)
    assert found is not None
    mean, (low, high) = found
    assert low < mean < high < low + 0.2 and abs(mean - 0.5) < 0.1
    assert pairs.difference(lambda row: None) is None and pairs.difference(lambda row: row.route_s) is None


def test_methods_are_paired_by_name_where_there_are_several(tmp_path: Path) -> None:
    first, second = sides(tmp_path)
    other = [dataclasses.replace(row, method="paper") for row in second]
    assert [pairs.name for pairs in paired(first, other)] == ["pole, 3 m/s"]
    assert [pairs.name for pairs in paired([*first, *other], other)] == ["pole, paper, 3 m/s"]
    assert paired(first, [dataclasses.replace(row, speed=4.0) for row in first]) == []


def test_many_flights_are_compared_in_little_memory(tmp_path: Path) -> None:
    (job,), rng = jobs(1, tmp_path), np.random.default_rng(1)
    rows = [dataclasses.replace(flown(job), seed=seed, least_clearance=float(rng.normal())) for seed in range(5000)]
    (pairs,) = paired([dataclasses.replace(row, least_clearance=0.0) for row in rows], rows)
    tracemalloc.start()
    try:
        found = pairs.difference(lambda row: row.least_clearance)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found is not None and found[1].low < 0.0 < found[1].high
    assert most < 200e6, "all samples at once are 800 MB"


def test_rows_of_two_versions_are_not_compared(tmp_path: Path) -> None:
    for name, rows in zip("ab", sides(tmp_path), strict=True):
        write(rows, tmp_path / name / MERGED)
    Table(tmp_path / "b").add([dataclasses.replace(row, code="other") for row in read(tmp_path / "b")[:10]])
    for order in ("ab", "ba"):
        done = CliRunner().invoke(command.app, ["compare", *(str(tmp_path / name) for name in order)])
        assert done.exit_code == command.UNUSABLE and done.output.count("\n") == 1
        assert f"{tmp_path / 'b'}: pole, none, 3 m/s: its rows are of two versions" in done.output


def test_a_table_that_is_none_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    for columns in ({}, {"setup": ["pole"]}):
        parquet.write_table(pa.table(columns), tmp_path / "a" / MERGED)
        if not columns:
            (tmp_path / "a" / MERGED).write_bytes(b"torn")
        for arguments in (["compare", str(tmp_path / "a"), str(tmp_path / "a")],
                          ["fly", "smoke", "--folder", str(tmp_path / "a" / MERGED)]):  # fmt: skip
            done = CliRunner().invoke(command.app, arguments)
            assert done.exit_code == command.UNUSABLE and done.output.count("\n") == 1
            assert str(tmp_path / "a" / MERGED) in done.output


def test_a_campaign_that_is_begun_twice_at_once_is_refused(tmp_path: Path) -> None:
    """Both would number their parts alike, so that each lost rows of the other."""
    with alone(tmp_path / "smoke"):
        done = CliRunner().invoke(command.app, ["fly", "smoke", "--folder", str(tmp_path)])
    assert done.exit_code == command.UNUSABLE and done.output.count("\n") == 1
    assert f"{tmp_path / 'smoke'}: another campaign is flying into it" in done.output
    with alone(tmp_path / "smoke"):
        assert not (tmp_path / "smoke" / PARTS).exists()


def test_comparing_is_one_command(tmp_path: Path) -> None:
    for name, rows in zip("ab", sides(tmp_path), strict=True):
        write(rows, tmp_path / name / MERGED)
    done = CliRunner().invoke(command.app, ["compare", str(tmp_path / "a"), str(tmp_path / "b")])
    assert done.exit_code == 0 and done.output.splitlines() == compared(*(read(tmp_path / name) for name in "ab"))
    assert "McNemar p = " in done.output and "least clearance (m): second - first = +0." in done.output
    (tmp_path / "none").mkdir()
    assert CliRunner().invoke(command.app, ["compare", str(tmp_path / "a"), str(tmp_path / "none")]).exit_code == 2
    slip = CliRunner().invoke(command.app, ["compare", str(tmp_path / "a"), str(tmp_path / "bb")])
    assert (slip.exit_code, slip.output) == (2, f"campaign: {tmp_path / 'bb'}: no such folder\n")


def test_a_disk_that_is_full_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(rows: object, path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("studies.campaigns.table.write", full)
    file = tmp_path / "one.toml"
    file.write_text('name = "one"\nseeds = 1\nmethods = ["none"]\n[[place]]\nworld = "pole"\n', encoding="utf-8")
    one = files.load(file)
    (job,) = one.jobs(one.setups(), tmp_path)
    folder = tmp_path / "logs" / "one"
    write([dataclasses.replace(flown(job), code=job.code)], folder / PARTS / "00000001.parquet")
    done = CliRunner().invoke(command.app, ["fly", str(file), "--folder", str(folder.parent)])
    assert done.exit_code == command.FAILED, done.output
    assert done.output.splitlines()[-1] == f"campaign: {folder / MERGED}: No space left on device"


@pytest.mark.parametrize(
    ("words", "says"), [(["fly", "smoke"], "goes on from here"), (["search", "popup-search"], "from the beginning")]
)
def test_an_interrupt_says_what_the_same_command_does(
    words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*asked: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("studies.engine.cluster", interrupted)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(command.app, words)
    assert done.exit_code == command.ABANDONED and says in done.output.splitlines()[-1]


def test_a_search_that_could_keep_nothing_is_refused_before_anything_flies(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = CliRunner().invoke(command.app, ["search", "popup-search", "--into", str(tmp_path / "file")])
    assert (done.exit_code, done.output) == (command.UNUSABLE, f"campaign: {tmp_path / 'file'}: File exists\n")
