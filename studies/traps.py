"""Places where the straight way is a dead end."""

from studies import flown, worlds
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "traps"
TITLE = "U-shaped traps, mazes and courts"

PATIENT = ("supervision.step_timeout=400.0",)
"""The companion does not give up: the campaign limits the time."""
CLIMBS = (*PATIENT, "avoidance.altitude_search.max_climb=8.0")
SETUPS = (
    Setup("utrap", "U-trap", worlds.u_trap, (3.0,), 120.0, 20, has_way=True, overrides=PATIENT),
    Setup("maze", "maze", worlds.maze, (3.0,), 240.0, 20, has_way=True, overrides=PATIENT),
    Setup("court", "court, climbing allowed", worlds.court, (3.0,), 120.0, 20, overrides=CLIMBS),
)
FLOORS = (Floor("utrap", 1.0, published="VFH+ 17 %"), Floor("maze", 0.9, published="EGO 20-60 %"))


def run(report: Report) -> None:
    report.text(
        """
The trap is three walls, 6 to 10 m wide and 5 to 9 m deep, open towards the start and across the straight way to the
goal behind it. The maze has 6 x 6 rooms of 4 m behind a closed outer wall; it has to be crossed from corner to corner.
The court has walls of 4 to 6 m around the goal, which is approached at 3 m: there
`avoidance.altitude_search.max_climb` is 8. The vehicle knows none of them.
"""
    )
    flown.picture(report, SETUPS)
    fly_and_tell(report, SETUPS, FLOORS)
