"""A soak: one flight of hours, and what memory and descriptors the processes hold meanwhile."""

import os
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np

from companion.runtime.summary import latencies_us
from protocol.flightlog import LogReader
from studies.faults import flights
from studies.report import Report

NAME = "soak"
TITLE = "A soak"

FLIGHTS = (("lockstep", 4 * 3600.0), ("1", 1800.0))
"""Pace, and simulated seconds."""
_LEG_M, _SPEED = 120.0, 4.0
_LEG_S = 60.0
"""What a leg takes, about, around all that stands in the street."""
_SAMPLE_S = 5.0
_LEAST_BATTERY_WH = 1e5
"""A battery that lasts: not what is looked at here."""
GROWTH = 0.02
"""Share by which memory may grow from the second quarter of the flight to the last."""
SLOWER = 0.1
"""The same of the median latency, on a machine that has other work at times."""
_WORDS = (("recorder", b"protocol.flightlog.recorder"), ("planner", b"spawn_main"), ("vehicle", b"vehicle_sim"))
"""In the command lines of the processes that the companion starts."""


@dataclass(frozen=True, slots=True)
class Soak:
    pace: str
    duration_s: float
    code: str
    """Digest of the code that flies: see flights.code."""


class Process(msgspec.Struct, frozen=True):
    """What a process held in the quarters of a flight: medians."""

    name: str
    resident_mb: tuple[float, ...]
    descriptors: tuple[int, ...]


class Row(msgspec.Struct, frozen=True):
    """One flight."""

    pace: str
    duration_s: float
    code: str
    outcome: str
    simulated_s: float
    wall_s: float
    log_mb: float
    processes: tuple[Process, ...]
    latency_p50_us: tuple[float, ...]
    """Median latency of each quarter of the flight; the others are by quarters, too."""
    latency_p99_us: tuple[float, ...]

    @property
    def job(self) -> Soak:
        return Soak(self.pace, self.duration_s, self.code)

    @property
    def kept(self) -> bool:
        return self.outcome == "flown"


class Sample(msgspec.Struct, frozen=True):
    """What a process holds at a moment."""

    resident_mb: float
    descriptors: int


def run(report: Report) -> None:
    report.text(
        f"""
`companion demo` on the *neighbourhood*'s street, {_LEG_M:.0f} m up and down again and again at {_SPEED:.0f} m/s, with
map, planner and full log. Each {_SAMPLE_S:.0f} s the resident memory and the open descriptors of each process are
read. Compared are the second and the last quarter of the flight: the first one fills the map and the caches.
"""
    )
    path = report.choice.logs.with_name("faults") / "soak.jsonl"
    soaks = [Soak(pace, duration_s, flights.code(__file__)) for pace, duration_s in FLIGHTS if report.choice.seeds]
    tell(report, flights.fly_missing(soaks, Row, path, partial(map, fly), report.progress))


def tell(report: Report, rows: list[Row]) -> None:
    """The section: a table of the processes, one of the latencies, checks."""
    if not rows:
        report.text("Not flown yet.")
        return
    for row in rows:
        pace = "lockstep" if row.pace == "lockstep" else "real time"
        report.table(
            ("process", "memory, by quarters (MB)", "descriptors, by quarters"),
            [(each.name, _listed(each.resident_mb), _listed(each.descriptors)) for each in row.processes],
            f"{pace}: {row.simulated_s / 3600:.2f} h simulated in {row.wall_s / 60:.0f} min, {row.outcome}, a log of "
            f"{row.log_mb:.0f} MB. Latency p50 {_listed(row.latency_p50_us)} us, p99 {_listed(row.latency_p99_us)} us.",
        )
        report.check(f"{pace}: the flight", "flown", row.outcome, row.kept)
        for each in row.processes:
            grown = each.resident_mb[-1] / each.resident_mb[1] - 1.0
            more = each.descriptors[-1] - each.descriptors[1]
            what = f"{pace}: {each.name}, growth of memory, descriptors"
            report.check(what, f"<= {GROWTH:.0%}, 0", f"{grown:.1%}, {more}", grown <= GROWTH and more <= 0)
        slower = row.latency_p50_us[-1] / row.latency_p50_us[1] - 1.0
        report.check(f"{pace}: growth of the median latency", f"<= {SLOWER:.0%}", f"{slower:.1%}", slower <= SLOWER)


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.1f}" if isinstance(value, float) else str(value) for value in values)


def patrol(duration_s: float) -> str:
    """A mission of about that time, as TOML."""
    leg = "[[waypoints]]\nnorth = {}\neast = 0.0\nheight = 3.0\n"
    legs = max(round(duration_s / _LEG_S), 2)
    head = f'name = "patrol"\nworld = "neighbourhood"\nvehicle = "paper_quad"\ntakeoff_height = 3.0\nspeed = {_SPEED}\n'
    return head + "".join(leg.format(_LEG_M * (number % 2 == 0)) for number in range(legs))


def fly(soak: Soak) -> Row:
    """Fly it, and look at the processes meanwhile."""
    with TemporaryDirectory() as folder:
        mission = Path(folder) / "patrol.toml"
        mission.write_text(patrol(soak.duration_s))
        command = [sys.executable, "-m", "companion", "demo", str(mission), "--pace", soak.pace, "--log", folder]
        command += ["--set", f"vehicle.battery.capacity_wh={_LEAST_BATTERY_WH}", "--no-report", "--json"]
        command += ["--sensors", "perfect"]
        began = time.monotonic()
        companion = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            samples = list(_watched(companion))
        finally:
            companion.kill()
        wall_s = time.monotonic() - began
        assert companion.stdout is not None
        end = msgspec.json.decode(companion.stdout.read())
        log = Path(end["log"])
        quarters = [each for each in np.array_split(latencies_us(LogReader(log)), 4) if len(each)]
        return Row(
            pace=soak.pace,
            duration_s=soak.duration_s,
            code=soak.code,
            outcome=end["outcome"],
            simulated_s=end["duration_s"],
            wall_s=wall_s,
            log_mb=log.stat().st_size / 1e6,
            processes=tuple(by_process(samples)),
            latency_p50_us=tuple(float(np.percentile(each, 50)) for each in quarters),
            latency_p99_us=tuple(float(np.percentile(each, 99)) for each in quarters),
        )


def _watched(companion: "subprocess.Popen[str]") -> Iterator[dict[str, Sample]]:
    """Samples of all processes by name, until there is no vehicle any more: what follows is no flight."""
    flew = False
    while companion.poll() is None:
        found = {name: sample for name, pid in _pids(companion.pid) if (sample := sample_of(pid)) is not None}
        if flew and "vehicle" not in found:
            companion.wait()
        elif {"vehicle", "recorder"} <= set(found):
            flew = True
            yield found
        time.sleep(_SAMPLE_S)


def _pids(companion: int) -> Iterator[tuple[str, int]]:
    yield "companion", companion
    try:
        children = Path(f"/proc/{companion}/task/{companion}/children").read_text().split()
        for pid in children:
            words = Path(f"/proc/{pid}/cmdline").read_bytes()
            yield from ((name, int(pid)) for name, word in _WORDS if word in words)
    except OSError:
        return  # one of them has just ended


def sample_of(pid: int) -> Sample | None:
    """None: it has just ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return Sample(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, len(list(Path(f"/proc/{pid}/fd").iterdir())))
    except (OSError, IndexError):
        return None


def by_process(samples: list[dict[str, Sample]]) -> Iterator[Process]:
    for name in dict.fromkeys(name for sample in samples for name in sample):
        held = [sample[name] for sample in samples if name in sample]
        quarters = [[held[at] for at in part] for part in np.array_split(np.arange(len(held)), 4) if len(part)]
        yield Process(
            name,
            tuple(float(np.median([each.resident_mb for each in part])) for part in quarters),
            tuple(int(np.median([each.descriptors for each in part])) for part in quarters),
        )
