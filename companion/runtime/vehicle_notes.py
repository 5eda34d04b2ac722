"""What is learned of the vehicle before a flight: its parameters, and the rates at which its telemetry arrives."""

import logging
import math
from collections.abc import Callable

from companion.link.vehicle_link import VehicleLink
from companion.records import AUDIT
from companion.reports import Finding
from protocol.flightlog import FlightLog


class VehicleNotes:
    """Puts each into the log once it is known."""

    def __init__(self, link: VehicleLink, log: FlightLog, say: Callable[[int, str], None]) -> None:
        """`say`: into the log and on the console, with a level of `logging`."""
        self._link = link
        self._log = log
        self._say = say
        self._audit: tuple[Finding, ...] = ()
        self._told_rates = False

    def take(self, now_ns: int, *, ready: bool) -> None:
        """Look again; `ready`: the telemetry has arrived as it will."""
        audit = self._link.readiness.audit
        if audit is not None and audit.findings is not self._audit:
            self._audit = audit.findings
            for each in self._audit:
                value = math.nan if each.value is None else each.value
                fields = each.parameter, value, each.wanted, each.why, int(each.safety)
                self._log.record(AUDIT, now_ns, AUDIT.pack(*fields))
        if ready and not self._told_rates:
            self._told_rates = True
            self._say(logging.INFO, f"telemetry: {self._link.measured_rates(now_ns)}")
