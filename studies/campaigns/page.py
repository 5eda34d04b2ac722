"""The page of a campaign: success with its intervals, distributions, the worst flights, and how the others ended."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from studies import style
from studies.campaign import Row, Setup
from studies.campaign_report import Case, tell
from studies.campaigns.statistics import wilson
from studies.campaigns.table import digest
from studies.report import Report, markdown

PAGE = "README.md"
_WORST = 10
_DRAWN = {
    "least clearance / m": "least_clearance",
    "time on the route / s": "route_s",
    "top speed / (m/s)": "top_speed",
}


def cases(setups: Sequence[Setup], rows: Sequence[Row]) -> list[Case]:
    """The rows by set-up, method and speed."""
    known = {setup.name: setup for setup in setups}
    ordered = sorted(rows, key=lambda row: row.key)
    grouped = groupby(ordered, key=lambda row: (row.setup, row.method, row.speed))
    return [Case(known[name], method, speed, tuple(flown)) for (name, method, speed), flown in grouped]


def write(title: str, command: str, folder: Path, setups: Sequence[Setup], rows: Sequence[Row]) -> Path:
    """Write the page of a campaign's rows into its folder, with its pictures."""
    report = Report(command, title, folder / "pictures")
    told = cases(setups, rows)
    report.text(
        f"{len(rows)} flights, `{digest(rows)}` (digest of all rows without their wall times: the same whoever flew "
        f"them, in whatever order). The table is `rows.parquet`."
    )
    report.table(("case", "success", "width of its interval (%)"), [_share(case) for case in told])
    tell(report, told, (), logs=Path("failed"))
    report.figure(_distributions(told), "distributions", "Distributions of the flights that arrived")
    _worst(report, told)
    path = folder / PAGE
    path.write_text(markdown(report.section(), "pictures"), encoding="utf-8")
    return path


def _share(case: Case) -> list[str | float]:
    low, high = wilson(case.successes, len(case.rows))
    return [_name(case), case.success, 100.0 * (high - low)]


def _name(case: Case) -> str:
    return f"{case.setup.title}, {case.method}, {case.speed:.3g} m/s"


def _distributions(told: Sequence[Case]) -> Any:
    """Shares of the flights below a value."""
    figure, axes = style.sheet(1, len(_DRAWN), height=2.6, width=8.4, sharey=True)
    for number, case in enumerate(told):
        for place, (label, column) in zip(axes, _DRAWN.items(), strict=True):
            known = [getattr(row, column) for row in case.rows if row.succeeded]
            values = np.sort([value for value in known if value is not None])
            colour = style.PALETTE[number % len(style.PALETTE)]
            place.step(values, np.arange(1, len(values) + 1) / max(len(values), 1), color=colour, label=_name(case))
            place.set(xlabel=label)
    axes[0].set(ylabel="share of the flights", ylim=(0.0, 1.02))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _worst(report: Report, told: Sequence[Case]) -> None:
    """Failures first, then those that came nearest to an obstacle."""
    flights = sorted(
        ((case, row) for case in told for row in case.rows),
        key=lambda pair: (pair[1].succeeded, np.inf if (near := pair[1].least_clearance) is None else near),
    )
    report.table(
        ("flight", "outcome", "least clearance (m)", "time (s)", "kept"),
        [
            (f"{_name(case)}, seed {row.seed}", row.outcome,
             float("nan") if row.least_clearance is None else row.least_clearance, row.route_s, _links(row))
            for case, row in flights[:_WORST]
        ],
        "The worst flights. `companion report LOG` writes the report of a kept log:",
    )  # fmt: skip


def _links(row: Row) -> str:
    if row.log is None:
        return "-"
    folder = row.log.replace(" ", "%20")
    return f"[folder]({folder}/), [picture]({folder}/end.png)"
