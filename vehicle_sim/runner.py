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
from protocol.messages import decode
from protocol.transport import LOCKSTEP_SPIN_S, Transport, Udp
from vehicle_sim.services.identity import is_for_vehicle
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle

FIRST_RESEND_S = 0.2
"""Lockstep: interval at which a tick is sent again before the companion has ever answered."""
RESEND_S = 1.0
"""Lockstep: the same afterwards."""
ANSWER_TIMEOUT_S = 3.0
"""Lockstep: time without an answer after which the companion is lost, and the simulation goes on without it."""
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
    """Runs a vehicle over a transport until the flight is over (`once`) or until a KeyboardInterrupt.

    `takes_keys`: SETUP_SIGNING is obeyed, until the end of the program; for links between programs of one machine.
    `monotonic_ns` is the source of wall time, time.monotonic_ns by default.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        transport: Transport,
        *,
        once: bool,
        takes_keys: bool = False,
        monotonic_ns: Callable[[], int] | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._transport = transport
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

    def _receive(self, timeout_s: float) -> bool:
        """Hand one datagram to the vehicle; False if none came in time."""
        data = self._transport.receive(timeout_s)
        if isinstance(self._transport, GuardedLink) and self._transport.setup is not None:
            self._set_key(self._transport, self._transport.setup)
        if data is None:
            return False
        self._heard_at_s = self._now_s()
        if not self._locked:
            self._locked = True
            self._transport.lock()  # the first peer has the vehicle until its end, as with PX4
        self._vehicle.receive(data)
        return True

    def _set_key(self, link: GuardedLink, frame: Frame) -> None:
        """SETUP_SIGNING (256): a key of zeros ends signing."""
        link.setup = None
        message: Any = decode(frame)
        if self._takes_keys and is_for_vehicle(message):
            key = bytes(message.secret_key)
            link.use(Keeper(key) if any(key) else None)

    def _send(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
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
                self._receive(remaining)
            for _ in range(_DATAGRAMS_PER_TICK):
                if not self._receive(0.0):
                    break
            self._send(vehicle.advance())

    # --- lockstep ---

    def run_lockstep(self) -> None:
        """Wait at each tick for the answer to it, so that runs repeat. `Coupling` says when it does not wait."""
        self._begin()
        end = inmost(self._transport)
        if isinstance(end, Udp):
            end.spin_s = LOCKSTEP_SPIN_S
        coupling = Coupling.WAITING
        while not self._is_over():
            datagrams = self._vehicle.advance()
            self._send(datagrams)
            if coupling is Coupling.LOST:
                if self._receive(0.0):
                    coupling = Coupling.COUPLED
                elif self._is_parked():
                    coupling = Coupling.WAITING
                else:
                    continue
            coupling = Coupling.COUPLED if self._await_answer(datagrams, coupling) else Coupling.LOST

    def _is_parked(self) -> bool:
        """On the ground, disarmed, and not about to end: there is no reason to let time pass."""
        flight = self._vehicle.flight
        return flight.landed and not flight.armed and not (self._once and self._vehicle.finished)

    def _await_answer(self, datagrams: list[bytes], coupling: Coupling) -> bool:
        """Wait for the answer to the present tick, which is sent again at intervals. False: given up."""
        vehicle = self._vehicle
        resend_s, timeout_s = FIRST_RESEND_S, math.inf
        if coupling is Coupling.COUPLED:
            timeout_s = ANSWER_TIMEOUT_S if self._finished_ns is None else ANSWER_TIMEOUT_FINISHED_S
            resend_s = min(RESEND_S, timeout_s)
        asked_at_s = sent_at_s = self._now_s()
        while True:
            self._receive(resend_s)
            if vehicle.answered_ns == vehicle.time_ns:
                return True
            now_s = self._now_s()
            if now_s - asked_at_s >= timeout_s or (coupling is Coupling.WAITING and self._is_over()):
                return False
            if now_s - sent_at_s >= resend_s:
                sent_at_s = now_s
                self._send(datagrams)
