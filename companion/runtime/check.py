"""The settings audit of a vehicle without a flight."""

from dataclasses import dataclass

from companion.config import Settings
from companion.link.vehicle_link import VehicleLink
from companion.reports import Finding
from companion.runtime.flight import version_text
from companion.state import Output, VehicleRequest
from protocol.clock import RealClock
from protocol.transport import Transport

_WAIT_S = 0.02


@dataclass(frozen=True, slots=True)
class Examination:
    """What was found."""

    vehicle: str
    """Firmware and version; empty if no vehicle was heard."""
    findings: tuple[Finding, ...]
    output: Output
    """What a flight would command."""
    refusal: str | None
    """Why it would not be flown."""


def examine(settings: Settings, output: Output | None, transport: Transport) -> Examination:
    """Read the parameters of the vehicle at the other end. Nothing else is asked of it. Raises TransportError."""
    link, clock = VehicleLink(settings, output), RealClock()
    give_up_ns = round(settings.supervision.find_timeout * 1e9)
    while not _is_through(link, settings.supervision.command_tries):
        data, now = transport.receive(_WAIT_S), clock.now_ns()
        if data is not None:
            link.receive(data, now, whole=transport.preserves_datagrams)
        if link.vehicle is not None:
            transport.lock()
            link.request(VehicleRequest.VERSION, now)
        elif now > give_up_ns:
            return Examination("", (), link.readiness.output, f"no vehicle within {give_up_ns * 1e-9:g} s")
        link.beat(now, asks_rates=False)
        answer = link.outbox.flush()
        if answer and transport.peer:
            transport.send(answer)
    assert link.firmware is not None and link.readiness.audit is not None
    vehicle = f"{link.firmware.name} {version_text(link.readiness.version)}".strip()
    readiness = link.readiness
    return Examination(
        vehicle, link.readiness.audit.findings, readiness.output, readiness.refusal or readiness.unversioned
    )


def _is_through(link: VehicleLink, tries: int) -> bool:
    """All is known, or will not be known any more."""
    readiness = link.readiness
    if readiness.audit is None or not readiness.audit.done:
        return False
    return readiness.version is not None or link.requests.answer(VehicleRequest.VERSION).tries >= tries
