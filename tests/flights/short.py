"""What keeps joined flights short: a small map, and ends where a flight has shown what it is flown for."""

from companion.mission.plan import Phase
from companion.supervision.states import State
from studies.joined import Joined

SMALL_MAP = "avoidance.map.cells=128"
"""16 m."""


def landing(joined: Joined) -> bool:
    """All but the landing is flown."""
    return joined.autopilot.supervisor.state is State.LAND


def returning(joined: Joined) -> bool:
    """On the way home, or landing where there is none."""
    return joined.autopilot.navigator.phase is Phase.RETURN or landing(joined)
