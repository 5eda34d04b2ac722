"""A few faults over UDP: the real processes in real time, with the same injector between them."""

import time
from dataclasses import fields
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from studies.faults import flights, proxy
from studies.faults.catalogue import FAULTS, RAISED
from studies.faults.flights import Job, Row
from studies.faults.matrix import tell
from studies.joined import mission_of
from studies.report import Report
from vehicle_sim.vehicle import Summary

NAME = "faults-udp"
TITLE = "Over UDP in real time"

SEEDS = 3


def run(report: Report) -> None:
    report.text(
        """
`companion fly` and `vehicle-sim` as processes, with a proxy between them on loopback. One flight at a time; a machine
that is busy with other things is late by itself.
"""
    )
    path = report.choice.logs.with_name("faults") / "udp.jsonl"
    jobs = [
        Job(fault.key, "courier", seed, flights.code())
        for seed in range(1, min(report.choice.seeds, SEEDS) + 1)
        for fault in FAULTS.values()
        if fault.over_udp
    ]
    tell(report, flights.fly_missing(jobs, Row, path, partial(map, fly), report.progress))


def fly(job: Job) -> Row:
    """Fly it, at the pace of the clock."""
    began = time.perf_counter()
    fault, mission = FAULTS[job.fault], mission_of(job.mission)
    between = flights.injector(fault, flights.moment_s(job), job.seed)
    began_ns = time.monotonic_ns()
    with TemporaryDirectory() as folder:
        companion, vehicle = proxy.fly(between, job.mission, mission.world, job.seed, Path(folder))
        said, ended = companion.end(), vehicle.end()
        truth = Path(folder) / "truth.npy"
        states = np.load(truth)["state"] if truth.stat().st_size else np.zeros((1, 17))
    onset_s = None if between.began_ns is None else (between.began_ns - began_ns) * 1e-9
    lines = [(1e-9 * (at - began_ns), proxy.sentence(line)) for at, line in companion.lines]
    began_s = 0.0 if fault.from_start else onset_s
    answers = flights.answers(lines, began_s)
    words = "no word at the end" if said is None or ended is None else str(said["outcome"])
    done = words in ("delivered", "flown")
    outcome, contact, clearance_m = RAISED, None, None
    if ended is not None:
        summary = Summary(**{each.name: ended[each.name] for each in fields(Summary)})
        contact, clearance_m = summary.contact_with, summary.least_clearance_m
        outcome = RAISED if said is None else flights.outcome(summary, mission, done, answers)
    first = answers[0] if answers else (None, None)
    return Row(
        fault=job.fault,
        mission=job.mission,
        seed=job.seed,
        code=job.code,
        outcome=outcome,
        cause=contact or (None if done else words),
        began_s=began_s,
        answer=first[0],
        answer_s=first[1],
        tilt_deg=flights.steepest_deg(states),
        clearance_m=clearance_m,
        wall_s=time.perf_counter() - began,
    )
