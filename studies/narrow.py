"""A gap, a pole, and the obstacles of the paper's Fig. 6."""

from studies import flown, worlds
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "narrow"
TITLE = "A gap, a pole, the paper's Fig. 6"

POLE_SEEN_M = 6.0
SETUPS = (
    Setup("gap", "gap of 0.9 m", worlds.gap, (5.0,), 60.0, 20, has_way=True),
    Setup("pole", "pole seen at 6 m", worlds.pole, (3.0, 5.0, 7.0), 60.0, 20,
          vehicle_overrides=(f"lidar.max_range_m={POLE_SEEN_M}",)),
    Setup("fig6", "the paper's Fig. 6", worlds.fig6, (4.0,), 120.0, 20),
)  # fmt: skip
FLOORS = (Floor("gap", 0.95, published="Fast-Planner 50 %"),)


def run(report: Report) -> None:
    report.text(
        """
A yard 24 m wide, walled in, has a wall across it, turned by up to 15 degrees, with one gap up to 3 m off the straight
way: there is no other way. The gap is 0.9 m wide; that is the width of the published set-up and not scaled, so our hull
of 0.72 m has 9 cm on either side. The pole is 1.5 m wide and seen at 6 m, by a LiDAR of that range. Fig. 6 is
worlds/paper_fig6.toml, its waypoints flown over; there the seed is that of the noise alone.
"""
    )
    flown.picture(report, SETUPS)
    fly_and_tell(report, SETUPS, FLOORS)
