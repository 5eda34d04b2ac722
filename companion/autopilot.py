"""The autopilot: `handle(event)` -> what to send; a pure step over its own state.

datagram -> link -> sensing -> navigator -> guidance -> controller -> guard -> controller -> gate -> link -> datagram
"""

from companion.avoidance.guard import Guard
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.config import Settings
from companion.control.controller import Controller
from companion.entering import entered, follow_delay, follow_output, heed_below, ordered, released, taken_up, unheeded
from companion.events import NOTHING, Datagram, Event, PlanReady, Reaction, Tick
from companion.guidance import Guidance
from companion.link.vehicle_link import VehicleLink
from companion.mission.navigator import Arrival, Navigator
from companion.mission.plan import Mission, Phase
from companion.sensing import sensing_of
from companion.state import Adoption, Announcement, Output, Reason, VehicleState
from companion.supervision.operations import OwnReport
from companion.supervision.states import COMMANDED, FLYING, FOLLOWING, OWN, STREAMING, State
from companion.supervision.supervisor import Supervisor
from companion.trace import ControlStep, pack
from protocol.vehicle_parameters import VehicleParameters


class Autopilot:
    """One flight of one mission."""

    def __init__(
        self,
        settings: Settings,
        body: VehicleParameters,
        mission: Mission,
        output: Output | None,
        adopt: Adoption | None = None,
    ) -> None:
        self.settings, self.body = settings, body
        self.supervisor = Supervisor(settings)
        self.link = VehicleLink(settings, output, needs_home=adopt is not None)
        self.sensing = sensing_of(settings)
        self.guard = Guard(settings.avoidance.guard) if settings.avoidance.looks_around else None
        self.guidance = Guidance(settings, mission, self.guard)
        self.navigator = Navigator(settings, mission, self.guidance.durations, lands=adopt is Adoption.LAND)
        self.controller = Controller(settings, body, self.link.readiness.output)
        self.own = OwnReport(settings.supervision, adopt, settings.limits.highest_thrust)
        self._plan: PlanResult | None = None
        self._said: list[Announcement] = []
        self._asks_from_ns = 0
        """The vehicle is asked for nothing before."""

    def handle(self, event: Event) -> Reaction:
        """Take one event in. Raises nothing for whatever bytes come."""
        trace, request, link = None, None, self.link
        match event:
            case Datagram():
                trace = self._receive(event)
            case Tick():
                trace, request = self._tick(event)
            case PlanReady():
                self._plan = event.result
            case _:
                self._say(self.own.take(event), unheeded(event, self.supervisor.state))
                self._say(ordered(event, link, self.navigator, self.guidance, self.sensing))
        datagram = link.outbox.flush()
        said, self._said = tuple(self._said), []
        return Reaction(datagram, trace, said, request) if datagram or said or trace or request else NOTHING

    @property
    def ended(self) -> bool:
        """There is nothing more to do."""
        return self.supervisor.state is State.ENDED

    def _say(self, *announcements: Announcement | None) -> None:
        for announcement in filter(None, announcements):
            self._said.append(announcement)
            self.link.outbox.say(announcement)

    def _receive(self, event: Datagram) -> bytes | None:
        now, due, take = event.time_ns, False, self.sensing.take
        for report in self.link.receive(event.data, now, whole=event.whole, sensor=event.sensor):
            if isinstance(report, Announcement):
                self._said.append(report)
            else:
                due = take(report, now) or due
        state = self.sensing.update() if due and not self.link.is_old(self.sensing.boot_time_ms, now) else None
        if state is None or not self.supervisor.streams:
            return None
        self.link.delays.take(self.sensing.boot_time_ms, now, self.link.peer)
        return self.own.sound(self._control, state, now)

    def _control(self, state: VehicleState, now: int) -> bytes:
        """Reference, acceleration, guard, attitude, gate; the payload of a TRACE record."""
        supervised, controller = self.supervisor.state, self.controller
        navigator, guidance = self.navigator, self.guidance
        follow_output(self.link, controller, now, airborne=self.own.airborne)
        here = controller.present(state, now)
        mass = self._mass_kg
        flies = controller.flies(state, now, mass, supervised is State.FLY, self.link.motors)
        airborne, blind = flies and supervised in FLYING, self.sensing.is_blind(now)
        sees = airborne and not blind
        if supervised in FOLLOWING or not airborne:  # what is sent would keep the vehicle wherever it is
            guidance.hold_at(state)
            controller.reset()
        elif blind:
            guidance.halt(now)
        elif supervised is State.FLY:
            self._fly(here, now)
        reference, ahead = map(guidance.reference, controller.reference_times(now))
        acceleration = controller.acceleration_command(state, now, self.link.delays.latest_ns, reference, mass, sees)
        verdict, changed = None, False
        if airborne and not sees:  # brakes on the attitude alone
            acceleration, changed = reference.acceleration_ned, True
        elif airborne and supervised in OWN:
            verdict = guidance.guarded(acceleration, here, navigator.step, now, held=supervised is State.HOLD)
        if verdict is not None:
            acceleration, changed = verdict.acceleration_ned, verdict.reason is not Reason.NONE
            guidance.yield_to(verdict, here, now)
        control, limited = controller.attitude_command(acceleration, now, ahead, mass, changed)
        if airborne:
            navigator.tracked(control[:6])
        lead = self.own.straying.look(control[:3] if sees and supervised in OWN else None)
        self._say(self.own.straying.news(guidance.keep_pace(now, lead), now))
        setpoint = controller.setpoint(control, idle=supervised not in FLYING)
        if self.own.passes(setpoint, airborne):
            self.link.outbox.setpoint(self.sensing.plausibility.setpoint(setpoint), self.sensing.boot_time_ms)
        what = supervised, navigator.phase, navigator.step_index, state, reference, control, limited
        return pack(ControlStep(*what, guidance.decision, guidance.free_distance, verdict))

    @property
    def _mass_kg(self) -> float:
        return self.body.mass_kg + (0.0 if self.navigator.released else self.body.parcel_mass_kg)

    def _fly(self, state: VehicleState, now: int) -> None:
        """Move the reference along the mission, and the mission along itself."""
        navigator, guidance, arrival = self.navigator, self.guidance, Arrival.NOT_YET
        said = navigator.go_on(state.position_ned, now)
        if said is not None:
            guidance.begin_leg(navigator.leg(state.position_ned), now)
        self._say(said, heed_below(state, now, self.settings.avoidance, navigator, guidance, self.sensing))
        leg = navigator.leg(state.position_ned)
        if leg.step.phase is Phase.RELEASE:
            arrival, outcome = released(self.link, navigator, now)
            self._say(outcome)
        elif leg.step.target_ned is not None:
            arrival = navigator.advance(guidance.steer(leg, state, now), state, now)
        if arrival is not Arrival.NOT_YET:
            guidance.arrive(arrival, leg, now)
        if arrival is Arrival.DONE:
            self._say(navigator.next_step(now, state.position_ned))
            guidance.begin_leg(navigator.leg(state.position_ned), now)

    def _tick(self, tick: Tick) -> tuple[bytes | None, PlanRequest | None]:
        now, sensing = tick.time_ns, self.sensing
        if self.own.ticked(tick.late_ns, now):
            self.link.said.stood_still(now)
        request = self._look_around(now) if self._plan or sensing.scan else None
        if now >= self.supervisor.due_ns:
            self._supervise(now)
        lacks_news = self.own.airborne and self.link.delays.lacks_news(sensing.boot_time_ms, now)
        state = sensing.state if lacks_news and self.supervisor.streams and not sensing.is_blind(now) else None
        return None if state is None else self.own.sound(self._control, state, now), request

    def _look_around(self, now: int) -> PlanRequest | None:
        """A plan is taken up, at the tick after it came so that no command waits for it; a scan becomes a request."""
        navigator, guidance, state = self.navigator, self.guidance, self.sensing.state
        seen, plan, self._plan = self.sensing.look(), self._plan, None
        if state is None or not navigator.steps:
            return None
        state = self.controller.present(state, now)
        if plan is not None:
            self._say(*taken_up(plan, state, now, navigator, guidance, self.supervisor))
        leg = navigator.leg(state.position_ned)
        if seen is None:
            return None
        self._say(guidance.margin.news())
        return guidance.look(*seen, navigator.lowest_return, state, leg, now)

    def _supervise(self, now: int) -> None:
        supervisor, state = self.supervisor, self.supervisor.state
        asks = state in STREAMING or state is State.CHECK
        self._say(*self.link.beat(now, asks_rates=asks, active=state > State.CHECK))
        parts = self.link, self.controller, self.navigator, self.guidance, self.sensing
        self._say(self.own.sound(follow_delay, now, *parts))
        link = self.link.report(now, supervisor.request, before_flight=state < State.FLY)
        sensing = self.sensing.report(now, self.guidance.map_age(now))
        outside = self.guidance.outside(self.link.readiness.fence)
        mission = self.navigator.report(now, self.sensing.state, outside, flying=state is State.FLY)
        news, announcement = supervisor.look(link, sensing, mission, self.own, self.sensing.state, now)
        self._say(self.sensing.plausibility.news(now), news, announcement)
        if announcement is not None:
            self._say(entered((state, supervisor.state), now, *parts))
            if state in OWN and supervisor.state in COMMANDED and self.own.sound(self._let_go):
                self._asks_from_ns = now + round(self.settings.supervision.level_before * 1e9)
        if now >= self._asks_from_ns:
            self.link.request(supervisor.request, now)

    def _let_go(self) -> bool:
        """The last setpoint in the air, where none follows: level, with the thrust that hovers. A mode of the vehicle's
        own may begin with the vertical acceleration that it finds, as ArduPilot's do. Whether it was sent.
        """
        if not self.settings.supervision.level_before or not self.own.airborne or self.supervisor.streams:
            return False
        setpoint = self.controller.level(self._mass_kg)
        sound = self.own.passes(setpoint, airborne=True)
        if sound:
            self.link.outbox.setpoint(setpoint, self.sensing.boot_time_ms)
        return sound
