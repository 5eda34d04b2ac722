"""Shares with their intervals, and two campaigns over the same seeds beside each other."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np
from scipy import stats

from studies.campaign import Row

_AT_ONCE = 4_000_000
"""Numbers that are drawn at a time for a bootstrap: all at once, those of ten thousand flights are gigabytes."""


class Interval(NamedTuple):
    low: float
    high: float


def wilson(successes: int, total: int) -> Interval:
    """Wilson's score interval of a share (95 %); (0, 1) for no trials."""
    if total == 0:
        return Interval(0.0, 1.0)
    z = 1.959964
    share = successes / total
    scale = 1.0 + z * z / total
    middle = (share + z * z / (2 * total)) / scale
    half = z / scale * math.sqrt(share * (1.0 - share) / total + z * z / (4.0 * total * total))
    return Interval(max(0.0, middle - half), min(1.0, middle + half))


@dataclass(frozen=True, slots=True)
class Pairs:
    """The flights of two campaigns over the same set-up, speed and seeds."""

    name: str
    first: tuple[Row, ...]
    second: tuple[Row, ...]

    @property
    def only(self) -> tuple[int, int]:
        """How many succeeded in the first alone, and in the second alone."""
        both = list(zip(self.first, self.second, strict=True))
        return sum(a.succeeded > b.succeeded for a, b in both), sum(a.succeeded < b.succeeded for a, b in both)

    @property
    def mcnemar(self) -> float:
        """p of McNemar's exact test: that those who differ fall to either side by chance."""
        only = self.only
        return float(stats.binomtest(only[0], sum(only)).pvalue) if sum(only) else 1.0

    def difference(self, value: Callable[[Row], float | None]) -> tuple[float, Interval] | None:
        """The mean of second - first with its bootstrap interval (95 %, bias-corrected, fixed seed), over the seeds at
        which both have the value; None for fewer than two, or if all are the same."""
        pairs = [(value(a), value(b)) for a, b in zip(self.first, self.second, strict=True)]
        found = np.array([b - a for a, b in pairs if a is not None and b is not None])
        if len(found) < 2 or np.ptp(found) == 0.0:
            return None
        batch = max(_AT_ONCE // len(found), 1)
        rng = np.random.default_rng(0)
        interval = stats.bootstrap((found,), np.mean, vectorized=True, batch=batch, rng=rng).confidence_interval
        return float(found.mean()), Interval(float(interval.low), float(interval.high))


def paired(first: Iterable[Row], second: Iterable[Row]) -> list[Pairs]:
    """The flights that both have, by set-up, speed and method; where either side has one method, whichever it is."""
    sides = [list(first), list(second)]
    alone = all(len({row.method for row in side}) == 1 for side in sides)
    keyed = [{(row.setup, "" if alone else row.method, row.speed, row.seed): row for row in side} for side in sides]
    common = sorted(keyed[0].keys() & keyed[1].keys())
    return [
        Pairs(
            ", ".join(filter(None, (setup, method, f"{speed:.3g} m/s"))),
            *(tuple(k[key] for key in keys) for k in keyed),
        )
        for (setup, method, speed), group in groupby(common, key=lambda key: key[:3])
        for keys in [list(group)]
    ]


MEASURES: dict[str, Callable[[Row], float | None]] = {
    "least clearance (m)": lambda row: row.least_clearance if row.succeeded else None,
    "time on the route (s)": lambda row: row.route_s if row.succeeded else None,
    "top speed (m/s)": lambda row: row.top_speed if row.succeeded else None,
}
"""Compared where both arrived."""


def compared(first: Iterable[Row], second: Iterable[Row]) -> list[str]:
    """Lines that tell of two campaigns beside each other."""
    lines = []
    for pairs in paired(first, second):
        total, only = len(pairs.first), pairs.only
        shares = [sum(row.succeeded for row in side) for side in (pairs.first, pairs.second)]
        lines.append(
            f"{pairs.name}: {shares[0]} and {shares[1]} of {total} succeed; {only[0]} in the first alone, {only[1]} in "
            f"the second alone; McNemar p = {pairs.mcnemar:.3g}"
        )
        for label, value in MEASURES.items():
            found = pairs.difference(value)
            if found is not None:
                mean, (low, high) = found
                lines.append(f"  {label}: second - first = {mean:+.4g} ({low:+.4g} to {high:+.4g})")
    return lines
