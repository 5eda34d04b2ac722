"""A forest that is long enough for the speed that is commanded."""

from functools import partial

from studies import flown, worlds
from studies.campaign import DEFAULT, Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "fast"
TITLE = "A long forest, flown fast"

ACHIEVED_M_S = 7.5
SETUPS = (Setup("forest150", "1/25 per m2, 150 m", partial(worlds.forest, length=150.0), (10.0,), seeds=60),)
FLOORS = (Floor("forest150", 0.95),)


def run(report: Report) -> None:
    report.text(
        """
The thinner forest of above, 150 m long, so that the start and the stop count little: with 6 m/s2 up and 4.5 m/s2 down
the mean is 7.1 m/s on 40 m without a tree and 8.9 m/s on 150 m.
"""
    )
    flown.picture(report, SETUPS)
    for case in fly_and_tell(report, SETUPS, FLOORS):
        if case.method == DEFAULT:
            achieved = case.mean(lambda row: row.path_speed)
            report.check(f"achieved on 150 m at 10 m/s commanded, {DEFAULT}", f">= {ACHIEVED_M_S:g} m/s", achieved,
                         achieved >= ACHIEVED_M_S)  # fmt: skip
