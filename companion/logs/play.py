"""The vehicle's side of a log on the wire again, with its own timing, for whoever listens."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.logs.traffic import Sent, Traffic, open_traffic
from protocol.clock import RealClock
from protocol.flightlog import Direction, FlightLogError
from protocol.transport import Transport

_LONGEST_WAIT_S = 0.2
_LONG_WAIT_S = 5.0
_SHORTEST_ROUND_S = 1.0
"""By the wall's clock: a log of no length is not to flood anybody."""
_STATUS_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Played:
    """What went out."""

    datagrams: int
    bytes: int
    played_s: float
    """Of the log's time."""


def play(
    path: Path,
    transport: Transport,
    *,
    speed: float = 1.0,
    start_s: float = 0.0,
    loop: bool = False,
    progress: Callable[[float], None] = lambda time_s: None,
    pausing: Callable[[float], None] = lambda wait_s: None,
) -> Played:
    """Send what the vehicle sent from `start_s` on, `speed` times as fast; for ever with `loop`, a round a second at
    most.

    What the other end answers is received and left alone. `progress` is told the log's time each second of it,
    `pausing` how long (s) nothing will be sent where that is long.
    Raises FlightLogError for a log that can't be read or has nothing from then on.
    """
    traffic = open_traffic(path)
    count = size = 0
    played_ns = 0
    while True:
        clock = RealClock(speed)
        first_ns: int | None = None
        told_ns = 0
        for sent in _vehicle(traffic, start_s * 1e9):
            if first_ns is None:
                first_ns = told_ns = sent.time_ns
            wait_s = clock.wall_seconds_until(sent.time_ns - first_ns)
            if wait_s > _LONG_WAIT_S:
                pausing(wait_s)
            _wait(clock, sent.time_ns - first_ns, transport)
            transport.send(sent.data)
            count += 1
            size += len(sent.data)
            if sent.time_ns >= told_ns:
                progress(sent.time_ns * 1e-9)
                told_ns = sent.time_ns + _STATUS_NS
            played_ns = max(played_ns, sent.time_ns - first_ns)
        if first_ns is None:
            raise FlightLogError(f"{path}: the vehicle sent nothing from {start_s:g} s on")
        if not loop:
            return Played(count, size, played_ns * 1e-9)
        _wait(clock, round(_SHORTEST_ROUND_S * speed * 1e9), transport)


def _vehicle(traffic: Traffic, start_ns: float) -> Iterator[Sent]:
    """From `start_ns` after the log's first datagram on; all for 0, also what is stamped before the first."""
    began_ns: int | None = None
    for sent in traffic.sent():
        began_ns = sent.time_ns if began_ns is None else began_ns
        if sent.direction is Direction.IN and (start_ns == 0.0 or sent.time_ns - began_ns >= start_ns):
            yield sent


def _wait(clock: RealClock, until_ns: int, transport: Transport) -> None:
    """By listening, so that the other end's answers don't pile up."""
    while (wait_s := clock.wall_seconds_until(until_ns)) > 0.0:
        transport.receive(min(wait_s, _LONGEST_WAIT_S))
