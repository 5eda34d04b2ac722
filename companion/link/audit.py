"""The settings audit: the vehicle's parameters read and judged, and the output that follows from them."""

from typing import Any

from companion.config import Supervision
from companion.link.firmware.firmware import Firmware, Terms
from companion.link.parameters import ParameterReader
from companion.reports import Finding, VehicleSettings
from companion.state import Announcement, Output, Safety, Severity

LONGEST_HOLD_OF_RATES_S = 0.3
"""A vehicle that turns on at the last body rates for longer is flown on attitudes unless rates are asked for."""


class Audit:
    """The audit of one vehicle before one flight."""

    def __init__(self, firmware: Firmware, terms: Terms, settings: Supervision) -> None:
        self.findings: tuple[Finding, ...] = ()
        """Once it is `done`."""
        self.vehicle = VehicleSettings()
        self.output = terms.output or Output.ATTITUDE
        """What the flight commands; not fixed until it is `done`."""
        self.done = False
        self._firmware = firmware
        self._terms = terms
        self._reader = ParameterReader(
            firmware.parameters,
            bytewise=firmware.bytewise,
            interval_s=settings.command_interval,
            tries=settings.command_tries,
        )

    def take(self, message: Any) -> None:
        """PARAM_VALUE (22)."""
        self._reader.take(message)

    def refuse(self, message: Any) -> None:
        """PARAM_ERROR (345); one for another system is ignored."""
        if message.target_system in (0, self._terms.system):
            self._reader.refuse(message)

    def go_on(self, now_ns: int) -> tuple[list[str], list[Announcement]]:
        """To be called again and again: the parameters to ask for now, and at the end what is to be said."""
        if self.done:
            return [], []
        names = self._reader.due(now_ns)
        return names, self._conclude() if self._reader.done else []

    @property
    def refusal(self) -> str | None:
        """The first thing that forbids the flight."""
        refused = [finding for finding in self.findings if finding.safety is Safety.REFUSED]
        return in_words(refused[0]) if refused else None

    @property
    def progress(self) -> str | None:
        """What is still to be done; None once it is done."""
        return None if self.done else f"the vehicle's parameters are being read ({self._reader})"

    def _conclude(self) -> list[Announcement]:
        self.done = True
        values = self._reader.values
        self.findings = self._firmware.audit(values, self._terms)
        self.vehicle = self._firmware.settings(values)
        hold = self.vehicle.setpoint_hold
        if self._terms.output is None and hold is not None and hold <= LONGEST_HOLD_OF_RATES_S:
            self.output = Output.RATES
        unsafe = [finding for finding in self.findings if finding.safety is Safety.UNSAFE]
        said = [Announcement(Severity.WARNING, in_words(each)) for each in unsafe if each.value is not None]
        unknown = [finding.parameter for finding in unsafe if finding.value is None]
        if unknown:
            said.append(Announcement(Severity.WARNING, f"not known of the vehicle: {', '.join(unknown)}"))
        return [*said, self._output_in_words(hold)]

    def _output_in_words(self, hold: float | None) -> Announcement:
        """The output, and what becomes of the last setpoint."""
        time = "for an unknown time" if hold is None else f"for {hold:g} s"
        text = f"output {self.output.value}, last setpoint held {time} ({self._firmware.hold_parameter})"
        harmless = self.output is Output.ATTITUDE or (hold is not None and hold <= LONGEST_HOLD_OF_RATES_S)
        return Announcement(Severity.INFO if harmless else Severity.WARNING, text)


def in_words(finding: Finding) -> str:
    """A finding that is not safe, as a sentence."""
    value = "not known" if finding.value is None else f"{finding.value:g}"
    return f"{finding.parameter} is {value}, wanted: {finding.wanted}; {finding.why}"
