"""A vehicle that strangers' programs reach over loopback, at a pace of its own, in a thread of the tests' process."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from protocol.listeners import Address, UdpListener
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


class ServedVehicle(Vehicle):
    """It ends when the test does."""

    port = 0
    """Where it can be spoken to."""
    stopped = False

    @property
    def ended(self) -> bool:
        return self.stopped or super().ended


@contextmanager
def served(pace: float, peer: Address | None = None, profile: Profile = Profile.ONBOARD) -> Iterator[ServedVehicle]:
    """A vehicle on its pad, which speaks to a peer before it has heard it, if there is one."""
    warm_up(AIRFRAME, EMPTY)
    vehicle = ServedVehicle(AIRFRAME, EMPTY)
    vehicle.parameters.scale_losses(_PATIENT)
    listener = UdpListener(HOST, 0, peer)
    vehicle.port = listener.port
    links = Links(vehicle, (), [(listener, profile)], None, 0.0)
    runner = Runner(vehicle, None, once=False, links=links)
    thread = threading.Thread(target=runner.run_timed, args=(pace,))
    thread.start()
    try:
        yield vehicle
    finally:
        vehicle.stopped = True
        thread.join()
        links.close()
