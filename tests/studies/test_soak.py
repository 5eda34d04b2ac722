"""The soak: what it flies, and how what the processes hold becomes a table with checks."""

import mmap
import os
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.runtime.files import load_mission
from studies.faults import soak
from studies.faults.soak import Process, Row, Sample, by_process, patrol, sample_of
from studies.report import Report

ROW = Row(
    pace="lockstep",
    duration_s=240.0,
    code="abc",
    outcome="flown",
    simulated_s=240.0,
    wall_s=20.0,
    log_mb=20.0,
    processes=(Process("companion", (250.0, 260.0, 260.0, 261.0), (6, 7, 7, 7)),),
    latency_p50_us=(150.0, 160.0, 170.0, 161.0),
    latency_p99_us=(900.0,) * 4,
)


def test_the_patrol_is_a_mission_up_and_down_the_street(tmp_path: Path) -> None:
    file = tmp_path / "patrol.toml"
    file.write_text(patrol(240.0))
    mission, _ = load_mission(str(file))
    assert [waypoint.north for waypoint in mission.waypoints] == [120.0, 0.0, 120.0, 0.0]


def test_a_sample_is_what_a_process_holds(tmp_path: Path) -> None:
    before = sample_of(os.getpid())
    with (tmp_path / "opened").open("w"):
        held = mmap.mmap(-1, 64_000_000)  # new memory, whatever the process has left over of its own
        np.ndarray(len(held), np.uint8, held)[:] = 1
        during = sample_of(os.getpid())
    after = sample_of(os.getpid())
    assert before is not None and during is not None and after is not None
    assert during.descriptors == before.descriptors + 1 == after.descriptors + 1
    assert during.resident_mb - before.resident_mb > 0.5e-6 * len(held)
    assert sample_of(2**31 - 2) is None


def test_quarters_are_of_the_time_that_a_process_was_there() -> None:
    seconds = [
        {"companion": Sample(float(at), 7)} | ({"planner": Sample(5.0, at)} if at >= 4 else {}) for at in range(8)
    ]
    companion, planner = by_process(seconds)
    assert companion == Process("companion", (0.5, 2.5, 4.5, 6.5), (7, 7, 7, 7))
    assert planner == Process("planner", (5.0,) * 4, (4, 5, 6, 7))


@pytest.mark.parametrize(
    ("process", "met"),
    [
        (Process("companion", (250.0, 260.0, 260.0, 261.0), (6, 7, 7, 7)), [True, True, True]),
        (Process("companion", (250.0, 260.0, 260.0, 270.0), (6, 7, 7, 7)), [True, False, True]),
        (Process("companion", (250.0, 260.0, 260.0, 261.0), (6, 7, 7, 8)), [True, False, True]),
    ],
)
def test_what_grows_is_a_check_that_fails(tmp_path: Path, process: Process, met: list[bool]) -> None:
    report = Report("soak", "Soak", tmp_path)
    soak.tell(report, [msgspec.structs.replace(ROW, processes=(process,))])
    assert [check.ok for check in report.section().checks] == met
