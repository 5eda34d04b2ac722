"""A vehicle that strangers' programs reach over loopback, at a pace of its own. It has a process of its own: their
callbacks are Python in the tests' process, and would take turns with it."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import NamedTuple

from protocol.listeners import Address, UdpListener
from tests.flights.warm import CONTEXT
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY
from vehicle_sim.links import Links
from vehicle_sim.runner import Runner
from vehicle_sim.services.profiles import Profile
from vehicle_sim.vehicle import Vehicle, warm_up

HOST = "127.0.0.1"
PATIENCE_S = 120.0
"""Far more than anything takes, on a machine that is busy with other things, too; only a failing test waits for it."""
_PATIENT = 60.0
"""The times after which a peer counts as lost are so much longer: the machine may stand still for a moment."""


class Served(NamedTuple):
    """The tests' end."""

    port: int
    """Where it can be spoken to."""
    pipe: Connection

    @property
    def flown(self) -> "Flown":
        """Its flight up to now."""
        self.pipe.send(None)
        flown: Flown = self.pipe.recv()
        return flown


class Flown(NamedTuple):
    """A flight."""

    time_s: float
    """In the air."""
    finished: bool
    """It stands on the ground again."""
    crash: str | None
    """What it has met."""


class _Vehicle(Vehicle):
    """It ends when the test does."""

    stopped = False

    @property
    def ended(self) -> bool:
        return self.stopped or super().ended

    def answer(self, pipe: Connection) -> None:
        """Answer the tests' end until that is gone."""
        with suppress(EOFError, OSError):
            while True:
                pipe.recv()
                pipe.send(Flown(self.summary().flight_time_s, self.finished, self.flight.crash))
        self.stopped = True


def _serve(pace: float, peer: Address | None, profile: Profile, patient: float, pipe: Connection) -> None:
    """The process."""
    warm_up(AIRFRAME, EMPTY)
    vehicle = _Vehicle(AIRFRAME, EMPTY)
    vehicle.parameters.scale_losses(patient)
    listener = UdpListener(HOST, 0, peer)
    links = Links(vehicle, (), [(listener, profile)], None, 0.0)
    pipe.send(listener.port)
    threading.Thread(target=vehicle.answer, args=(pipe,), daemon=True).start()
    Runner(vehicle, None, once=False, links=links).run_timed(pace)


@contextmanager
def served(
    pace: float, peer: Address | None = None, profile: Profile = Profile.ONBOARD, patient: float = _PATIENT
) -> Iterator[Served]:
    """A vehicle on its pad, which speaks to a peer before it has heard it, if there is one."""
    pipe, theirs = CONTEXT.Pipe()
    process = CONTEXT.Process(target=_serve, args=(pace, peer, profile, patient, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        yield Served(pipe.recv(), pipe)
    finally:
        pipe.close()
        process.join(PATIENCE_S)
        process.kill()
