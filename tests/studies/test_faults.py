"""The matrix of faults: a quick part of it, how a flight becomes a row, and the proxy."""

import socket
from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import pytest

from companion.mission.plan import Mission
from companion.state import Output
from studies.faults import matrix, proxy
from studies.faults.catalogue import (
    ANSWERS,
    ASTRAY,
    CONTACT,
    DELIVERED,
    FAULTS,
    LANDED,
    NOT_ENDED,
    OUTCOMES,
    REFUSED,
    WITHDREW,
)
from studies.faults.flights import FLIGHT_S, Job, Row, answers, fly, fly_missing, moment_s, outcome, output
from studies.faults.injector import Injector, Link
from studies.joined import mission_of
from studies.report import Choice, Report, markdown, untracked
from vehicle_sim.vehicle import Summary

ROW = Row("position, frozen", "square", 1, "abc", WITHDREW, "stuck", 20.0, "withdraw", 0.1, 30.0, None, 4.0)


@pytest.mark.parametrize(
    ("fault", "mission", "seed"),
    [("combined", "square", 1), ("ring, random", "courier", 11), ("position, frozen", "square", 5)],
)
def test_a_quick_part_of_the_matrix_is_as_promised(fault: str, mission: str, seed: int) -> None:
    row = fly(Job(fault, mission, seed, ""))
    assert row.kept and row.in_time is not False, row
    assert row.tilt_deg < 46.0


def test_the_fault_begins_at_a_moment_that_the_seed_says() -> None:
    moments = {moment_s(Job(fault, "square", seed, "")) for fault in ("a", "b") for seed in (1, 2)}
    assert len(moments) == 4 and all(FLIGHT_S["square"][0] < each < FLIGHT_S["square"][1] for each in moments)
    assert moment_s(Job("a", "square", 1, "old")) == moment_s(Job("a", "square", 1, "new"))


@pytest.mark.parametrize(("fault", "flights"), [("loss, 40 %", 4), ("combined", 8)])
def test_each_mission_is_flown_with_the_companion_s_own_output_and_with_rates(fault: str, flights: int) -> None:
    """One flight a seed, or both missions if the fault is there from the start: within four seeds all is there."""
    for first in (1, 7):
        seeds = range(first, first + 4)
        flown = [(m, output(Job(fault, m, seed, ""))) for seed in seeds for m in matrix.missions(FAULTS[fault], seed)]
        assert len(flown) == flights and set(flown) == set(product(FLIGHT_S, (None, Output.RATES)))


def test_each_promise_can_be_kept() -> None:
    for fault in FAULTS.values():
        assert fault.promise.ends <= set(OUTCOMES) - {CONTACT, NOT_ENDED}
        assert fault.promise.answer in (None, *ANSWERS.values())
        assert (fault.link is None) is not (fault.change is None)


def test_answers_are_what_the_companion_says_after_the_fault() -> None:
    said = [
        (19.0, "no ring for 0.51 s: holding"),
        (20.5, "vehicle: Landing: holding"),
        (20.6, "route, step 2 of 7"),
        (20.7, "bad telemetry (position stuck): the vehicle is asked to hold"),
        (25.7, "held for 5 s: landing"),
    ]
    given = answers(said, 20.0)
    assert [answer for answer, _ in given] == ["withdraw", "land"]
    assert [after_s for _, after_s in given] == pytest.approx([0.7, 5.7])
    assert answers(said, None) == [] and answers(said, 18.0)[0] == ("hold", 1.0)


def test_a_landing_as_planned_is_no_answer_on_the_console_either() -> None:
    console = (
        "  12.1 s  fly      route    step 2/7   north     7.4  east    1.2",
        "   12.972 ERROR   companion: no ring for 0.52 s: holding",
        "   22.010 INFO    companion: landing",
    )
    assert [proxy.sentence(line) for line in console] == ["", "no ring for 0.52 s: holding", "landing"]
    assert answers([(1.0, proxy.sentence(line)) for line in console], 0.0) == [("hold", 1.0)]


def test_how_a_flight_ended() -> None:
    courier, square = mission_of("courier"), mission_of("square")
    flown = Summary("landed", 0, None, 1.0, 20.0, True, (120.2, 0.1, -0.6), 25.0, (0.2, 0.1, -0.1))

    def ended(done: bool = False, given: tuple[str, ...] = (), mission: Mission = courier, **changes: Any) -> str:
        return outcome(replace(flown, **changes), mission, done, [(each, 1.0) for each in given])

    assert ended(done=True, given=("hold",)) == DELIVERED
    assert ended(done=True, final_position_ned=(0.0, 1.2, -0.1)) == ASTRAY
    assert ended(done=True, released_at_ned=(118.0, 0.0, -0.6)) == ended(done=True, released_at_ned=None) == ASTRAY
    assert ended(done=True, mission=square, released_at_ned=None) == DELIVERED
    assert ended(done=True, outcome="crashed", contacts=1) == CONTACT
    assert ended(outcome="stopped", flight_time_s=0.0) == REFUSED
    assert ended(outcome="stopped") == NOT_ENDED
    assert ended(given=("hold", "land")) == LANDED
    assert ended(given=("hold", "withdraw", "land")) == WITHDREW


def test_a_promise_is_kept_by_outcome_and_first_answer_and_in_time_by_its_time() -> None:
    assert ROW.kept and ROW.in_time
    late, other, hit = (
        msgspec.structs.replace(ROW, **changes)
        for changes in ({"answer_s": 0.4}, {"answer": "hold"}, {"outcome": CONTACT})
    )
    assert late.kept and not late.in_time
    assert not other.kept and not other.in_time
    assert not hit.kept
    silent = msgspec.structs.replace(ROW, fault="combined", outcome=DELIVERED, answer=None, answer_s=None)
    assert silent.kept and silent.in_time is None


def test_what_was_flown_is_kept_and_not_flown_again(tmp_path: Path) -> None:
    path, flown = tmp_path / "logs" / "rows.jsonl", list[Job]()

    def fly_all(jobs: list[Job]) -> Iterable[Row]:
        for job in jobs:
            flown.append(job)
            if job.seed == 4:
                raise KeyboardInterrupt
            yield msgspec.structs.replace(ROW, fault=job.fault, seed=job.seed, code=job.code)

    jobs = [Job("combined", "square", seed, "abc") for seed in (1, 2, 3, 4)]
    with pytest.raises(KeyboardInterrupt):
        fly_missing(jobs, Row, path, fly_all, untracked)
    assert [row.seed for row in fly_missing(jobs[1:3], Row, path, fly_all, untracked)] == [2, 3]
    assert flown == jobs
    changed = [Job("combined", "square", 1, "def")]
    assert [row.code for row in fly_missing(changed, Row, path, fly_all, untracked)] == ["def"]
    assert flown == [*jobs, *changed]
    assert [row.code for row in fly_missing([], Row, path, fly_all, untracked)] == ["def"]


def test_the_page_has_each_fault_and_each_flight_that_was_not_as_promised(tmp_path: Path) -> None:
    rows = [
        ROW,
        msgspec.structs.replace(ROW, seed=2, outcome=CONTACT, cause="wall", clearance_m=-0.01),
        msgspec.structs.replace(ROW, fault="combined", outcome=DELIVERED, answer=None, answer_s=None, tilt_deg=81.0),
    ]
    report = Report("faults-joined", "Joined", tmp_path, choice=Choice(seeds=0))
    matrix.tell(report, rows)
    text = markdown(report.section(), "faults")
    assert "| position, frozen | withdraws within 0.3 s, lands after 5 s | 2 | 1 of 2 (9-91 %) | 2 of 2 |" in text
    assert "| combined | flies on | 1 | 1 of 1 (21-100 %) | - | 1 delivered | 81 |" in text
    assert "| `position, frozen` square 2 | 20 | contact | withdraw | 0.1 | 30 | wall |" in text
    assert "| `combined` square 1 | 20 | delivered | - | - | 81 | stuck |" in text
    verdicts = {check.what: check.ok for check in report.section().checks}
    assert list(verdicts.values()) == [False, False, True, False]
    assert (tmp_path / "faults-joined.png").stat().st_size > 5000


def test_the_proxy_hands_on_both_ways_and_does_the_injector_s_harm() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
    ):
        for end in (companion, vehicle):
            end.bind(("127.0.0.1", 0))
            end.settimeout(60.0)
        link = proxy.Proxy(Injector(Link(duplicated=1.0)), companion.getsockname()[1])
        vehicle.sendto(b"there", ("127.0.0.1", link.port))
        link.step()  # waits for what comes; on loopback a datagram that was sent is there
        data, address = companion.recvfrom(100)
        assert data == b"there" and companion.recv(100) == b"there"
        companion.sendto(b"back", address)
        link.step()
        assert vehicle.recv(100) == vehicle.recv(100) == b"back"
        link.close()


def test_a_reset_of_the_heading_is_flown_on_rates() -> None:
    assert {output(Job("yaw reset, 45 deg, the whole frame", "square", seed, "")) for seed in (1, 2)} == {Output.RATES}
