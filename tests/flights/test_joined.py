"""Whole flights with both sides joined in memory: what the mission comes to, and what faults in flight come to."""

import copy
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.avoidance.methods import GoalRule
from companion.avoidance.none import NoAvoidance
from companion.events import Datagram, PlanReady
from companion.link.vehicle_texts import vehicle_text
from companion.mission.plan import Mission, Phase
from companion.state import AvoidanceDecision, Output, VehicleRequest
from companion.supervision.states import State
from protocol.arrays import Array
from protocol.framing import Framer
from protocol.messages import Encoder, decode, decoder_of, dialect
from studies.joined import Joined, mission_of
from tests.flights.short import SMALL_MAP, landing, returning
from vehicle_sim.autopilot import orders
from vehicle_sim.world import World

COURIER = mission_of("courier")
QUICK = ('avoidance.method="paper"',)
"""Where the way does not matter: without the map, which takes half of a flight's time."""
FREE = ("avoidance.method=none",)
HOVER, SHORT = mission_of("hover"), mission_of("errand")
BRIEF = msgspec.structs.replace(HOVER, waypoints=[msgspec.structs.replace(HOVER.waypoints[0], hold_s=2.5)])


def in_phase(phase: Phase) -> Callable[[Joined], bool]:
    return lambda joined: joined.autopilot.navigator.phase is phase and joined.autopilot.supervisor.state is State.FLY


def without(*message_ids: int) -> tuple[Callable[[int, bytes], bytes], list[int]]:
    """A meddler that keeps these messages from the companion once it is armed by `start`."""
    start = [10**18]

    def meddle(time_ns: int, data: bytes) -> bytes:
        if time_ns < start[0]:
            return data
        return b"".join(frame.raw for frame in Framer().datagram(data) if frame.message_id not in message_ids)

    return meddle, start


def fly_then_lose(*message_ids: int, mission: Mission = COURIER) -> Joined:
    """Fly until the route, lose the messages, go on until the end."""
    meddle, start = without(*message_ids)
    joined = Joined(mission, meddle=meddle, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    start[0] = joined.vehicle.time_ns
    return joined


def test_the_courier_delivers() -> None:
    """Who has battery enough hears nothing of it; the clearance seen in the map, up to 3 m, is near the truth."""
    joined = Joined(COURIER, seed=2)
    gaps = clearance_gaps(joined, 2.2)
    joined.fly()
    summary = joined.vehicle.summary()
    assert joined.autopilot.supervisor.fault is None and joined.autopilot.navigator.released
    assert summary.outcome == "landed" and summary.contacts == 0 and summary.released
    assert summary.least_clearance_m is not None and summary.least_clearance_m >= 0.5
    assert summary.released_at_ned is not None
    assert np.hypot(summary.released_at_ned[0] - 120.0, summary.released_at_ned[1]) < 0.3
    assert np.hypot(*summary.final_position_ned[:2]) < 0.3
    rates = np.degrees(joined.trace()["rates_command_frd"][joined.trace()["state"] == State.FLY.value])
    shaking = np.diff(rates, axis=0)  # deg/s from one control step to the next
    assert np.sqrt((shaking**2).mean(axis=0)).max() < 5.0 and np.abs(shaking).max() < 40.0
    assert_sound_setpoints(joined)
    assert not any("battery" in text for text in joined.said)
    assert_near(gaps)


def clearance_gaps(joined: Joined, sees_m: float) -> list[float]:
    """By how much what the companion takes for its clearance is too large, in 30 s of a flight, where the truth is
    below `sees_m`."""
    gaps = []
    while joined.vehicle.time_ns < 30e9:
        joined.tick()
        seen = joined.autopilot.guidance.decision.clearance
        true = joined.vehicle.world.clearance(joined.vehicle.state[:3]) - 0.36
        if (
            joined.autopilot.supervisor.state is State.FLY
            and true < sees_m
            and joined.vehicle.motion.position_ned[2] < -2.9
        ):
            gaps.append(seen - true)
    return gaps


def assert_near(gaps: list[float]) -> None:
    assert len(gaps) > 500
    assert np.percentile(gaps, 1) > -1.0  # seen is level: below and above it the truth is farther
    assert np.median(np.abs(gaps)) < 0.3


def assert_sound_setpoints(joined: Joined) -> None:
    frames = [frame for data in joined.sent for frame in Framer().datagram(data)]
    setpoints = [decode(each) for each in frames if each.message_id == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET]
    assert len(setpoints) > 10_000
    for message in filter(None, setpoints):
        assert message.type_mask == 0x80
        assert 0.0 <= message.thrust <= 1.0
        assert np.linalg.norm(message.q) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("output", Output)
def test_hover_on_each_output(output: Output) -> None:
    joined = Joined(BRIEF, output=output, overrides=FREE).fly()
    assert joined.autopilot.supervisor.fault is None
    assert joined.vehicle.summary().outcome == "landed"
    trace = joined.trace()
    hover = trace[trace["phase"] == Phase.ROUTE.value][300:]
    assert np.abs(hover["position_ned"] - hover["reference_position_ned"]).max() < 0.01
    weight = (joined.autopilot.body.mass_kg + joined.autopilot.body.parcel_mass_kg) * 9.81
    assert hover["thrust_command"].mean() == pytest.approx(weight / joined.autopilot.body.max_thrust_n, rel=0.005)


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not() -> None:
    first, second, other = (Joined(SHORT, seed=seed, overrides=(SMALL_MAP,)).fly(limit_s=8.0) for seed in (3, 3, 4))
    heard, again, else_heard = (
        [each for each in flight.events if not isinstance(each, PlanReady)] for flight in (first, second, other)
    )
    assert heard == again and first.sent == second.sent
    assert heard != else_heard and len(first.events) > len(heard)


def ask_mode(joined: Joined, *main_and_sub: float) -> None:
    """DO_SET_MODE by another ground station."""
    fields = (1, 1, dialect.MAV_CMD_DO_SET_MODE, 0, 1.0, *main_and_sub, 0.0, 0.0, 0.0, 0.0)
    joined.vehicle.receive(Encoder(1, 190).encode_fields(dialect.MAVLink_command_long_message, *fields))


def state_of(joined: Joined) -> State:
    """Asked anew: once asserted, a type checker takes the attribute for unchanged."""
    return joined.autopilot.supervisor.state


def sent_ids(joined: Joined) -> set[int]:
    return {frame.message_id for data in joined.sent for frame in Framer().datagram(data)}


def test_pilot_takes_over() -> None:
    """Nothing is commanded, and what is sent would keep the vehicle where it is; after a time nothing is sent."""
    joined = Joined(COURIER, overrides=(*QUICK, "supervision.resume_within=5.0")).fly(until=in_phase(Phase.ROUTE))
    ask_mode(joined, 4.0, 3.0)
    joined.fly(limit_s=1.0)
    assert state_of(joined) is State.RELINQUISHED
    joined.sent.clear()
    joined.fly(limit_s=3.0)
    assert dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET in sent_ids(joined)
    assert dialect.MAVLINK_MSG_ID_COMMAND_LONG not in sent_ids(joined)
    joined.fly(limit_s=2.0)
    assert state_of(joined) is State.RELEASED
    joined.sent.clear()
    joined.fly(limit_s=5.0)
    assert not {dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET, dialect.MAVLINK_MSG_ID_COMMAND_LONG} & sent_ids(joined)
    assert state_of(joined) is State.RELEASED


def test_who_was_held_up_in_mid_leg_and_given_control_back_delivers() -> None:
    joined = Joined(SHORT, seed=2, overrides=(SMALL_MAP,))
    joined.fly(until=lambda joined: in_phase(Phase.ROUTE)(joined) and joined.vehicle.motion.position_ned[0] > 6.0)
    step = joined.autopilot.navigator.step_index
    ask_mode(joined, 4.0, 3.0)
    joined.fly(limit_s=4.0)
    assert state_of(joined) is State.RELINQUISHED
    ask_mode(joined, 6.0, 0.0)
    joined.fly(limit_s=0.9)
    assert state_of(joined) is State.HOLD
    joined.fly(limit_s=0.3)
    assert state_of(joined) is State.FLY and joined.autopilot.navigator.step_index == step
    joined.fly(until=returning)
    summary = joined.vehicle.summary()
    assert joined.autopilot.supervisor.fault is None and joined.autopilot.navigator.released
    assert summary.contacts == 0 and summary.released_at_ned is not None
    assert np.hypot(summary.released_at_ned[0] - 16.0, summary.released_at_ned[1]) < 0.3


@pytest.mark.parametrize("output", Output)
def test_control_changes_hands_without_a_jerk_and_its_time_counts_for_nothing(output: Output) -> None:
    overrides = (*FREE, "supervision.step_timeout=3.0")
    joined = Joined(BRIEF, output=output, overrides=overrides).fly(until=in_phase(Phase.ROUTE)).fly(limit_s=1.0)
    ask_mode(joined, 4.0, 3.0)
    joined.fly(limit_s=7.0)  # longer than the step may take
    assert state_of(joined) is State.RELINQUISHED and joined.vehicle.motion.speed < 0.02
    place, farthest = np.array(joined.vehicle.motion.position_ned), 0.0
    ask_mode(joined, 6.0, 0.0)
    while state_of(joined) is not State.FLY:
        joined.tick()
        farthest = max(farthest, float(np.linalg.norm(joined.vehicle.motion.position_ned - place)))
    assert farthest < 0.05
    joined.fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None


def test_a_vehicle_given_back_at_speed_and_elsewhere_brakes_first() -> None:
    """Others sent it 12 m aside, and give it back while it moves."""
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE)).fly(limit_s=2.0)
    north, east, down = joined.vehicle.motion.position_ned
    orders.reposition(joined.vehicle.flight, (north, east + 12.0, down - 1.0), None, None)
    joined.fly(limit_s=30.0, until=lambda joined: joined.vehicle.motion.velocity_ned[1] > 3.0)
    theirs = joined.trace()
    theirs = theirs[theirs["state"] == State.RELINQUISHED.value]
    assert len(theirs) > 200 and np.abs(theirs["disturbance_ned"]).max() < 0.01, "their accelerations teach nothing"
    place, speed = np.array(joined.vehicle.motion.position_ned), joined.vehicle.motion.velocity_ned[1]
    ask_mode(joined, 6.0, 0.0)
    joined.fly(limit_s=1.2, until=in_phase(Phase.ROUTE))
    assert joined.vehicle.motion.speed < 0.3 * speed
    assert np.linalg.norm(joined.vehicle.motion.position_ned - place) < speed
    joined.fly(limit_s=3.0)
    assert joined.vehicle.motion.velocity_ned[0] > 1.0
    assert state_of(joined) is State.FLY and joined.autopilot.supervisor.fault is None


@pytest.mark.parametrize("known", [False, True])
def test_a_vehicle_that_restarts_in_other_hands_is_given_back(known: bool) -> None:
    """Its clock falls to 0, and control is given back as soon as its position has come, or before: the companion flies
    on, or asks the vehicle to hold."""
    attitude, position = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    values = {attitude: 7, position: 6}
    restart_ns, held_back, encoder = [10**18], {position, attitude}, Encoder(1, 1)

    def meddle(now: int, data: bytes) -> bytes:
        if now < restart_ns[0]:
            return data
        heard = b""
        for frame in Framer().datagram(data):
            if frame.message_id in values:
                message = decode(frame)
                assert message is not None
                fields = [getattr(message, name) for name in message.fieldnames[1 : 1 + values[frame.message_id]]]
                renewed = encoder.encode_fields(type(message), (now - restart_ns[0]) // 1_000_000, *fields)
                heard += b"" if frame.message_id in held_back else renewed
            elif attitude not in held_back or frame.message_id != dialect.MAVLINK_MSG_ID_ATTITUDE:
                heard += frame.raw
        return heard

    joined = Joined(BRIEF, overrides=QUICK, meddle=meddle).fly(until=in_phase(Phase.ROUTE)).fly(limit_s=1.0)
    ask_mode(joined, 4.0, 3.0)
    joined.fly(limit_s=1.0)
    restart_ns[0] = joined.vehicle.time_ns
    joined.fly(limit_s=0.32)  # it is silent for longer than one whose clock is set
    held_back.remove(attitude)
    joined.fly(limit_s=0.02)
    assert any("rebooted" in text for text in joined.said) and joined.autopilot.sensing.state is None
    ask_mode(joined, 6.0, 0.0)
    if known:  # and no attitude after it, before the companion hears of the mode
        held_back.clear()
        held_back.add(attitude)
    joined.fly(limit_s=2.0, until=lambda joined: joined.autopilot.supervisor.state is not State.RELINQUISHED)
    assert joined.autopilot.sensing.state is None
    held_back.clear()
    joined.fly(limit_s=1.2)
    assert state_of(joined) is (State.FLY if known else State.WITHDRAW)
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed"
    assert joined.autopilot.supervisor.fault is None if known else joined.autopilot.supervisor.fault is not None


def test_a_vehicle_that_failed_over_by_itself_is_not_taken_back() -> None:
    """Its stream was lost on the way: it holds and lands, and hears no setpoint that would bring it back."""
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    joined.vehicle.receive, receive = (lambda *_: None), joined.vehicle.receive  # type: ignore[method-assign]
    joined.fly(limit_s=1.2)
    joined.vehicle.receive = receive  # type: ignore[method-assign]
    joined.sent.clear()
    joined.fly(limit_s=60.0)
    assert state_of(joined) is State.ENDED and joined.autopilot.supervisor.fault is not None
    assert joined.vehicle.summary().outcome == "landed"
    assert dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET not in sent_ids(joined)


def test_ring_lost_stops_the_vehicle_and_then_lands_it() -> None:
    joined = fly_then_lose(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE)
    joined.fly(limit_s=0.7)
    assert joined.autopilot.supervisor.state is State.HOLD
    joined.fly(limit_s=3.0)
    assert np.linalg.norm(joined.vehicle.motion.velocity_ned) < 0.05
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed"
    assert "landing" in (joined.autopilot.supervisor.fault or "")
    assert any("no ring" in text for text in joined.said)


def test_ring_back_in_time_goes_on() -> None:
    joined = fly_then_lose(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, mission=SHORT)
    joined.fly(limit_s=2.0)
    assert joined.autopilot.supervisor.state is State.HOLD
    joined.meddle = lambda time_ns, data: data
    joined.fly(until=in_phase(Phase.RETURN))
    assert joined.autopilot.navigator.released and joined.autopilot.supervisor.fault is None


@pytest.mark.parametrize("message_id", [dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, 32])
def test_telemetry_lost_hands_the_vehicle_to_its_own_autopilot(message_id: int) -> None:
    joined = fly_then_lose(message_id)
    joined.fly(limit_s=0.7)
    assert joined.autopilot.supervisor.state is State.WITHDRAW
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed"
    assert "telemetry lost" in (joined.autopilot.supervisor.fault or "")
    assert joined.vehicle.summary().contacts == 0


def test_silent_vehicle_ends_the_companion() -> None:
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    joined.meddle = lambda time_ns, data: b""
    joined.fly(limit_s=5.0)
    assert joined.autopilot.ended
    assert "silent" in joined.said[-1]


@pytest.mark.parametrize("field", [1, 4, 5, 7])
def test_nan_in_the_telemetry_never_reaches_the_output(field: int) -> None:
    """The first and the last of the attitude's and of the rates' fields in turn; the vehicle is handed over, nothing
    unsound is sent."""
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    spoiler = Encoder(1, 1)

    def spoil(time_ns: int, data: bytes) -> bytes:
        out = b""
        for frame in Framer().datagram(data):
            if frame.message_id == dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
                message = decode(frame)
                assert message is not None
                fields = [getattr(message, name) for name in message.fieldnames[:8]]
                fields[field] = float("nan")
                out += spoiler.encode_fields(type(message), *fields)
            else:
                out += frame.raw
        return out

    joined.meddle = spoil
    joined.fly(limit_s=0.2)
    assert joined.autopilot.supervisor.state is State.WITHDRAW
    assert "bad telemetry" in (joined.autopilot.supervisor.fault or "")
    assert joined.autopilot.link.traffic.messages_refused >= 3


def test_crash_is_a_crash() -> None:
    """Without avoidance the pole in the way is hit: the judge of the demo is not blind."""
    joined = Joined(COURIER, overrides=('avoidance.method="none"',)).fly()
    summary = joined.vehicle.summary()
    assert summary.outcome == "crashed" and summary.contacts == 1 and summary.contact_with
    assert joined.autopilot.supervisor.fault is not None


class Watched:
    """A method of avoidance that keeps what it is shown."""

    def __init__(self, method: GoalRule) -> None:
        self._method = method
        self.seen: list[Array] = []

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        self.seen.append(points_ned)
        return self._method.decide(points_ned, position_ned, velocity_ned, goal_ned, speed)


def test_ring_world_agrees_with_the_world() -> None:
    """Every return that the companion placed in the world, with the pose of the scan's own time, lies on a surface; and
    the clearance that it sees in a flat ring of 5 degree sectors is near the world's at the same moments."""
    joined = Joined(COURIER, overrides=QUICK, seed=7)
    watched = Watched(joined.autopilot.guidance.method)
    joined.autopilot.guidance.method = watched
    assert_near(clearance_gaps(joined, 5.0))
    world: World = joined.vehicle.world
    distances = [world.clearance(point) for points in watched.seen for point in points]
    assert len(distances) > 2000
    assert np.percentile(np.abs(distances), 95) < 0.6


@pytest.mark.parametrize(
    ("mission", "until_s", "output"),
    [*(("square", 11.0, output) for output in Output), ("courier", 22.0, Output.ATTITUDE)],
)
def test_the_vehicle_survives_its_companion(mission: str, until_s: float, output: Output) -> None:
    """The companion dies at random moments, on any output: the vehicle holds, lands and disarms, unhurt. In the street
    at moments at which nothing stands where it brakes: it is blind without its companion."""
    joined = Joined(mission_of(mission), output=output, overrides=QUICK)
    moments = np.sort(np.random.default_rng(4).uniform(2.0, until_s, 3))
    for moment in moments:
        joined.fly(limit_s=moment - joined.vehicle.time_ns * 1e-9)
        orphan = copy.deepcopy(joined.vehicle)
        heard, limit_ns = b"", orphan.time_ns + 20_000_000_000
        while not orphan.finished:
            assert orphan.time_ns < limit_ns
            heard += b"".join(orphan.advance())
        summary = orphan.summary()
        assert (summary.outcome, summary.contacts) == ("landed", 0)
        said = [
            vehicle_text(decoder_of(dialect.MAVLINK_MSG_ID_STATUSTEXT)(frame).text)
            for frame in Framer().feed(heard)
            if frame.message_id == dialect.MAVLINK_MSG_ID_STATUSTEXT
        ]
        assert any("holding" in text for text in said) and any("landing" in text for text in said), said


def blinded(repeat: bool) -> Callable[[int, bytes], bytes]:
    """The LiDAR says that it measured nothing, or the same ring for ever."""
    sender = Encoder(1, 1)
    first: list[Any] = []

    def meddle(time_ns: int, data: bytes) -> bytes:
        out = b""
        for frame in Framer().datagram(data):
            message = decode(frame)
            if message is None or frame.message_id != dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE:
                out += frame.raw
                continue
            if not repeat:
                message.distances = [65535] * 72
            first.append(message)
            out += sender.encode(first[0] if repeat else message)
        return out

    return meddle


@pytest.mark.parametrize("repeat", [False, True])
def test_a_blind_or_frozen_ring_is_no_ring(repeat: bool) -> None:
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    joined.meddle = blinded(repeat)
    joined.fly(limit_s=0.8)
    assert joined.autopilot.supervisor.state is State.HOLD
    words = f"only {'repeated' if repeat else 'blind'} rings for"
    assert any(words in text for text in joined.said)


def test_a_pilot_who_stops_the_landing_is_not_fought() -> None:
    joined = (
        Joined(BRIEF, overrides=FREE)
        .fly(until=lambda joined: joined.autopilot.supervisor.state is State.LAND)
        .fly(limit_s=0.5)
    )
    ask_mode(joined, 4.0, 3.0)
    joined.fly(limit_s=0.5)
    joined.sent.clear()
    joined.fly(limit_s=5.0)
    assert joined.autopilot.supervisor.state is State.RELEASED
    ids = {frame.message_id for data in joined.sent for frame in Framer().datagram(data)}
    assert dialect.MAVLINK_MSG_ID_COMMAND_LONG not in ids


def test_an_answer_to_somebody_else_delivers_nothing() -> None:
    joined = Joined(COURIER, overrides=QUICK).fly(until=in_phase(Phase.ROUTE))
    autopilot = joined.autopilot
    autopilot.link.request(VehicleRequest.RELEASE, joined.vehicle.time_ns)
    for target, accepted in (((255, 190), False), ((1, 191), True)):
        ack = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_DO_GRIPPER, 0, 0, 0, *target)
        autopilot.handle(Datagram(joined.vehicle.time_ns, Encoder(1, 1).encode(ack)))
        assert autopilot.link.requests.answer(VehicleRequest.RELEASE).accepted is accepted


def test_the_guard_stops_what_no_method_would() -> None:
    """Sent straight through the pole, as in the crash above, and as fast: the guard alone keeps it off, and nothing
    winds up against what it does not let through."""
    joined = Joined(COURIER, overrides=('avoidance.method="paper"', "avoidance.guard.enabled=true"))
    joined.autopilot.guidance.method = NoAvoidance(joined.autopilot.settings.avoidance)
    joined.fly(limit_s=26.0)
    trace = joined.trace()
    assert joined.vehicle.summary().contacts == 0 and joined.vehicle.flight.crash is None
    stopped = trace["guard_reason"] > 0
    assert stopped.sum() > 100 and trace["guard_change"][stopped].max() > 0.5
    speed = np.linalg.norm(trace["velocity_ned"], axis=1)
    assert speed[: np.argmax(stopped)].max() > 4.0 and speed[-2500:].max() < 0.5, "a whole flight's speed is taken off"
    assert not trace["guard_change"][~stopped].any()
    assert np.abs(trace["disturbance_ned"]).max() < 1.0
