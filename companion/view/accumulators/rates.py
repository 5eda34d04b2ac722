"""What the body rates and torques did: their spectra and their response to the rate commands."""

from typing import TypeVar

from companion.supervision.states import State
from companion.view.batches import Table
from companion.view.columns import stacked
from companion.view.lines import Floats
from companion.view.spectra import Pairs, Response, Segments, Spectrum

S = TypeVar("S", bound=Segments)
_NO_RATES = 0x07
"""Bits of SET_ATTITUDE_TARGET.type_mask: any of the body rates is not used."""


class BodyRates:
    """Spectra and step response, from the companion's trace or from messages, whichever was sampled more often."""

    def __init__(self) -> None:
        self._traced_rates = Spectrum(3)
        self._traced_torques = Spectrum(3)
        self._traced_response = Response(3)
        self._told_rates: dict[str, Spectrum] = {}
        """By "system/component/MESSAGE"."""
        self._sent_torques = Spectrum(3)
        self._sent_response = Response(3)
        self._pairs = Pairs(3)

    def add_steps(self, times: Floats, table: Table) -> None:
        """Control steps: times (n,) in s and records of the trace (n,)."""
        self._traced_rates.add(times, table["rates_frd"])
        self._traced_torques.add(times, table["torque_command"])
        flown = table["state"] == State.FLY.value  # otherwise what is commanded is not what moves the vehicle
        self._traced_response.add_pairs(times[flown], table["rates_command_frd"][flown], table["rates_frd"][flown])

    def add_message(self, sender: str, name: str, times: Floats, table: Table) -> None:
        """Messages of one name: times (n,) in s and fields (n,); names without rates or torques are ignored."""
        if name in ("ATTITUDE", "ATTITUDE_QUATERNION"):
            rates = stacked(table, "rollspeed", "pitchspeed", "yawspeed")
            self._told_rates.setdefault(f"{sender}/{name}", Spectrum(3)).add(times, rates)
            if name == "ATTITUDE_QUATERNION":
                self._sent_response.add_pairs(*self._pairs.answers(times, rates))
        elif name == "SET_ACTUATOR_CONTROL_TARGET":
            self._sent_torques.add(times, table["controls"][:, :3])
        elif name == "SET_ATTITUDE_TARGET":
            sent = (table["type_mask"] & _NO_RATES) == 0
            commands = stacked(table, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")[sent]
            self._sent_response.add_pairs(*self._pairs.commands(times[sent], commands))

    def spectrum(self, vehicle: str) -> Spectrum | None:
        """The spectrum of a vehicle's body rates ("system/component"); None if nothing told them often enough."""
        told = [self._told_rates.get(f"{vehicle}/{name}") for name in ("ATTITUDE_QUATERNION", "ATTITUDE")]
        return _fastest(self._traced_rates, *told)

    @property
    def torques(self) -> Spectrum | None:
        """The spectrum of the torque commands (1 is the whole range)."""
        return _fastest(self._traced_torques, self._sent_torques)

    @property
    def response(self) -> Response | None:
        """The response of the body rates to the rate commands."""
        return _fastest(self._traced_response, self._sent_response)


def _fastest(*found: S | None) -> S | None:
    """The one that was sampled most often."""
    known = [each for each in found if each is not None and each.segments]
    return min(known, key=lambda each: each.step, default=None)
