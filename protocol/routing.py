"""MAVLink's rules for handing messages on between links (https://mavlink.io/en/guide/routing.html)."""

from functools import lru_cache

from protocol.framing import Frame
from protocol.messages import dialect, layout

Sender = tuple[int, int]
"""System and component."""

NOBODYS = frozenset({dialect.MAVLINK_MSG_ID_TIMESYNC, dialect.MAVLINK_MSG_ID_SETUP_SIGNING})
"""Between two ends of one link: clocks, and keys."""

_MOST_SENDERS = 64


def learn(seen: set[Sender], frame: Frame) -> None:
    """Who has sent this is on that link; so many at the most, since anybody can make up senders."""
    if frame.system and len(seen) < _MOST_SENDERS:
        seen.add((frame.system, frame.component))


def is_for(target: Sender, seen: set[Sender]) -> bool:
    """A message for this target belongs on a link where these senders were heard: for all, or for one of them."""
    system, component = target
    if system == 0:
        return True
    if component == 0:
        return any(each == system for each, _ in seen)
    return target in seen


def target_of(frame: Frame) -> Sender:
    """Whom a message is for; 0 stands for all, and for a message that names nobody."""
    if not frame.known:
        return 0, 0
    system_at, component_at = _places(frame.message_id)
    payload = frame.payload
    system = payload[system_at] if system_at is not None and system_at < len(payload) else 0
    component = payload[component_at] if component_at is not None and component_at < len(payload) else 0
    return system, component


@lru_cache(maxsize=512)
def _places(message_id: int) -> tuple[int | None, int | None]:
    """Where target_system and target_component are in a payload."""
    places: dict[str, int] = {}
    at = 0
    for field in layout(message_id).fields:
        places[field.name] = at
        at += field.size
    return places.get("target_system"), places.get("target_component")
