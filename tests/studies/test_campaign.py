"""Campaigns: one flight a row, failures that can be flown again, and that memory and wire are the same flight."""

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.stats import binomtest
from typer.testing import CliRunner

from companion.events import Datagram
from companion.logs.replay import replay
from companion.runtime.files import load_mission
from protocol.flightlog import Direction, datagrams, digest
from studies import __main__ as command_line
from studies import barn, campaign, style, worlds
from studies.campaign import Job, Row, Setup
from studies.campaign_report import Floor, _successes, fly_and_tell
from studies.campaigns.files import PlaceTable, place_at
from studies.campaigns.statistics import wilson
from studies.campaigns.table import TIMINGS, read, write
from studies.escape import Abilities, avoidable
from studies.joined import Joined
from studies.report import Choice, Report, markdown
from tests.flights.processes import run
from vehicle_sim.timing import TICK_NS
from vehicle_sim.world import World

POP_UP = Setup("popup", "pillar", worlds.pop_up, (3.0,), 60.0, 20)
FOREST = Setup("forest25", "forest", worlds.forest, (3.0,), 60.0)


def row(**changes: Any) -> Row:
    plain = Row(
        setup="forest25", method="astar", speed=3.0, seed=1, outcome="reached", met=None, avoidable=None,
        contact_speed=None, route_s=10.0, path_m=41.0, straight_m=40.0, shortest_m=None, goal_speed=3.8,
        top_speed=5.0, least_clearance=1.2, blocked_share=0.1, guarded_share=None, simulated_s=20.0, wall_s=2.0,
        log=None,
    )  # fmt: skip
    return dataclasses.replace(plain, **changes)


def test_joined_is_the_same_flight_as_two_processes_over_udp(tmp_path: Path) -> None:
    """On the way a pillar appears: what the world does late is part of it."""
    site = worlds.pop_up(4)
    _, mission_file = site.save(tmp_path, speed=3.0)
    done = run("companion", "demo", str(mission_file), "--seed", "4", "--log", str(tmp_path / "logs"), "--no-report",
               "--sensors", "perfect", "--set", 'avoidance.method="paper"')  # fmt: skip
    (log,) = (tmp_path / "logs").rglob("flight.mcap")
    mission = site.mission(3.0, tmp_path / f"{site.name}.toml")
    joined = Joined(mission, overrides=('avoidance.method="paper"',), seed=4)
    joined.fly()
    heard = [event.data for event in joined.events if isinstance(event, Datagram)]
    said = list(datagrams(log))
    assert len(heard) > 2000, done.stderr
    assert [data for _, direction, _, data in said if direction is Direction.IN] == heard
    assert [data for _, direction, _, data in said if direction is Direction.OUT] == joined.sent
    again = campaign.record(mission_file, mission, ('avoidance.method="paper"',), (), 4, tmp_path / "memory")
    assert digest(again) == digest(log)


def test_a_flight_that_arrives(tmp_path: Path) -> None:
    near = dataclasses.replace(FOREST, site=partial(worlds.forest, length=20.0))
    job = Job(near, "paper", 3.0, 1, tmp_path)
    flown = campaign.fly(job)
    assert flown.succeeded and flown.met is None and flown.log is None
    assert flown.path_m >= flown.straight_m - campaign.GOAL_M - 0.5
    assert flown.goal_speed <= flown.path_speed <= flown.top_speed < 3.5
    assert flown.least_clearance is not None and flown.least_clearance > 0.0
    assert flown.step_us is not None and flown.step_us > 0.0 and flown.way_us is None, "this method has no map"
    again = dataclasses.replace(campaign.fly(job), **{name: getattr(flown, name) for name in TIMINGS})
    assert again == flown
    assert not (tmp_path / "failed").exists()


def test_a_parcel_on_the_way_is_a_part_of_the_way(tmp_path: Path) -> None:
    """The way is over at its last waypoint, which there are more steps before than waypoints."""
    mission = tmp_path / "parcel.toml"
    points = ("north = 6.0\nrelease = true", "north = 2.0\nrelease = true", "north = 10.0")
    places = "".join(f"[[waypoints]]\neast = 0.0\nheight = 3.0\n{point}\n" for point in points)
    mission.write_text(f'name = "parcel"\nworld = "empty"\ntakeoff_height = 3.0\n{places}')
    site = partial(place_at, table=PlaceTable(mission=str(mission)))
    flown = campaign.fly(Job(Setup("parcel", "parcel", site, (3.0,), mission=str(mission)), "none", 3.0, 1, tmp_path))
    assert flown.succeeded and flown.path_m == pytest.approx(flown.straight_m - campaign.GOAL_M, abs=0.2)
    assert flown.straight_m == 18.0


def test_each_case_has_its_own_world_and_mission(tmp_path: Path) -> None:
    """Those of a failure are kept by the same name in its folder: the last one was all that was left."""
    windy = dataclasses.replace(
        FOREST, name="windy", site=partial(place_at, table=PlaceTable("forest", set=("wind.mean_ned=[3, 0, 0]",)))
    )
    jobs = [Job(setup, "none", speed, 1, tmp_path) for setup in (FOREST, windy) for speed in (3.0, 5.0)]
    files = [campaign._prepared(job)[1] for job in jobs]
    flown = [load_mission(str(file))[0] for file in files]
    assert [mission.speed for mission in flown] == [3.0, 5.0, 3.0, 5.0]
    assert [World.load(Path(mission.world)).wind.mean_ned[0] for mission in flown] == [0.0, 0.0, 3.0, 3.0]


def test_names_that_differ_in_any_letter_have_folders_of_their_own(tmp_path: Path) -> None:
    """Each letter outside ASCII was the same "_": the failure of one case was written over that of another."""
    names = ["pole, für", "pole, fär", "pole, f_r", "pole, f r", "pole, 風", "pole, 雨", "pole"]
    cases = [Job(dataclasses.replace(FOREST, name=name), "none", 3.0, 1, tmp_path).case for name in names]
    assert len(set(cases)) == len(names) and all(case.isascii() for case in cases)
    assert cases[-1] == "pole_none_3"


def test_a_contact_is_kept_and_flies_again_to_the_bit(tmp_path: Path) -> None:
    flown = campaign.fly(Job(POP_UP, "none", 3.0, 2, tmp_path))
    assert flown.outcome == "contact" and flown.met == "cylinder 1" and not flown.succeeded
    assert flown.contact_speed == pytest.approx(3.0, abs=0.2)
    assert flown.avoidable is True
    assert flown.log == "failed/popup_none_3_2"
    folder = tmp_path / "failed" / "popup_none_3_2"
    assert {"flight.mcap", "end.png", "end.svg"} <= {path.name for path in folder.iterdir()}
    second = replay(folder / "flight.mcap")
    assert not second.differences and second.flown_s == pytest.approx(flown.simulated_s, abs=0.01)


def test_rows_come_back_from_their_files(tmp_path: Path) -> None:
    jobs = campaign.jobs([FOREST, dataclasses.replace(POP_UP, seeds=2)], ["none", "paper"], 3, tmp_path)
    assert len(jobs) == 2 * 3 + 2 * 2 and len({job.case for job in jobs}) == 4
    made = [
        row(setup=job.setup.name, method=job.method, seed=job.seed, met="tree" if job.seed == 2 else None)
        for job in jobs
    ]
    write(made[:5], tmp_path / "a.parquet")
    write(made[5:], tmp_path / "b.parquet")
    assert read(tmp_path) == sorted(made, key=lambda row: row.key)


@pytest.mark.parametrize(("successes", "total"), [(0, 10), (10, 10), (97, 100), (100, 100), (1, 20)])
def test_wilson_as_scipy_has_it(successes: int, total: int) -> None:
    theirs = binomtest(successes, total).proportion_ci(method="wilson")
    assert wilson(successes, total) == pytest.approx((theirs.low, theirs.high), abs=1e-6)


def test_nothing_is_known_of_no_flights() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


def test_the_score_is_that_of_barn() -> None:
    optimal_s = 20.0 / barn.SPEED
    flight = partial(row, shortest_m=20.0)
    assert barn.score(flight(route_s=0.5 * optimal_s)) == 0.5
    assert barn.score(flight(route_s=4.0 * optimal_s)) == pytest.approx(0.25)
    assert barn.score(flight(route_s=20.0 * optimal_s)) == pytest.approx(0.125)
    assert barn.score(flight(route_s=1.0, outcome="contact")) == 0.0


def test_a_section_holds_its_floors_against_the_default_alone(tmp_path: Path) -> None:
    folder = tmp_path / "logs" / "forest"
    good = [row(seed=seed) for seed in range(1, 101)]
    bad = [row(seed=seed, method="paper", outcome="contact", met="tree") for seed in range(1, 11)]
    write([*good[:-2], row(seed=99, outcome="contact", met="tree 7", contact_speed=2.0), good[-1]],
                   folder / "forest25_astar_3.parquet")  # fmt: skip
    write(bad, folder / "forest25_paper_3.parquet")
    report = Report("forest", "Forests", tmp_path, choice=Choice(seeds=0, logs=tmp_path / "logs"))
    cases = fly_and_tell(report, [FOREST], [Floor("forest25", 0.99)])
    assert [(case.method, case.success) for case in cases] == [
        ("astar", "99 of 100 (95-100 %)"),
        ("paper", "0 of 10 (0-28 %)"),
    ]
    (check,) = report.section().checks
    assert check.ok and check.what == "forest, astar, 3 m/s"
    text = markdown(report.section(), "avoidance")
    assert "| forest25, 3 m/s, seed 99 | contact | tree 7 | 2 | - |" in text
    assert (tmp_path / "forest.png").is_file()


def test_a_section_has_the_planners_of_other_packages(tmp_path: Path) -> None:
    """Behind those that are built in; there may be more of them than colours."""
    others = [f"detour{number}" for number in range(len(style.PALETTE))]
    rows = [row(seed=seed, method=method) for method in (*others, "none", "astar") for seed in (1, 2)]
    write(rows, tmp_path / "logs" / "forest" / "forest25.parquet")
    report = Report("forest", "Forests", tmp_path, choice=Choice(seeds=0, logs=tmp_path / "logs"))
    cases = fly_and_tell(report, [FOREST], [])
    assert [(case.method, len(case.rows)) for case in cases] == [(name, 2) for name in ("astar", "none", *others)]
    _, labels = _successes(cases).axes[0].get_legend_handles_labels()
    assert labels == ["astar", "none", *others]


def test_a_section_tells_what_each_stage_takes(tmp_path: Path) -> None:
    """Flights that were timed tell it; older rows, without these columns, are read as before."""
    folder = tmp_path / "logs" / "forest"
    timed = [row(seed=seed, map_us=500.0 + seed, way_us=200.0, space_us=100.0, step_us=150.0) for seed in range(1, 4)]
    write(timed, folder / "forest25_astar_3.parquet")
    untimed = pq.read_table(folder / "forest25_astar_3.parquet").drop_columns(
        ["map_us", "way_us", "space_us", "step_us"]
    )
    untimed = untimed.set_column(1, "method", [["paper"] * 3])
    pq.write_table(untimed, folder / "forest25_paper_3.parquet")
    report = Report("forest", "Forests", tmp_path, choice=Choice(seeds=0, logs=tmp_path / "logs"))
    assert len(fly_and_tell(report, [FOREST], [])) == 2
    text = markdown(report.section(), "avoidance")
    assert "| forest | astar | 3 | 502 | 200 | 100 | 150 |" in text and "| forest | paper | 3 | - |" not in text


ABLE = Abilities(acceleration=5.0, reaction_s=0.2, hull=0.36)


def towards(speed: float, ahead: float, height: float = 10.0) -> bool:
    """Whether a cylinder of 500 m, which nobody gets round, can be avoided that appears so far before the hull's
    centre, in flight at a height (m)."""
    table = {"name": "wall", "center": [520.0, 0.0], "radius": 500.0, "height": 50.0, "appears_within": ahead}
    origin = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
    world = World.from_tables({"name": "test", "origin": origin, "cylinder": [table]}, "test.toml")
    ticks = np.arange(round((20.0 - ABLE.hull) / speed / (TICK_NS * 1e-9)) + 1)
    truth = np.zeros((len(ticks), 17))
    truth[:, 0] = speed * ticks * TICK_NS * 1e-9
    truth[:, 2], truth[:, 3], truth[:, 6] = -height, speed, 1.0
    return avoidable(world, truth, "wall", ABLE, 15.0)


@pytest.mark.parametrize("speed", [2.0, 4.0, 7.0])
def test_what_can_be_stopped_for_is_avoidable_and_nothing_nearer(speed: float) -> None:
    needed = speed * ABLE.reaction_s + speed**2 / (2.0 * ABLE.acceleration) + ABLE.hull
    # moments are looked at every 0.1 s: as much later may be the first after it appeared
    assert towards(speed, needed + 0.1 * speed + 0.05)
    assert not towards(speed, needed - 0.05)


def test_on_the_ground_nothing_is_avoidable() -> None:
    assert towards(2.0, 10.0, height=0.5) and not towards(2.0, 10.0, height=0.49)


def test_a_walker_who_comes_at_a_vehicle_that_hovers_can_be_avoided_unless_it_was_hidden() -> None:
    origin = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
    walker = {
        "name": "walker",
        "center": [12.0, 0.0],
        "radius": 0.3,
        "height": 5.0,
        "route": [[-12.0, 0.0]],
        "speed": 1.5,
    }
    truth = np.zeros((round((12.0 - 0.66) / 1.5 / 0.004), 17))
    truth[:, 2], truth[:, 6] = -2.0, 1.0
    for walls, expected in (([], True), ([[[1.0, -9.0], [1.0, 9.0]]], False)):
        rows = [{"name": "wall", "start": a, "end": b, "thickness": 0.1, "height": 5.0} for a, b in walls]
        world = World.from_tables({"name": "test", "origin": origin, "cylinder": [walker], "wall": rows}, "test.toml")
        assert avoidable(world, truth, "walker", dataclasses.replace(ABLE, reaction_s=0.6), 15.0) is expected


def test_abilities_are_those_of_the_vehicle_and_its_limit() -> None:
    mission = worlds.pop_up(1)
    assert mission.height == 3.0
    from protocol import toml_files
    from vehicle_sim.airframe import Airframe

    able = Abilities.of(Airframe.load(toml_files.find("vehicles", "paper_quad")), math.radians(45.0))
    assert able.acceleration == pytest.approx(9.80665, rel=1e-3)
    assert able.reaction_s == pytest.approx(1.0 / 15.0 + 0.02 + 0.125 + 0.03)
    assert able.hull == 0.36


def test_the_way_is_compared_with_the_shortest_where_it_is_known() -> None:
    assert row(path_m=43.0).way_over_shortest == pytest.approx(45.0 / 40.0)
    assert row(path_m=43.0, shortest_m=45.0).way_over_shortest == 1.0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--method", "swamp"], "method 'swamp': there are"),
        (["--set", "avoidance.swamp=1"], "swamp"),
        (["--set", "avoidance.guard.keep_out=0.1"], "forest25, astar: avoidance.guard.keep_out 0.1: less than"),
        (["--set", "limits.highest_thrust=0.3", "--method", "none"], "forest25, none: limits.highest_thrust 0.3"),
        (["--set", "avoidance.method=none", "--seeds", "1"], "choose it by --method"),
    ],
)
def test_what_the_companion_would_refuse_is_one_line_before_anything_flies(arguments: list[str], says: str) -> None:
    done = CliRunner().invoke(command_line.app, ["forest", *arguments])
    assert done.exit_code == 2
    assert done.output.startswith("studies: ") and says in done.output and done.output.count("\n") == 1
