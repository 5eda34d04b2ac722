"""Joined flights whose telemetry is well formed and wrong, most with fresh stamps."""

from collections.abc import Callable

import numpy as np

from companion.mission.plan import Phase
from companion.supervision.states import State
from protocol.arrays import Array
from protocol.frames import from_euler, multiply, rotate
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined, mission_of
from tests.flights.short import landing

ATTITUDE, POSITION = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
QUICK = ('avoidance.method="none"',)
Fields = list[float]


def state_of(joined: Joined) -> State:
    """Asked anew: once asserted, a type checker takes the attribute for unchanged."""
    return joined.autopilot.supervisor.state


def meddled(change: Callable[[int, Fields], Fields], restamp: Callable[[int], int] = lambda stamp: stamp) -> Joined:
    """On the way at speed, from where on position and attitude, or their stamps, are changed."""
    joined = Joined(mission_of("square", "trajectory.laps=1"), overrides=QUICK)
    joined.fly(
        until=lambda joined: joined.autopilot.navigator.phase is Phase.TRACK and joined.vehicle.motion.speed > 0.7
    )
    encoder = Encoder(1, 1)

    def meddle(time_ns: int, data: bytes) -> bytes:
        heard = b""
        for frame in Framer().datagram(data):
            raw = frame.raw
            if frame.message_id in (ATTITUDE, POSITION):
                message = decode(frame)
                assert message is not None
                stamp, *values = [getattr(message, name) for name in message.fieldnames[:8]]
                raw = encoder.encode_fields(type(message), restamp(stamp), *change(frame.message_id, values))
            heard += raw
        return heard

    joined.meddle = meddle
    return joined


def test_a_stuck_position_hands_the_vehicle_over_within_300_ms() -> None:
    kept = list[float]()

    def freeze(message_id: int, values: Fields) -> Fields:
        if message_id != POSITION:
            return values
        kept[:] = kept or values
        return kept

    joined = meddled(freeze).fly(limit_s=0.3)
    assert state_of(joined) is State.WITHDRAW
    assert "position stuck" in (joined.autopilot.supervisor.fault or "")
    joined.fly(limit_s=2.0)
    assert joined.vehicle.motion.speed < 0.1 and joined.vehicle.summary().contacts == 0


def test_a_position_that_comes_again_with_its_stamp_is_as_old_as_it_was() -> None:
    """It brakes as without one, and the telemetry is lost half a second later."""
    joined, kept = Joined(mission_of("courier"), overrides=QUICK), list[bytes]()
    joined.fly(until=lambda joined: joined.vehicle.motion.position_ned[0] > 8.0)

    def repeat(time_ns: int, data: bytes) -> bytes:
        frames = list(Framer().datagram(data))
        kept[:] = kept or [frame.raw for frame in frames if frame.message_id == POSITION]
        return b"".join(kept[0] if frame.message_id == POSITION else frame.raw for frame in frames)

    joined.meddle, speed = repeat, joined.vehicle.motion.speed
    joined.fly(limit_s=0.48)
    assert state_of(joined) is State.FLY and joined.vehicle.motion.speed < 0.8 * speed
    joined.fly(limit_s=0.1)
    assert "telemetry lost" in (joined.autopilot.supervisor.fault or "")


def test_positions_that_queue_up_on_their_way_are_not_flown_by_for_long() -> None:
    """By a quarter of a second more with each second."""
    joined, queue = Joined(mission_of("courier"), overrides=QUICK), list[tuple[int, bytes]]()
    joined.fly(until=lambda joined: joined.vehicle.motion.position_ned[0] > 1.0)
    begin_ns = joined.vehicle.time_ns

    def late(time_ns: int, data: bytes) -> bytes:
        frames = list(Framer().datagram(data))
        queue.extend((time_ns, frame.raw) for frame in frames if frame.message_id == POSITION)
        heard = b"".join(frame.raw for frame in frames if frame.message_id != POSITION)
        while queue and time_ns - queue[0][0] >= 0.25 * (time_ns - begin_ns):
            heard += queue.pop(0)[1]
        return heard

    joined.meddle = late
    joined.fly(limit_s=10.0, until=lambda joined: joined.autopilot.supervisor.fault is not None)
    assert "telemetry lost" in (joined.autopilot.supervisor.fault or "") and joined.vehicle.flight.crash is None


def test_a_reset_of_the_estimator_is_followed_to_the_end() -> None:
    turn, shift = from_euler(0.0, 0.0, 1.2), np.array([40.0, -7.0, 3.0])

    def reset(message_id: int, values: Fields) -> Fields:
        told: list[Array] = [multiply(turn, np.array(values[:4])), np.array(values[4:])]
        if message_id == POSITION:
            told = [rotate(turn, np.array(values[:3])) + shift, rotate(turn, np.array(values[3:]))]
        changed: Fields = np.concatenate(told).tolist()
        return changed

    joined = meddled(reset).fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None
    assert np.hypot(*joined.vehicle.motion.position_ned[:2]) < 0.3
    assert any("reset" in text for text in joined.said)


def test_without_a_position_it_brakes_on_its_attitude() -> None:
    joined = Joined(mission_of("courier"), overrides=QUICK)
    joined.fly(until=lambda joined: joined.vehicle.motion.position_ned[0] > 8.0)
    joined.meddle = lambda time_ns, data: b"".join(
        frame.raw for frame in Framer().datagram(data) if frame.message_id != POSITION
    )
    speed, down = joined.vehicle.motion.speed, joined.vehicle.motion.position_ned[2]
    joined.fly(limit_s=0.48)
    assert state_of(joined) is State.FLY
    assert joined.vehicle.motion.speed < speed - 0.3
    assert abs(joined.vehicle.motion.position_ned[2] - down) < 0.2
    joined.fly(limit_s=0.1)
    assert state_of(joined) is State.WITHDRAW


def test_a_clock_that_falls_to_nothing_is_flown_on_with() -> None:
    fell = list[int]()

    def restart(stamp: int) -> int:
        fell[:] = fell or [stamp]
        return stamp - fell[0]

    joined = meddled(lambda message_id, values: values, restart).fly(limit_s=2.0)
    assert state_of(joined) is State.FLY and joined.autopilot.supervisor.fault is None
    assert any("clock was set" in text for text in joined.said)
    error = joined.tracking_error()
    assert np.linalg.norm(error[-500:], axis=1).max() < 0.1
