"""What is wrong with what a vehicle says: well formed messages with other values, or none. Each function returns a new
`Change` with a state of its own.
"""

import math
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from protocol.arrays import Array
from protocol.frames import from_euler, multiply, rotate
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.faults.injector import Change

ATTITUDE = (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_ATTITUDE)
POSITION = (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,)
RING = (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,)
HEARTBEAT = (dialect.MAVLINK_MSG_ID_HEARTBEAT,)

_STAMPS = ("time_boot_ms", "time_usec")
_RANGES_CM = (50, 1500)
_SAME = 1e-6
"""So near to each other two floats say the same."""

Edit = Callable[[Any, int], bool]
"""Changes a message, at a time (ns); False: it is not sent."""


def edited(edit: Edit, ids: Collection[int] = ()) -> Change:
    """The messages with these ids, or all, as `edit` leaves them; the others, and all sequence numbers, stay."""

    def change(now_ns: int, data: bytes) -> bytes:
        out = b""
        for frame in Framer().datagram(data):
            message = decode(frame) if not ids or frame.message_id in ids else None
            if message is None:
                out += frame.raw
            elif edit(message, now_ns):
                encoder = Encoder(frame.system, frame.component)
                encoder.sequence = frame.sequence
                out += encoder.encode(message)
        return out

    return change


def once(edit: Edit) -> Edit:
    """The first message alone."""
    done = list[bool]()

    def first(message: Any, now_ns: int) -> bool:
        if done:
            return True
        done.append(True)
        return edit(message, now_ns)

    return first


def _same(value: Any, other: Any) -> bool:
    return bool(np.allclose(value, other, rtol=0.0, atol=_SAME)) if isinstance(value, float | list) else value == other


def frozen(ids: Collection[int]) -> Change:
    """What was said first is said for ever, with fresh stamps, from where something else would have been said: what
    stands still anyhow, but for a float's last digits, is not frozen yet."""
    kept: dict[int, dict[str, Any]] = {}
    frozen_ids = set[int]()

    def edit(message: Any, now_ns: int) -> bool:
        said = {name: getattr(message, name) for name in message.fieldnames if name not in _STAMPS}
        number = message.get_msgId()
        first = kept.setdefault(number, said)
        if number in frozen_ids or any(not _same(value, first[name]) for name, value in said.items()):
            frozen_ids.add(number)
            for name, value in first.items():
                setattr(message, name, value)
        return True

    return edited(edit, ids)


def missing(ids: Collection[int], seconds: float = math.inf) -> Change:
    """They are not sent, for so long from the first on."""
    since = list[int]()

    def edit(message: Any, now_ns: int) -> bool:
        since[:] = since or [now_ns]
        return now_ns - since[0] >= seconds * 1e9

    return edited(edit, ids)


def late(ids: Collection[int], seconds: float) -> Change:
    """They are said so long after they were true, with the stamps of then."""
    waiting = list[tuple[int, Any]]()

    def edit(message: Any, now_ns: int) -> bool:
        waiting.append((now_ns, [getattr(message, name) for name in message.fieldnames]))
        while len(waiting) > 1 and waiting[1][0] <= now_ns - seconds * 1e9:
            waiting.pop(0)
        for name, value in zip(message.fieldnames, waiting[0][1], strict=True):
            setattr(message, name, value)
        return True

    return edited(edit, ids)


def random_ring(seed: int) -> Change:
    """Each ring is noise."""
    rng = np.random.default_rng([seed, 330])

    def edit(message: Any, now_ns: int) -> bool:
        message.distances = rng.integers(*_RANGES_CM, len(message.distances)).tolist()
        return True

    return edited(edit, RING)


def impossible_ring() -> Change:
    """Beams 100 degrees apart, many times round."""
    return edited(_sets(increment_f=100.0), RING)


def turned(degrees: float, *, whole_frame: bool) -> Change:
    """The heading is reset, alone or with the frame of positions and velocities."""
    turn = from_euler(0.0, 0.0, math.radians(degrees))

    def edit(message: Any, now_ns: int) -> bool:
        match message.get_msgId():
            case dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
                before = np.array([message.q1, message.q2, message.q3, message.q4])
                message.q1, message.q2, message.q3, message.q4 = multiply(turn, before).tolist()
            case dialect.MAVLINK_MSG_ID_ATTITUDE:
                message.yaw = math.remainder(message.yaw + math.radians(degrees), 2.0 * math.pi)
            case _ if whole_frame:
                message.x, message.y, message.z = _rotated(turn, message.x, message.y, message.z)
                message.vx, message.vy, message.vz = _rotated(turn, message.vx, message.vy, message.vz)
        return True

    return edited(edit, (*ATTITUDE, *POSITION))


def _rotated(turn: Array, *vector: float) -> list[float]:
    values: list[float] = rotate(turn, np.array(vector)).tolist()
    return values


def shifted(north: float = 0.0, down: float = 0.0) -> Change:
    """The position is reset by so much (m)."""

    def edit(message: Any, now_ns: int) -> bool:
        message.x += north
        message.z += down
        return True

    return edited(edit, POSITION)


def swift(north_m_s: float, *, one: bool) -> Change:
    """A velocity that no vehicle has, in one message or in all."""
    edit = _sets(vx=north_m_s)
    return edited(once(edit) if one else edit, POSITION)


def stamped_ahead(ids: Collection[int], seconds: float) -> Change:
    """One message has the stamp of a later time."""

    def edit(message: Any, now_ns: int) -> bool:
        message.time_boot_ms += round(seconds * 1e3)
        return True

    return edited(once(edit), ids)


def clock_back(seconds: float | None) -> Change:
    """The vehicle's clock goes back by so much, or to 0; nothing else restarts."""
    back_us = list[int]() if seconds is None else [round(seconds * 1e6)]

    def edit(message: Any, now_ns: int) -> bool:
        if not back_us:
            if "time_boot_ms" not in message.fieldnames:
                return True
            back_us.append(message.time_boot_ms * 1000)
        for name, unit_us in (("time_boot_ms", 1000), ("time_usec", 1)):
            if name in message.fieldnames:
                setattr(message, name, max(getattr(message, name) - back_us[0] // unit_us, 0))
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_TIMESYNC and message.tc1:
            message.tc1 = max(message.tc1 - back_us[0] * 1000, 1)
        return True

    return edited(edit)


def _sets(**values: float) -> Edit:
    def edit(message: Any, now_ns: int) -> bool:
        for name, value in values.items():
            setattr(message, name, value)
        return True

    return edit
