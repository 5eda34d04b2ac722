"""Places where the vehicle is enclosed, and the ways are hardly wider than it."""

from studies import crowded, flown, worlds
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report
from studies.traps import PATIENT

NAME = "enclosed"
TITLE = "Shafts, corridors, alleys, shelves, offices"

SETUPS = (
    Setup("shaft", "out of a shaft", worlds.shaft, (3.0,), 60.0, 50),
    Setup("corridor", "passage 1.0-1.1 m wide", worlds.corridor, (3.0,), 180.0, 40, has_way=True, overrides=PATIENT),
    Setup("alley", "into a dead-end alley", worlds.alley, (3.0,), 180.0, 40, overrides=PATIENT),
    Setup("warehouse", "gaps of 1.1-1.4 m between shelves", crowded.warehouse, (3.0,), 180.0, 50, has_way=True,
          overrides=PATIENT),
    Setup("office", "office, doors of 1.0-1.2 m", worlds.office, (3.0,), 240.0, 50, has_way=True, overrides=PATIENT),
)  # fmt: skip
FLOORS = (Floor("shaft", 1.0), Floor("corridor", 0.95), Floor("alley", 1.0), Floor("warehouse", 0.98))


def run(report: Report) -> None:
    report.text(
        """
The flight begins in a shaft 1.1 to 1.2 m wide, closed ahead and open behind. The corridor is a straight passage, 4 to
8 m deep and 1.0 to 1.1 m wide, through a block that fills a yard. The alley is 1.2 to 1.3 m wide and 4 to 8 m deep,
with a waypoint at its dead end; the goal is back at the start. The warehouse is a closed hall with two to four rows of
shelves across it, each with one gap. The office has twelve rooms of 5 m with doors of 1.0 to 1.2 m, to be crossed from
corner to corner.
"""
    )
    flown.picture(report, SETUPS)
    fly_and_tell(report, SETUPS, FLOORS)
