"""The links of a flight beside the vehicle's: to ground stations, to a sensor, and to a program that gives orders."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

from companion.link.candidates import Candidates
from companion.runtime.orders import Orders
from companion.runtime.router import STATION_BYTES_PER_S, Router, Station
from protocol.guarded_link import GuardedLink, drain, inmost, refuse_exposed
from protocol.key_files import Keeper
from protocol.transport import Tcp, Transport, TransportError, Udp, bytes_per_s, open_url

GROUND_STATION = "udpout:127.0.0.1:14550"
"""Where QGroundControl listens."""
_STATION_SHARE = 0.2
"""What each ground station may take of a slow link to the vehicle."""
NAMES = {
    "px4": "udpin:127.0.0.1:14540",
    "ardupilot": "udpin:127.0.0.1:14550",
    "qgc": GROUND_STATION,
}
"""Where each talks unless told otherwise."""


_UNHEARD = {
    "udpin": "is the vehicle on, and does it send MAVLink to this port? A simulator that still compiles is silent; "
    "another program on the port may have it",
    "udpout": "is the vehicle on, and does it listen there? udpin:HOST:PORT waits for one that sends by itself",
    "tcp": "the port is open, but no autopilot speaks there",
    "tcpin": "is the vehicle on, and does it call this port?",
    "serial": "is this the vehicle's port, is MAVLink on for it, and is the baud rate the vehicle's?",
}
"""What to look at where no vehicle was heard, by the scheme of the URL."""


def unheard(connect: str, vehicle: int | None) -> str:
    """Where no vehicle was heard, by URL or name, and what to look at; `vehicle`: the system that alone was waited
    for."""
    url = NAMES.get(connect, connect)
    alone = "" if vehicle is None else f"only system {vehicle} is waited for (--vehicle, identity.vehicle); "
    return f"{url}: {alone}{_UNHEARD.get(url.partition(':')[0], 'is the vehicle on?')}"


@dataclass(slots=True)
class SideLinks:
    """None of them can end a flight: what fails is told once, and the flight goes on without it."""

    router: Router | None = None
    sensor: Transport | None = None
    sensor_url: str = ""
    orders: Orders = field(default_factory=Orders)

    def places(self) -> list[str]:
        """Where each is, as a line for whoever starts the flight."""
        stations = self.router.stations if self.router is not None else ()
        lines = [f"ground station at {station.url}" for station in stations]
        return lines if self.sensor is None else [*lines, f"sensor at {self.sensor_url}"]

    def begin(self) -> None:
        """The flight begins: what has queued up before, from stations and sensor, is old."""
        if self.router is not None:
            self.router.begin()
        if self.sensor is not None:
            with suppress(TransportError):  # which the first look at it meets, too
                drain(self.sensor)

    def tell(self, data: bytes, vehicle: Transport, now_ns: int) -> None:
        """The companion's last words go to the stations, though the link to the `vehicle` may be gone."""
        if self.router is not None and data:
            with suppress(TransportError):  # with a key it has signed them by then
                vehicle.send(data)
            self.router.said(data)
            self.router.pump(now_ns)

    def close(self) -> None:
        """Release all addresses."""
        if self.router is not None:
            self.router.close()
        if self.sensor is not None:
            self.sensor.close()


NONE = SideLinks()


def open_link(name: str) -> Transport:
    """A link by URL or name. Raises TransportError."""
    if ":" not in name and name not in NAMES:
        raise TransportError(
            f"{name}: neither a URL (udpin:HOST:PORT, serial:DEVICE:BAUD, ...) nor one of {', '.join(NAMES)}"
        )
    return open_url(NAMES.get(name, name))


@dataclass(frozen=True, slots=True)
class Security:
    """What the links of a flight are opened with."""

    keeper: Keeper | None = None
    """Keeper of the key that all of them demand."""
    insecure: bool = False
    """Addresses beyond this machine are bound without a key."""

    def open(self, url: str, admits: Callable[[str, bytes], bool] | None = None) -> Transport:
        """A link by URL or name. Raises TransportError."""
        refuse_exposed(NAMES.get(url, url), signed=self.keeper is not None, insecure=self.insecure)
        return self.guard(open_link(url), admits)

    def guard(self, transport: Transport, admits: Callable[[str, bytes], bool] | None = None) -> Transport:
        """A link that is open already."""
        return GuardedLink(transport, self.keeper, None if self.keeper is not None else admits)


def open_vehicle_link(name: str, security: Security, vehicle: int | None, *, lockstep: bool = False) -> Transport:
    """The link to the vehicle, of the system `vehicle` if that is not None. Raises TransportError.

    Where anybody can send without a key, the vehicle is admitted once it has shown itself; not in lockstep, in which no
    time passes before it is answered.
    """
    anybody = NAMES.get(name, name).startswith("udpin:") and not lockstep
    return security.open(name, Candidates(vehicle).admits if anybody else None)


def open_side_links(
    vehicle: Transport, stations: Sequence[str], sensor: str | None, security: Security = Security()
) -> SideLinks:
    """Open ground stations' and the sensor's URLs. Raises TransportError for one that can't be opened."""
    end = inmost(vehicle)
    capacity = bytes_per_s(end)
    rate = STATION_BYTES_PER_S if capacity is None else min(STATION_BYTES_PER_S, _STATION_SHARE * capacity)
    opened: list[Station] = []
    taken = [("--connect", vehicle)]
    try:
        for name in stations:
            url = NAMES.get(name, name)
            transport = _open_beside("--gcs", name, security, taken)
            place = _place(url, transport)
            if isinstance(end, Udp) and transport.peer == f"127.0.0.1:{end.port}":
                transport.close()
                raise TransportError(f"--gcs {name}: that is where the companion itself waits for the vehicle")
            opened.append(
                Station(place, transport, partial(security.open, place) if url.startswith("tcpin:") else None)
            )
            taken.append(("--gcs", transport))
        router = Router(opened, link=vehicle, whole=vehicle.preserves_datagrams, bytes_per_s=rate) if opened else None
        if sensor is None:
            return SideLinks(router)
        transport = _open_beside("--lidar", sensor, security, taken)
        return SideLinks(router, transport, _place(sensor, transport))
    except TransportError:
        for station in opened:
            station.close()
        raise


def _open_beside(option: str, name: str, security: Security, taken: Sequence[tuple[str, Transport]]) -> Transport:
    """The link that an option names. Raises TransportError, which says whether one of the links that are open already
    (each with its option) waits at the same port."""
    try:
        return security.open(name)
    except TransportError as error:
        url = NAMES.get(name, name)
        others = [other for other, link in taken if _waits_at(inmost(link), url)]
        raise TransportError(
            f"{option} {name}: {others[0]} has this port" if others else f"{option} {error}"
        ) from error


def _waits_at(end: Transport, url: str) -> bool:
    """Whether a link has the port at which a URL waits, too."""
    scheme, port = url.partition(":")[0], url.rpartition(":")[2]
    if isinstance(end, Udp):
        return scheme == "udpin" and port == str(end.port)
    return isinstance(end, Tcp) and scheme == "tcpin" and port == str(end.port)


def _place(url: str, transport: Transport) -> str:
    """The URL with the port that the system chose."""
    end = inmost(transport)
    return f"{url[:-1]}{end.port}" if url.endswith(":0") and isinstance(end, Udp | Tcp) else url
