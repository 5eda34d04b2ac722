"""Flying from a program: `Companion` (docs/api.md)."""

from companion.api.companion import Companion, FlightError
from companion.api.telemetry import Event, State
from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.outcomes import Outcome, Verdict

__all__ = [
    "Companion",
    "Delivery",
    "Event",
    "FlightError",
    "Mission",
    "Outcome",
    "Phase",
    "State",
    "Verdict",
    "Waypoint",
]
