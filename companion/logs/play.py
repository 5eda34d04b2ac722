"""Sends the vehicle's side of a log again, with its recorded timing."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.logs.leaps import WithoutLeaps
from companion.logs.traffic import Datagram, Traffic, open_traffic
from protocol.clock import RealClock
from protocol.flightlog import Direction, FlightLogError
from protocol.transport import Transport

_RECEIVE_TIMEOUT_S = 0.2
_LONG_PAUSE_S = 5.0
"""A pause longer than this is announced."""
_SHORTEST_ROUND_S = 1.0
"""Wall time between two rounds of a loop, so that a log of no length floods nobody."""
_PROGRESS_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Played:
    """What was sent."""

    datagrams: int
    bytes: int
    played_s: float
    """Time of the log from the first datagram to the last."""


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
    """Send what the vehicle sent from `start_s` on, `speed` times as fast.

    With `loop` that is repeated for ever, at most once a second. Answers are received and ignored. `progress` is called
    with the log's time (s) each second of it, `pausing` with the length (s) of a long pause before it.
    Raises FlightLogError for a log that can't be read or has nothing of the vehicle from `start_s` on.
    """
    traffic = open_traffic(path)
    count = size = 0
    played_ns = 0
    while True:
        clock = RealClock(speed)
        first_ns: int | None = None
        progress_ns = 0
        for datagram in _from_vehicle(traffic, start_s * 1e9):
            if first_ns is None:
                first_ns = progress_ns = datagram.time_ns
            wait_s = clock.wall_seconds_until(datagram.time_ns - first_ns)
            if wait_s > _LONG_PAUSE_S:
                pausing(wait_s)
            _wait(clock, datagram.time_ns - first_ns, transport)
            transport.send(datagram.data)
            count += 1
            size += len(datagram.data)
            if datagram.time_ns >= progress_ns:
                progress(datagram.time_ns * 1e-9)
                progress_ns = datagram.time_ns + _PROGRESS_NS
            played_ns = max(played_ns, datagram.time_ns - first_ns)
        if first_ns is None:
            raise FlightLogError(f"{path}: the vehicle sent nothing from {start_s:g} s on")
        if not loop:
            return Played(count, size, played_ns * 1e-9)
        _wait(clock, round(_SHORTEST_ROUND_S * speed * 1e9), transport)


def _from_vehicle(traffic: Traffic, start_ns: float) -> Iterator[Datagram]:
    """The vehicle's datagrams from `start_ns` after the log's first one on; for 0 all, also those stamped earlier.
    Leaps of the log's clock are left out of their times.

    Of a stream they are made of the frames that each piece completes: who receives datagrams expects whole ones.
    """
    began_ns: int | None = None
    clock = WithoutLeaps()
    for told, frames in traffic.framed():
        datagram = told._replace(time_ns=clock.take(told.time_ns))
        began_ns = datagram.time_ns if began_ns is None else began_ns
        if datagram.direction is Direction.IN and (start_ns == 0.0 or datagram.time_ns - began_ns >= start_ns):
            if traffic.whole_datagrams:
                yield datagram
            elif frames:
                yield datagram._replace(data=b"".join(frame.raw for frame in frames))


def _wait(clock: RealClock, until_ns: int, transport: Transport) -> None:
    """Wait by receiving, so that the other end's answers don't pile up."""
    while (wait_s := clock.wall_seconds_until(until_ns)) > 0.0:
        transport.receive(min(wait_s, _RECEIVE_TIMEOUT_S))
