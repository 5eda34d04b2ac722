"""Opens the links that the command line names."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from protocol.guarded_link import GuardedLink, is_local, refuse_exposed, refused_with
from protocol.key_files import Keeper
from protocol.listeners import Listener, TcpListener, UdpListener
from protocol.transport import Transport, TransportError, Udp, open_url
from vehicle_sim.links import Links
from vehicle_sim.services.profiles import Profile
from vehicle_sim.vehicle import Vehicle

_HERE = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class Request:
    """A link to open."""

    url: str
    profile: Profile


@dataclass(slots=True)
class Opened:
    """Links that are open, or wait for peers. `first`: the one that lockstep waits for, or None."""

    keeper: Keeper | None
    first: GuardedLink | None = None
    fixed: list[tuple[Transport, Profile]] = field(default_factory=list)
    listeners: list[tuple[Listener, Profile]] = field(default_factory=list)
    local: bool = True
    """All of them stay on this machine."""

    def links(self, vehicle: Vehicle) -> Links | None:
        """All but the first, of a vehicle."""
        if not (self.fixed or self.listeners):
            return None
        return Links(vehicle, self.fixed, self.listeners, self.keeper, 0.0)

    @property
    def refused(self) -> dict[str, int]:
        """Frames that were refused, by reason."""
        return refused_with(self.keeper)

    def close(self) -> None:
        """Release all addresses."""
        if self.first is not None:
            self.first.close()
        for transport, _ in self.fixed:
            transport.close()
        for listener, _ in self.listeners:
            listener.close()


def open_links(requests: Iterable[Request], keeper: Keeper | None, *, insecure: bool, lockstep: bool) -> Opened:
    """Raises TransportError. In lockstep the first one is waited for; in real time a first one that sends to one place
    is a link of its own, and any number of peers may speak at the others."""
    opened = Opened(keeper)
    try:
        for request in requests:
            _open(opened, request, insecure=insecure, lockstep=lockstep)
    except TransportError:
        opened.close()
        raise
    return opened


def _open(opened: Opened, request: Request, *, insecure: bool, lockstep: bool) -> None:
    url, profile = request.url, request.profile
    refuse_exposed(url, signed=opened.keeper is not None, insecure=insecure)
    opened.local = opened.local and is_local(url)
    scheme, _, place = url.partition(":")
    host, _, port = place.rpartition(":")
    is_first = opened.first is None and not opened.fixed and not opened.listeners and profile is Profile.ONBOARD
    if (is_first and (lockstep or scheme == "udpout")) or scheme not in ("udpin", "tcpin") or not port.isdigit():
        transport = open_url(url)
        if is_first and (lockstep or isinstance(transport, Udp)):
            opened.first = GuardedLink(transport, opened.keeper)
        else:
            opened.fixed.append((transport, profile))
    elif scheme == "udpin":
        opened.listeners.append((UdpListener(host, int(port)), profile))
    else:
        opened.listeners.append((TcpListener(host, int(port)), profile))


def open_instance(number: int, keeper: Keeper | None, *, lockstep: bool) -> Opened:
    """PX4's links in SITL: 14580 + N to a companion at 14540 + N, and 18570 + N to a ground station at 14550. In
    lockstep there is the companion's alone, without a port of its own. Raises TransportError."""
    companion, opened = 14540 + number, Opened(keeper)
    if lockstep:
        opened.first = GuardedLink(open_url(f"udpout:{_HERE}:{companion}"), keeper)
        return opened
    try:
        for own, peer, profile in ((14580, companion, Profile.ONBOARD), (18570, 14550, Profile.GROUND)):
            opened.listeners.append((UdpListener(_HERE, own + number, (_HERE, peer)), profile))
    except TransportError as error:
        opened.close()
        raise TransportError(f"{error}: is there another vehicle? Give this one --instance {number + 1}") from error
    return opened
