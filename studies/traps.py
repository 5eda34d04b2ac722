"""Where the straight way is a dead end."""

from studies import worlds
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "traps"
TITLE = "U-shaped traps and mazes"

PATIENT = ("supervision.step_timeout=400.0",)
"""The time is the campaign's to limit."""
SETUPS = (
    Setup("utrap", "U-trap", worlds.u_trap, (3.0,), 120.0, 20, has_way=True, overrides=PATIENT),
    Setup("maze", "maze", worlds.maze, (3.0,), 240.0, 20, has_way=True, overrides=PATIENT),
)
FLOORS = (Floor("utrap", 1.0, published="VFH+ 17 %"), Floor("maze", 0.9, published="EGO 20-60 %"))


def run(report: Report) -> None:
    report.text(
        """
The trap is three walls, 6 to 10 m wide and 5 to 9 m deep, open towards the start and across the straight way to the
goal behind it. The maze has 6 x 6 rooms of 4 m behind a closed outer wall; it has to be crossed from corner to corner.
The vehicle knows neither.
"""
    )
    fly_and_tell(report, SETUPS, FLOORS)
