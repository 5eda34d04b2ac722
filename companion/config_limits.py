"""The settings of the limits of a flight: its battery and its fence."""

from typing import Annotated

import msgspec

from companion.config_types import MOST, NotNegative, Positive, Table

Share = Annotated[float, msgspec.Meta(ge=0, lt=1)]


class Battery(Table, frozen=True):
    """The battery failsafe (`supervision.battery`): warn, fly home the way it came, land where it is. Charges are
    fractions of a full battery; 0 switches a threshold off."""

    warn_charge: Share = 0.25
    return_charge: Share = 0.15
    """No flight begins below this."""
    land_charge: Share = 0.07
    way_home_margin: NotNegative = 1.3
    """The vehicle returns while it has `land_charge` and so many times what the way home takes at the consumption seen
    in this flight, as slowly as it came. 0: it returns at `return_charge` only."""
    warn_voltage: Positive | None = None
    """V of a cell, under load; not set: the voltage is not looked at."""
    return_voltage: Positive | None = None
    """V of a cell."""
    land_voltage: Positive | None = None
    """V of a cell."""
    cells: Annotated[int, msgspec.Meta(ge=1, le=48)] | None = None
    """Cells in series, for vehicles that report the voltage of the whole battery alone."""
    required: bool = False
    """Whether a flight needs a battery that reports its charge: none begins without, and one whose charge is not known
    any more (silent, or the same value for too long) returns. If not, that is said and the flight goes on."""

    def __post_init__(self) -> None:
        charges = [each for each in (self.land_charge, self.return_charge, self.warn_charge) if each > 0.0]
        if charges != sorted(charges):
            raise ValueError("land_charge, return_charge and warn_charge must rise in this order")
        volts = [each for each in (self.land_voltage, self.return_voltage, self.warn_voltage) if each is not None]
        if volts != sorted(volts):
            raise ValueError("land_voltage, return_voltage and warn_voltage must rise in this order")


Edge = Annotated[float, msgspec.Meta(ge=-MOST, le=MOST)]
Bounds = tuple[Edge, Edge]


class Geofence(Table, frozen=True):
    """Where may be flown, around the place of the take-off: within all of these that are set (`fence`)."""

    radius: Positive | None = None
    """m, horizontally."""
    north: Bounds | None = None
    """m: from and to; the place of the take-off, 0, lies between."""
    east: Bounds | None = None
    """m: from and to."""
    max_height: Positive | None = None
    """m above the place of the take-off."""
    margin: Positive = 1.0
    """m inside the fence that the reference keeps, for the vehicle's own error of position, in wind too."""
    braking: Positive = 3.0
    """m/s2: towards the fence the reference is no faster than it can stop with this before the margin."""
    land_after: Positive = 10.0
    """s; a vehicle that is beyond the fence and has come no metre nearer for so long lands where it is."""

    def __post_init__(self) -> None:
        for key, bounds in (("north", self.north), ("east", self.east)):
            if bounds is not None and not bounds[0] < -self.margin < self.margin < bounds[1]:
                raise ValueError(f"{key} {list(bounds)}: not from below -margin to above the margin")
        if self.radius is not None and self.radius <= self.margin:
            raise ValueError("radius: not above the margin")
        if self.max_height is not None and self.max_height <= self.margin:
            raise ValueError("max_height: not above the margin")

    @property
    def bounded(self) -> bool:
        """There is a fence."""
        return (self.radius, self.north, self.east, self.max_height) != (None, None, None, None)
