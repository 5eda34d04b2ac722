"""The forest of Loquercio et al. 2021, thinner and denser, with a good LiDAR and a bad one."""

from functools import partial

from studies import flown, style, worlds
from studies.campaign import DEFAULT, Setup
from studies.campaign_report import Case, Floor, fly_and_tell
from studies.report import Report

NAME = "forest"
TITLE = "Poisson forests"

ACHIEVED_M_S = 5.0
BAD_LIDAR = ("lidar.dropout=0.1", "lidar.noise_m=0.05", "lidar.latency_s=0.1")
SETUPS = (
    Setup("forest25", "1/25 per m2", worlds.forest, (3.0, 5.0, 7.0, 10.0)),
    Setup("forest12", "1/12 per m2", partial(worlds.forest, density=1 / 12), (5.0,)),
    Setup("badlidar", "1/25, bad LiDAR", worlds.forest, (5.0,), vehicle_overrides=BAD_LIDAR),
)
FLOORS = (
    Floor("forest25", 0.99, (3.0, 5.0, 7.0), "a vision policy 100 / 100 / about 80 %"),
    Floor("forest25", 0.95, (10.0,), "60 %, Fast-Planner 0 %"),
    Floor("forest12", 0.97),
    Floor("badlidar", 0.97),
)


def run(report: Report) -> None:
    report.text(
        """
Trunks of 0.6 m on 30 x 60 m, as many as a Poisson process has, 40 m to the goal, flown at 3 m. 2.5 m around start and
goal are free. The published set-up (Loquercio et al. 2021) counts 5 m from the goal as success, ours asks for 2 m. "Bad
LiDAR": 10 % of the sectors dropped, 5 cm of noise, scans 100 ms old.
"""
    )
    flown.picture(report, SETUPS)
    cases = fly_and_tell(report, SETUPS, FLOORS)
    for case in cases:
        if (case.setup.name, case.speed, case.method) == ("forest25", 10.0, DEFAULT):
            achieved = case.mean(lambda row: row.path_speed)
            report.check(f"achieved at 10 m/s commanded, {DEFAULT}", f">= {ACHIEVED_M_S:g} m/s", achieved,
                         achieved >= ACHIEVED_M_S)  # fmt: skip
    if cases:
        report.figure(_speeds(cases), "forest-speeds", "Achieved over commanded speed, of the flights that arrived")


def _speeds(cases: list[Case]) -> object:
    figure, axes = style.sheet(height=2.8, width=4.2)
    chosen = [case for case in cases if case.setup.name == "forest25" and case.successes]
    for method in dict.fromkeys(case.method for case in chosen):
        own = [case for case in chosen if case.method == method]
        axes.plot([c.speed for c in own], [c.mean(lambda r: r.path_speed) for c in own], "o-", ms=4, label=method)
    axes.plot([3.0, 10.0], [3.0, 10.0], color=style.GREY, ls=":")
    axes.set(xlabel="commanded / (m/s)", ylabel="way over time / (m/s)")
    axes.legend()
    return figure
