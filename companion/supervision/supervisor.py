"""Who flies: the state of the flight, which nothing moves but the table of transitions."""

from companion.config import Settings
from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import Announcement, FlightMode, VehicleRequest
from companion.supervision.health import Health, health
from companion.supervision.limits import Limits
from companion.supervision.operations import OwnReport
from companion.supervision.states import COMMANDED, REQUESTS, State
from companion.supervision.transitions import TABLE

_PERIOD_NS = 20_000_000
"""50 Hz; no time in the settings is finer."""


class Supervisor:
    """The state and its time; nothing moves it but the table."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings.supervision
        self._limits = Limits(settings)
        self.state = State.FIND
        self._since_ns: int | None = None
        self.fault: str | None = None
        """The first fault, in words; None for a flight without."""
        self.due_ns = 0
        """When the health is to be looked at next."""
        self._mode_reached = False
        """The vehicle was in the mode that the present state commands."""

    def look(
        self, link: LinkReport, sensing: SensingReport, mission: MissionReport, own: OwnReport, now_ns: int
    ) -> tuple[Announcement | None, Announcement | None]:
        """Judge what the parts report: what is to be said of the limits, and of the row that was taken."""
        limits, news = self._limits.judge(self.state, link, sensing, mission, now_ns)
        taken_over = self.taken_over(link.status.mode)
        seen = health(self.state, link, sensing, mission, own, taken_over, limits)
        own.begin()
        return news, self.update(seen, now_ns)

    def update(self, health: Health, now_ns: int) -> Announcement | None:
        """Take the first row that fits, if any, and say so."""
        self.due_ns = now_ns + _PERIOD_NS
        if self._since_ns is None:
            self._since_ns = now_ns
        seconds = (now_ns - self._since_ns) * 1e-9
        for row in _ROWS_OF[self.state]:
            if row.condition(health, self._settings, seconds):
                text = row.text.format(health=health, settings=self._settings)
                if row.fault and self.fault is None:
                    self.fault = row.outcome.format(health=health) or text
                self.state = row.to
                self._since_ns = now_ns
                self._mode_reached = False
                return Announcement(row.severity, text)
        return None

    def taken_over(self, mode: FlightMode) -> bool:
        """The mode that the present state commands was reached before, and is not the vehicle's mode now."""
        wanted = COMMANDED.get(self.state)
        if wanted is None:
            return False
        self._mode_reached = self._mode_reached or mode is wanted
        return self._mode_reached and mode is not wanted

    @property
    def request(self) -> VehicleRequest | None:
        """What the present state asks the vehicle for, as long as it has not been there."""
        return None if self._mode_reached else REQUESTS.get(self.state)

    def failed(self, text: str) -> None:
        """The mission has failed, though the flight goes on."""
        if self.fault is None:
            self.fault = text


_ROWS_OF = {state: tuple(row for row in TABLE if state in row.states) for state in State}
