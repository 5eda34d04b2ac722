"""Who flies: the state of the flight, which nothing moves but the table of transitions."""

from companion.config import Settings
from companion.outcomes import Outcome, Verdict, worst
from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import Announcement, VehicleRequest, VehicleState, VehicleStatus
from companion.supervision.health import Health, Judged, health
from companion.supervision.limits import Limits
from companion.supervision.operations import OwnReport
from companion.supervision.states import COMMANDED, FLYING, OWN, REQUESTS, STREAMING, State
from companion.supervision.transitions import TABLE
from companion.supervision.watching import UNWATCHED, Descent, Watched

_PERIOD_NS = 20_000_000
"""50 Hz; no time in the settings is finer."""


class Supervisor:
    """The state and its time; nothing moves it but the table."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings.supervision
        self._limits = Limits(settings)
        self.state = State.FIND
        self._since_ns: int | None = None
        self._held_ns: int | None = None
        """Since when it has held, or stood still; None: it does neither."""
        self.flew = False
        """It has had the vehicle in flight, or on its way there."""
        self._verdicts: list[Verdict] = []
        """What decides how the flight comes out, in order, each kind once."""
        self._rose = False
        """By our own reckoning or by the vehicle's word."""
        self.due_ns = 0
        """When the health is to be looked at next."""
        self.waiting_for: str | None = None
        """What is missing before the flight, in words."""
        self._mode_reached = False
        """The vehicle was in the mode that the present state commands."""
        self._hands_over = False
        """The landing began with the vehicle in our hands, and nothing has been wrong since."""
        self._descent = Descent()
        self._seconds = 0.0
        """In this state."""

    def look(
        self,
        link: LinkReport,
        sensing: SensingReport,
        mission: MissionReport,
        own: OwnReport,
        vehicle: VehicleState | None,
        now_ns: int,
    ) -> tuple[Announcement | None, Announcement | None]:
        """Judge what the parts report: what is to be said of the limits, and of the row that was taken."""
        limits, news = self._limits.judge(self.state, link, sensing, mission, now_ns)
        watched = self.watch(link.status, link.word.current, vehicle, now_ns)
        held = 0.0 if self._held_ns is None else (now_ns - self._held_ns) * 1e-9
        seen = health(self.state, link, sensing, mission, own, Judged(watched, limits, held), now_ns)
        own.begin()
        return news, self.update(seen, now_ns)

    def update(self, health: Health, now_ns: int) -> Announcement | None:
        """Take the first row that fits, if any, and say so."""
        self.due_ns = now_ns + _PERIOD_NS
        self.waiting_for = health.missing
        if self._since_ns is None:
            self._since_ns = now_ns
        self._seconds = seconds = (now_ns - self._since_ns) * 1e-9
        self.flew = self.flew or self.state in FLYING
        self._rose = self._rose or health.plight.risen or health.airborne
        if self._hands_over:
            losses = any(row.condition(health, self._settings, seconds) for row in _LOSSES)
            self._hands_over = not (losses or health.plight.position_lost)
        row = next((row for row in _ROWS_OF[self.state] if row.condition(health, self._settings, seconds)), None)
        if row is not None and row.ends is not None:
            self._ends(row.ends, (row.cause or row.text).format(health=health, settings=self._settings))
        elif self.state in FLYING and self.state is not State.ADOPT and health.distress:  # which it is taken over for
            self._ends(
                Outcome.CRASHED if health.plight.crash else Outcome.EMERGENCY, health.plight.crash or health.distress
            )
        if row is None:
            return None
        self._hands_over = self.state in OWN and row.to is State.LAND and not health.plight.position_lost
        self.state = row.to
        self._since_ns = now_ns
        self._held_ns = (self._held_ns or now_ns) if row.to in (State.HOLD, State.GAP) else None
        self._seconds = 0.0
        self._mode_reached = False
        self._descent = Descent()
        return Announcement(row.severity, row.text.format(health=health, settings=self._settings))

    def watch(self, status: VehicleStatus, current: bool, vehicle: VehicleState | None, now_ns: int) -> Watched:
        """What has become of the mode that the present state commands, or of the vehicle's own failsafe.

        `current`: the status is newer than the command.
        """
        watched = self._descent.watch(status, current, vehicle, now_ns)
        if self.state is State.WATCH:
            return watched
        wanted = COMMANDED.get(self.state)
        if wanted is None:
            return UNWATCHED
        self._mode_reached = self._mode_reached or (current and status.mode is wanted)
        return Watched(self._mode_reached and current and status.mode is not wanted, watched.still)

    @property
    def request(self) -> VehicleRequest | None:
        """What the present state asks the vehicle for, as long as it has not been there."""
        if self.state is State.ADOPT and self._seconds < self._settings.stream_before_engaging:
            return None
        return None if self._mode_reached else REQUESTS.get(self.state)

    @property
    def streams(self) -> bool:
        """Setpoints are sent. At rest they go on in a landing until the vehicle is in its landing mode: a vehicle that
        has not heard of it would hold the last setpoint. There is no rest without a position."""
        return self.state in STREAMING or self._hands_over

    def failed(self, text: str) -> None:
        """The mission has failed, though the flight goes on."""
        self._ends(Outcome.LANDED_EARLY, text)

    def _ends(self, outcome: Outcome, cause: str) -> None:
        if all(verdict.outcome is not outcome for verdict in self._verdicts):
            self._verdicts.append(Verdict(outcome, cause))

    @property
    def verdict(self) -> Verdict | None:
        """What is wrong with the flight; None if nothing is."""
        return worst([self._as_it_came(verdict) for verdict in self._verdicts])

    @property
    def fault(self) -> str | None:
        """What was wrong first, in words; None for a flight without."""
        return self._as_it_came(self._verdicts[0]).text if self._verdicts else None

    def _as_it_came(self, verdict: Verdict) -> Verdict:
        """What ends a flight early keeps a vehicle that has not risen on the ground."""
        early = verdict.outcome in (Outcome.LANDED_EARLY, Outcome.RETURNED) and not self._rose
        return Verdict(Outcome.NO_TAKE_OFF, verdict.cause) if early else verdict


_LOSSES = tuple(row for row in TABLE if row.states >= OWN and row.to is not State.LAND)
"""Rows that take the vehicle out of our hands."""
_ROWS_OF = {state: tuple(row for row in TABLE if state in row.states) for state in State}
