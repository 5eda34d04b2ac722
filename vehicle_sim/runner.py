"""The only loop with a clock and a socket: real time, a factor of it, or lockstep."""

import gc
import math
import time
from enum import Enum

from protocol.clock import RealClock
from protocol.transport import LOCKSTEP_SPIN_S, Transport, Udp
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle

HANDSHAKE_S = 0.2
"""Lockstep, nobody has answered yet: how often a tick is sent again."""
RESEND_S = 1.0
"""Lockstep: the same later on."""
LOST_S = 3.0
"""Lockstep: without an answer for this long the companion is lost, and time goes on without it."""
LOST_AFTERWARDS_S = 0.3
"""The same once the flight is over: the companion may have left."""
UNHEARD_S = 20.0
"""With `once`: given up if nobody is heard for this long while it stands on the ground."""
UNHEARD_AGAIN_S = 5.0
"""The same once somebody was, and it is disarmed; where time runs slower than the clock, by its measure."""
GRACE_LANDED_NS = 500_000_000
GRACE_CRASHED_NS = 2_000_000_000
"""With `once`: simulated time after the end, so that the last telemetry is out."""

_DATAGRAMS_A_TICK = 200


class Link(Enum):
    """Lockstep: what is known of the companion."""

    SOUGHT = "nobody has answered yet, or it stands on the ground alone: wait as long as it takes"
    COUPLED = "answers"
    LOST = "does not answer: time goes on, as fast as it can, until something is heard"


class Runner:
    """Runs a vehicle over a transport until the flight is over (`once`) or it is interrupted (KeyboardInterrupt)."""

    def __init__(self, vehicle: Vehicle, transport: Transport, *, once: bool) -> None:
        self._vehicle = vehicle
        self._transport = transport
        self._once = once
        self._heard_at = time.monotonic()
        self._locked = False
        self._unheard_again_s = UNHEARD_AGAIN_S
        self._finished_ns: int | None = None

    def _begin(self) -> None:
        """What start-up left behind is not looked at again by the garbage collector, and its time was no silence."""
        gc.collect()
        gc.freeze()
        self._heard_at = time.monotonic()

    def _over(self) -> bool:
        """With `once`: is it time to leave?"""
        vehicle = self._vehicle
        if self._finished_ns is None:
            if not vehicle.finished:
                return self._once and vehicle.flight.landed and self._unheard()
            self._finished_ns = vehicle.time_ns
        grace_ns = GRACE_LANDED_NS if vehicle.flight.crash is None else GRACE_CRASHED_NS
        return self._once and vehicle.time_ns - self._finished_ns >= grace_ns

    def _unheard(self) -> bool:
        again = self._locked and not self._vehicle.flight.armed
        return time.monotonic() - self._heard_at > (self._unheard_again_s if again else UNHEARD_S)

    def _receive(self, timeout_s: float) -> bool:
        """Hand one datagram on; False if none came in time."""
        data = self._transport.receive(timeout_s)
        if data is None:
            return False
        self._heard_at = time.monotonic()
        if not self._locked:
            self._locked = True
            self._transport.lock()  # whoever speaks first has the vehicle for good, as with PX4
        self._vehicle.receive(data)
        return True

    # --- real time ---

    def run_timed(self, factor: float) -> None:
        """Ticks at absolute deadlines of a clock `factor` times as fast as the wall's; late ones are caught up."""
        vehicle = self._vehicle
        self._begin()
        self._unheard_again_s = UNHEARD_AGAIN_S / min(factor, 1.0)
        clock = RealClock(factor)
        while not self._over():
            deadline_ns = vehicle.time_ns + TICK_NS
            while (remaining := clock.wall_seconds_until(deadline_ns)) > 0.0:
                self._receive(remaining)
            for _ in range(_DATAGRAMS_A_TICK):
                if not self._receive(0.0):
                    break
            self._send(vehicle.advance())

    # --- lockstep ---

    def run_lockstep(self) -> None:
        """Each tick waits for the answer to the one before, so that runs repeat; `Link` says when it does not wait."""
        self._begin()
        if isinstance(self._transport, Udp):
            self._transport.spin_s = LOCKSTEP_SPIN_S
        link = Link.SOUGHT
        while not self._over():
            datagrams = self._vehicle.advance()
            self._send(datagrams)
            if link is Link.LOST:
                if self._receive(0.0):
                    link = Link.COUPLED
                elif self._stands():
                    link = Link.SOUGHT
                else:
                    continue
            link = Link.COUPLED if self._await_answer(datagrams, link) else Link.LOST

    def _send(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
            self._transport.send(datagram)

    def _stands(self) -> bool:
        """On the ground, disarmed, with no end to come: no reason to let time run on."""
        flight = self._vehicle.flight
        return flight.landed and not flight.armed and not (self._once and self._vehicle.finished)

    def _await_answer(self, datagrams: list[bytes], link: "Link") -> bool:
        """Wait until the present tick is answered, and send it again now and then. False: given up."""
        vehicle = self._vehicle
        resend_s, patience_s = HANDSHAKE_S, math.inf
        if link is Link.COUPLED:
            patience_s = LOST_S if self._finished_ns is None else LOST_AFTERWARDS_S
            resend_s = min(RESEND_S, patience_s)
        asked_at = sent_at = time.monotonic()
        while True:
            self._receive(resend_s)
            if vehicle.answered_ns == vehicle.time_ns:
                return True
            now = time.monotonic()
            if now - asked_at >= patience_s or (link is Link.SOUGHT and self._over()):
                return False
            if now - sent_at >= resend_s:
                sent_at = now
                self._send(datagrams)
