"""The matrix: each fault, mission and seed flown in memory, and what came of it beside what was promised."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

from studies import style
from studies.campaigns.statistics import wilson
from studies.engine import on_all_cores
from studies.faults import flights
from studies.faults.catalogue import CONTACT, FAULTS, OUTCOMES, Fault
from studies.faults.flights import Flown, Job, Row
from studies.report import Report

NAME = "faults-joined"
TITLE = "Both sides joined in memory"

HEADERS = ("fault", "promised", "flights", "as promised (95 %)", "answer in time", "outcomes", "greatest tilt (deg)",
           "least clearance (m)", "answer after (s), median", "latest")  # fmt: skip
CLEARANCE_M = 0.5
TILT_DEG, STEEP_DEG = 45.0, 50.0
"""The limit, and what a vehicle is taken for out of control at."""
_LISTED = 4
"""Flights of a fault that are listed, at most, if they were not as promised."""
_SOONEST_S = 0.003
"""Where the picture's axis of times begins."""
_COLOURS = dict(
    zip(
        OUTCOMES,
        ("#2f8f5b", "#9acd32", "#e09f3e", "#1f5fbf", style.GREY, "#d1495b", "#6d4c9f", style.INK),
        strict=True,
    )
)


@dataclass(frozen=True, slots=True)
class Case:
    """All flights with one fault."""

    fault: Fault
    rows: tuple[Row, ...]

    @property
    def answers_s(self) -> list[float]:
        """Times to the promised answer, where it came."""
        return [row.answer_s for row in self.rows if row.answer_s is not None and row.answer == row.promise.answer]

    def line(self) -> list[str | float]:
        timed = [row.in_time for row in self.rows if row.in_time is not None]
        clearances = [row.clearance_m for row in self.rows if row.clearance_m is not None]
        counts = Counter(row.outcome for row in self.rows)
        return [
            self.fault.key,
            self.fault.promise.text,
            len(self.rows),
            as_promised(self.rows),
            f"{sum(timed)} of {len(timed)}" if timed else "-",
            ", ".join(f"{counts[each]} {each}" for each in OUTCOMES if counts[each]),
            round(max(row.tilt_deg for row in self.rows), 1),
            min(clearances, default=float("nan")),
            median(self.answers_s) if self.answers_s else float("nan"),
            max(self.answers_s, default=float("nan")),
        ]


def as_promised(rows: Sequence[Flown]) -> str:
    """How many of them were, with Wilson's interval."""
    kept, total = sum(row.kept for row in rows), len(rows)
    low, high = wilson(kept, total)
    return f"{kept} of {total} ({100.0 * low:.0f}-{100.0 * high:.0f} %)"


def run(report: Report) -> None:
    code = flights.code()
    jobs = [
        Job(fault.key, mission, seed, code)
        for seed in range(1, report.choice.seeds + 1)
        for fault in FAULTS.values()
        for mission in missions(fault, seed)
    ]
    path = report.choice.logs.with_name("faults") / "joined.jsonl"
    tell(report, flights.fly_missing(jobs, Row, path, partial(on_all_cores, flights.fly), report.progress))


def missions(fault: Fault, seed: int) -> tuple[str, ...]:
    """Those that a fault is flown on with a seed: all if it is there from the start, otherwise one of them. Two seeds
    have the same one, one for each of `flights.output`."""
    return fault.missions if fault.from_start else (fault.missions[seed // 2 % len(fault.missions)],)


def tell(report: Report, rows: Sequence[Row]) -> None:
    """The section: picture, table, checks, and each flight that was not as promised."""
    rows = [row for row in rows if row.fault in FAULTS]
    cases = _cases(rows)
    if not cases:
        report.text("Not flown yet.")
        return
    last = max(row.seed for row in rows)
    report.text(f"{len(rows)} flights, with {'the seeds 1 to' if last > 1 else 'seed'} {last}.")
    report.figure(
        picture(cases),
        report.name,
        "Left: how the flights ended; hatched: not as promised. Middle: from the fault to the first answer, a dot a "
        "flight, on the promised time. Right: the greatest tilt of each flight, and the limit",
    )
    report.table(
        HEADERS,
        [case.line() for case in cases],
        "As promised: the flight ended so, and the promised answer was the first one. Tilts, clearances and times are "
        "the worst of all flights unless they are a median.",
    )
    _checks(report, rows)
    _failures(report, cases)


def _cases(rows: Sequence[Row]) -> list[Case]:
    found = (Case(fault, tuple(row for row in rows if row.fault == key)) for key, fault in FAULTS.items())
    return [case for case in found if case.rows]


def _checks(report: Report, rows: Sequence[Row]) -> None:
    contacts = sum(row.outcome == CONTACT for row in rows)
    report.check("contacts", "0", f"{contacts} of {len(rows)} flights", contacts == 0)
    kept = sum(row.kept for row in rows)
    report.check("flights as promised", "all", f"{kept} of {len(rows)}", kept == len(rows))
    timed = [row.in_time for row in rows if row.in_time is not None]
    report.check("promised answers within their time", "all", f"{sum(timed)} of {len(timed)}", all(timed))
    steep = sum(map(_is_steep, rows))
    report.check(f"tilts above {STEEP_DEG:g} degrees", "0", f"{steep} of {len(rows)} flights", steep == 0)
    clearances = [row.clearance_m for row in rows if row.clearance_m is not None and row.fault.startswith("delay each")]
    if clearances:
        least = min(clearances)
        report.check("clearance with a late link", f">= {CLEARANCE_M:g} m", least, least >= CLEARANCE_M)


def _failures(report: Report, cases: Sequence[Case]) -> None:
    failed = {case.fault.key: [row for row in case.rows if not row.kept or _is_steep(row)] for case in cases}
    if any(failed.values()):
        report.table(
            ("flight", "fault began (s)", "outcome", "first answer", "after (s)", "tilt (deg)", "cause"),
            [
                (f"`{row.fault}` {row.mission} {row.seed}", _cell(row.began_s), row.outcome, row.answer or "-",
                 _cell(row.answer_s), round(row.tilt_deg), row.cause or "-")
                for rows in failed.values()
                for row in rows[:_LISTED]
            ],
            f"Flights that were not as promised, or tilted by more than {STEEP_DEG:g} degrees "
            f"({sum(map(len, failed.values()))}; at most {_LISTED} of each fault are listed). "
            "`python -m studies.faults FAULT MISSION SEED` flies one again and prints what was said:",
        )  # fmt: skip


def _is_steep(row: Row) -> bool:
    return row.tilt_deg > STEEP_DEG


def _cell(value: float | None) -> float | str:
    return "-" if value is None else round(value, 2)


def picture(cases: Sequence[Case]) -> Any:
    """Outcomes as bars, times to the answer and tilts as dots, one line a fault."""
    figure, (ends, times, tilts) = style.sheet(
        1, 3, height=0.9 + 0.19 * len(cases), width=8.4, sharey=True, width_ratios=(5, 3, 3)
    )
    for line, case in enumerate(cases):
        _bars(ends, line, case)
        promise = case.fault.promise
        if promise.within_s is not None:
            times.barh(line, promise.within_s - _SOONEST_S, left=_SOONEST_S, height=0.72, color="#dfe7f3")
        for row in case.rows:
            colour = style.PALETTE[0 if row.kept else 1]
            tilts.plot(row.tilt_deg, line, ".", ms=4, alpha=0.7, color=style.PALETTE[1 if _is_steep(row) else 0])
            if row.answer_s is not None:
                times.plot(max(row.answer_s, 2.0 * _SOONEST_S), line, ".", ms=4, alpha=0.7, color=colour)
    ends.set_yticks(range(len(cases)), [case.fault.key for case in cases])
    ends.set(xlabel="flights / %", xlim=(0.0, 100.0), ylim=(len(cases) - 0.4, -0.6))
    times.set(xlabel="fault to answer / s", xscale="log", xlim=(_SOONEST_S, 100.0))
    tilts.axvline(TILT_DEG, color=style.GREY, ls=":")
    tilts.set(xlabel="greatest tilt / deg", xlim=(0.0, 95.0))
    for axes in (ends, times, tilts):
        axes.grid(axis="y", visible=False)
    seen = [each for each in OUTCOMES if any(row.outcome == each for case in cases for row in case.rows)]
    handles = [ends.barh(0, 0.0, color=_COLOURS[each]) for each in seen]
    figure.legend(handles, seen, loc="outside upper center", ncols=len(seen))
    return figure


def _bars(axes: Any, line: int, case: Case) -> None:
    """A fault's flights by outcome; those that were not as promised are hatched."""
    at = 0.0
    for outcome in OUTCOMES:
        for kept in (True, False):
            share = sum((row.outcome, row.kept) == (outcome, kept) for row in case.rows) / len(case.rows)
            hatch = None if kept else "////"
            axes.barh(
                line, 100.0 * share, left=at, height=0.72, color=_COLOURS[outcome], hatch=hatch, ec="white", lw=0.0
            )
            at += 100.0 * share
