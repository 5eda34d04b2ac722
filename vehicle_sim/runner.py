"""The only loop with a clock and a socket: real time, a factor of it, or lockstep."""

import gc
import math
import time
from collections.abc import Callable
from enum import Enum
from typing import Any

from protocol.clock import RealClock
from protocol.framing import Frame
from protocol.guarded_link import GuardedLink, inmost
from protocol.key_files import Keeper
from protocol.listeners import readable
from protocol.messages import decode
from protocol.transport import LOCKSTEP_SPIN_S, Transport, Udp
from vehicle_sim.links import Links
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle

FIRST_RESEND_S = 0.2
"""Lockstep: interval at which a tick is sent again before the companion has ever answered."""
RESEND_S = 1.0
"""Lockstep: the same afterwards."""
ANSWER_TIMEOUT_S = 10.0
"""Lockstep: time without an answer after which the companion is lost, and the simulation goes on without it. A busy
machine lets one that is there stand still for seconds."""
ANSWER_TIMEOUT_FINISHED_S = 0.3
"""Lockstep: the same after the flight, when the companion may have left."""
SILENCE_TIMEOUT_S = 20.0
"""With `once`: a vehicle on the ground that hears nobody for this long ends."""
SILENCE_TIMEOUT_DISARMED_S = 5.0
"""With `once`: the same for a disarmed vehicle that has heard somebody; in simulated time if that is slower."""
GRACE_LANDED_NS = 500_000_000
"""With `once`: simulated time after the landing, in which the last telemetry is sent."""
GRACE_CRASHED_NS = 2_000_000_000
"""With `once`: simulated time after a crash."""

_DATAGRAMS_PER_TICK = 200


class Coupling(Enum):
    """Lockstep: what is known of the companion."""

    WAITING = "nobody has answered yet, or the vehicle is alone on the ground: wait without a limit"
    COUPLED = "it answers"
    LOST = "it does not answer: simulate on as fast as possible until something is heard"


class Runner:
    """Runs a vehicle until the flight is over (`once`) or until a KeyboardInterrupt.

    `transport` is its first link, the one that lockstep waits for; without one, `links` are all that it has.
    `takes_keys`: SETUP_SIGNING is obeyed, until the end of the program; for links between programs of one machine.
    `monotonic_ns` is the source of wall time, time.monotonic_ns by default.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        transport: Transport | None,
        *,
        once: bool,
        links: Links | None = None,
        takes_keys: bool = False,
        monotonic_ns: Callable[[], int] | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._transport = transport
        self._links = links
        if transport is None:
            vehicle.close_channel(vehicle.channel)
        self._once = once
        self._takes_keys = takes_keys
        self._monotonic_ns = monotonic_ns or time.monotonic_ns
        self._heard_at_s = self._now_s()
        self._locked = False
        self._silence_timeout_disarmed_s = SILENCE_TIMEOUT_DISARMED_S
        self._finished_ns: int | None = None

    def _now_s(self) -> float:
        return self._monotonic_ns() * 1e-9

    def _begin(self) -> None:
        """Keep the garbage collector from the objects of the start-up, and don't count its time as silence."""
        gc.collect()
        gc.freeze()
        self._heard_at_s = self._now_s()

    def _is_over(self) -> bool:
        """The vehicle was shut down, or, with `once`, it is time to end."""
        vehicle = self._vehicle
        if vehicle.ended:
            return True
        if self._finished_ns is None:
            if not vehicle.finished:
                return self._once and vehicle.flight.landed and self._hears_nobody()
            self._finished_ns = vehicle.time_ns
        grace_ns = GRACE_LANDED_NS if vehicle.flight.crash is None else GRACE_CRASHED_NS
        return self._once and vehicle.time_ns - self._finished_ns >= grace_ns

    def _hears_nobody(self) -> bool:
        heard_before = self._locked and not self._vehicle.flight.armed
        timeout_s = self._silence_timeout_disarmed_s if heard_before else SILENCE_TIMEOUT_S
        return self._now_s() - self._heard_at_s > timeout_s

    def _receive(self, transport: Transport, timeout_s: float) -> bool:
        """Hand one datagram of the first link to the vehicle; False if none came in time."""
        data = transport.receive(timeout_s)
        if isinstance(transport, GuardedLink) and transport.setup is not None:
            self._set_key(transport.setup)
            transport.setup = None
        if data is None:
            return False
        self._heard_at_s = self._now_s()
        if not self._locked:
            self._locked = True
            transport.lock()  # the first peer has the vehicle until its end, as with PX4
        self._vehicle.receive(data)
        return True

    def _receive_others(self) -> None:
        links = self._links
        if links is not None and links.receive(self._now_s()):
            self._heard_at_s = self._now_s()
            self._locked = True
        if links is not None and links.setup is not None:
            self._set_key(links.setup)
            links.setup = None

    def _set_key(self, frame: Frame) -> None:
        """SETUP_SIGNING (256), for all links: a key of zeros ends signing."""
        message: Any = decode(frame)
        if self._takes_keys and self._vehicle.identity.is_meant((message.target_system, message.target_component)):
            key = bytes(message.secret_key)
            keeper = Keeper(key) if any(key) else None
            for link in (self._transport, self._links):
                if isinstance(link, GuardedLink | Links):
                    link.use(keeper)

    def _step(self) -> list[bytes]:
        """Fly a tick, and tell all links of it; what the first link was told."""
        vehicle = self._vehicle
        vehicle.step()
        datagrams = [] if self._transport is None else vehicle.collect(vehicle.channel)
        self._send(datagrams)
        if self._links is not None:
            self._links.send()
        return datagrams

    def _send(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
            assert self._transport is not None
            self._transport.send(datagram)

    # --- real time ---

    def run_timed(self, factor: float) -> None:
        """Simulate at absolute deadlines of a clock that runs `factor` times as fast as wall time.

        Late ticks follow each other without a pause until the deadlines are met again.
        """
        vehicle = self._vehicle
        self._begin()
        self._silence_timeout_disarmed_s = SILENCE_TIMEOUT_DISARMED_S / min(factor, 1.0)
        clock = RealClock(factor, self._monotonic_ns)
        while not self._is_over():
            deadline_ns = vehicle.time_ns + TICK_NS
            while (remaining := clock.wall_seconds_until(deadline_ns)) > 0.0:
                self._wait(remaining)
            for _ in range(_DATAGRAMS_PER_TICK):
                if self._transport is None or not self._receive(self._transport, 0.0):
                    break
            self._receive_others()
            self._step()

    def _wait(self, timeout_s: float) -> None:
        """Receive something, at the longest until the time is over."""
        first = self._transport
        if self._links is None:
            assert first is not None
            self._receive(first, timeout_s)
            return
        end = None if first is None else inmost(first)
        own = [end.fileno()] if isinstance(end, Udp) else []
        if readable(own + self._links.filenos, timeout_s):
            if first is not None:
                self._receive(first, 0.0)
            self._receive_others()

    # --- lockstep ---

    def run_lockstep(self) -> None:
        """Wait at each tick for the answer to it, so that runs repeat. `Coupling` says when it does not wait."""
        assert self._transport is not None
        self._begin()
        end = inmost(self._transport)
        if isinstance(end, Udp):
            end.spin_s = LOCKSTEP_SPIN_S
        coupling = Coupling.WAITING
        while not self._is_over():
            self._receive_others()
            datagrams = self._step()
            if coupling is Coupling.LOST:
                if self._receive(self._transport, 0.0):
                    coupling = Coupling.COUPLED
                elif self._is_parked():
                    coupling = Coupling.WAITING
                else:
                    continue
            answered = self._await_answer(self._transport, datagrams, coupling)
            coupling = Coupling.COUPLED if answered else Coupling.LOST

    def _is_parked(self) -> bool:
        """On the ground, disarmed, and not about to end: there is no reason to let time pass."""
        flight = self._vehicle.flight
        return flight.landed and not flight.armed and not (self._once and self._vehicle.finished)

    def _await_answer(self, transport: Transport, datagrams: list[bytes], coupling: Coupling) -> bool:
        """Wait for the answer to the present tick, which is sent again at intervals. False: given up."""
        vehicle = self._vehicle
        resend_s, timeout_s = FIRST_RESEND_S, math.inf
        if coupling is Coupling.COUPLED:
            timeout_s = ANSWER_TIMEOUT_S if self._finished_ns is None else ANSWER_TIMEOUT_FINISHED_S
            resend_s = min(RESEND_S, timeout_s)
        asked_at_s = sent_at_s = self._now_s()
        while True:
            self._receive(transport, resend_s)
            if vehicle.answered_ns == vehicle.time_ns:
                return True
            now_s = self._now_s()
            if now_s - asked_at_s >= timeout_s or (coupling is Coupling.WAITING and self._is_over()):
                return False
            if now_s - sent_at_s >= resend_s:
                sent_at_s = now_s
                self._send(datagrams)
