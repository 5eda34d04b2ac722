"""A campaign as a section of docs/avoidance.md: success with its interval, speed, clearance, way, and failures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from companion.avoidance_methods import METHODS
from studies import campaign, style
from studies.campaign import DEFAULT, Row, Setup
from studies.campaigns.runner import Campaign
from studies.campaigns.statistics import wilson
from studies.campaigns.table import read
from studies.engine import cluster
from studies.report import Report

HEADERS = ("set-up", "method", "commanded", "success (95 %)", "speed on the way", "to the goal", "least clearance",
           "its median", "way over shortest", "guarded (%)", "wall (s)")  # fmt: skip
STAGES = {"map (us)": "map_us", "way (us)": "way_us", "guard's space (us)": "space_us", "control step (us)": "step_us"}
_LABEL_PT, _LABELS_PT = 8.0, 90.0
"""Largest size of a set-up's label, and of all side by side."""
_LISTED_FAILURES = 12
"""Failures beyond this number are counted, not listed."""


@dataclass(frozen=True, slots=True)
class Floor:
    """The least share of successes that is required of the default method."""

    setup: str
    success: float
    speeds: tuple[float, ...] = ()
    """Commanded; none: all."""
    published: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """All flights of one set-up with one method at one speed."""

    setup: Setup
    method: str
    speed: float
    rows: tuple[Row, ...]

    @property
    def successes(self) -> int:
        return sum(row.succeeded for row in self.rows)

    @property
    def share(self) -> float:
        return self.successes / len(self.rows)

    @property
    def success(self) -> str:
        """ "97 of 100 (91-99 %)", Wilson's interval at 95 %."""
        low, high = wilson(self.successes, len(self.rows))
        return f"{self.successes} of {len(self.rows)} ({100.0 * low:.0f}-{100.0 * high:.0f} %)"

    def mean(self, value: Callable[[Row], float | None], *, reached: bool = True) -> float:
        """The mean over the flights that reached the goal, or over all; NaN without any."""
        values = [value(row) for row in self.rows if row.succeeded or not reached]
        known = [each for each in values if each is not None]
        return fmean(known) if known else float("nan")


def fly_and_tell(report: Report, setups: Sequence[Setup], floors: Sequence[Floor]) -> list[Case]:
    """Fly what was chosen, and report all stored flights of these set-ups: table, checks, failures."""
    cases = fly(report, setups)
    if not cases:
        report.text("Not flown yet.")
    else:
        tell(report, cases, floors, Path("logs/avoidance", report.name, "failed"))
    return cases


def tell(report: Report, cases: Sequence[Case], floors: Sequence[Floor], logs: Path) -> None:
    """Table, checks, picture and failures of flights, whose logs are in the folder `logs`."""
    report.table(
        HEADERS,
        [_line(case) for case in cases],
        "Speeds (m/s), ways and clearances (m) are those of the flights that reached the goal: speed on the way is the "
        "way over its time, to the goal the straight distance over it. The shortest way is the hull's with the map in "
        "hand where traps, mazes, gaps and fields are, the straight one elsewhere. Guarded is the share of control "
        "steps that the guard changed.",
    )
    _stages(report, cases)
    for floor in floors:
        _check(report, floor, cases)
    report.figure(_successes(cases), report.name.split()[0], "Success with its 95 % interval")
    _failures(report, cases, logs)


def fly(report: Report, setups: Sequence[Setup]) -> list[Case]:
    """The stored cases, after those of the report's choice were flown again."""
    choice = report.choice
    folder = choice.logs / report.name
    todo = campaign.jobs(setups, choice.methods or tuple(METHODS), choice.seeds, folder, choice.overrides)
    if todo:
        flying = Campaign(todo, folder, alone=False)
        with cluster() as client:
            todo = flying.todo
            for _ in zip(report.progress(todo, f"{len(todo)} flights"), flying.fly(client), strict=True):
                pass
        flying.finish()
    rows = read(folder)
    methods = _in_order(row.method for row in rows)
    return [
        Case(setup, method, speed, chosen)
        for setup in setups
        for method in methods
        for speed in setup.speeds
        if (chosen := tuple(r for r in rows if (r.setup, r.method, r.speed) == (setup.name, method, speed)))
    ]


def _in_order(methods: Iterable[str]) -> list[str]:
    """Each method once: those that are built in as they are listed, then those of other packages by their names."""
    there = set(methods)
    return [*(method for method in METHODS if method in there), *sorted(there.difference(METHODS))]


def _line(case: Case) -> list[str | float]:
    clearances = [row.least_clearance for row in case.rows if row.succeeded and row.least_clearance is not None]
    return [
        case.setup.title,
        case.method,
        f"{case.speed:.3g}",
        case.success,
        case.mean(lambda row: row.path_speed),
        case.mean(lambda row: row.goal_speed),
        min(clearances, default=float("nan")),
        median(clearances) if clearances else float("nan"),
        case.mean(lambda row: row.way_over_shortest),
        case.mean(lambda row: None if row.guarded_share is None else 100.0 * row.guarded_share, reached=False),
        round(case.mean(lambda row: row.wall_s, reached=False), 1),
    ]


def _stages(report: Report, cases: Sequence[Case]) -> None:
    timed = [case for case in cases if any(row.step_us is not None for row in case.rows)]
    if timed:
        report.table(
            ("set-up", "method", "commanded", *STAGES),
            [
                [
                    case.setup.title,
                    case.method,
                    f"{case.speed:.3g}",
                    *(_typical(case, name) for name in STAGES.values()),
                ]
                for case in timed
            ],
            "Time a stage on the machine that flew, as many flights side by side as it has cores: medians of the "
            "flights' medians. Map, way and the guard's space are computed once a scan, outside of the control loop; "
            "a control step is the loop's answer to an attitude, the guard's filter included.",
        )


def _typical(case: Case, name: str) -> float | str:
    values = [value for row in case.rows if (value := getattr(row, name)) is not None]
    return round(median(values)) if values else "-"


def _check(report: Report, floor: Floor, cases: Iterable[Case]) -> None:
    for case in cases:
        if case.setup.name == floor.setup and case.method == DEFAULT and case.speed in (floor.speeds or (case.speed,)):
            what = f"{case.setup.title}, {DEFAULT}, {case.speed:.3g} m/s"
            asked = f">= {100.0 * floor.success:g} %" + (f"; {floor.published}" if floor.published else "")
            report.check(what, asked, case.success, case.share >= floor.success)


def _successes(cases: Sequence[Case]) -> Any:
    setups = list(dict.fromkeys((case.setup.name, case.speed) for case in cases))
    methods = _in_order(case.method for case in cases)
    figure, axes = style.sheet(height=2.8)
    for number, method in enumerate(methods):
        chosen = [case for case in cases if case.method == method]
        shift = 0.12 * (number - 0.5 * (len(methods) - 1))
        places = np.array([setups.index((case.setup.name, case.speed)) + shift for case in chosen])
        shares = np.array([100.0 * case.share for case in chosen])
        ends = 100.0 * np.array([wilson(case.successes, len(case.rows)) for case in chosen])
        errors = np.maximum(np.abs(ends.T - shares), 0.0)
        colour = style.PALETTE[number % len(style.PALETTE)]
        axes.errorbar(places, shares, errors, fmt="o", ms=4, lw=1.0, capsize=2, color=colour, label=method)
    labels = [f"{name}\n{speed:.3g} m/s".replace("-", "\n") for name, speed in setups]
    axes.set_xticks(range(len(setups)), labels, fontsize=min(_LABEL_PT, _LABELS_PT / len(setups)))
    axes.set(ylabel="success / %", ylim=(-3.0, 103.0), xlim=(-0.5, len(setups) - 0.5))
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _failures(report: Report, cases: Sequence[Case], logs: Path) -> None:
    """How the failed flights ended, and for the default method each of them."""
    failed = [(case, row) for case in cases for row in case.rows if not row.succeeded]
    if not failed:
        return
    kinds: dict[tuple[str, str, str], int] = {}
    for case, row in failed:
        key = (case.setup.title, case.method, row.outcome)
        kinds[key] = kinds.get(key, 0) + 1
    report.table(("set-up", "method", "outcome", "flights"), [(*key, count) for key, count in kinds.items()],
                 "How the others ended:")  # fmt: skip
    own = [row for _, row in failed if row.method == DEFAULT]
    if not own:
        return
    report.table(
        ("flight", "outcome", "met", "at (m/s)", "avoidable"),
        [
            (f"{r.setup}, {r.speed:.3g} m/s, seed {r.seed}", r.outcome, r.met or "-",
             "-" if r.contact_speed is None else round(r.contact_speed, 2),
             "-" if r.avoidable is None else "yes" if r.avoidable else "no")
            for r in own[:_LISTED_FAILURES]
        ],
        f"Failures of the default method ({len(own)}); each has its log, for `companion replay`, and a picture under "
        f"`{logs}/`:",
    )  # fmt: skip
