"""What the tables of settings are made of."""

from typing import Annotated

import msgspec

LEAST, MOST = 1e-9, 1e9
"""Sizes of numbers between which they can be computed with, as times in ns, too: no setting means anything beyond."""
Positive = Annotated[float, msgspec.Meta(ge=LEAST, le=MOST)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=MOST)]
MANY = 1_000_000
Count = Annotated[int, msgspec.Meta(ge=1, le=MANY)]
Fraction = Annotated[float, msgspec.Meta(gt=0, le=1)]

FARTHEST_M = 10_000
"""m from the take-off to a place of a mission, along each axis, at most."""
Metres = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Size = Annotated[float, msgspec.Meta(gt=0, le=FARTHEST_M)]
Height = Size
FASTEST_M_S = 1000
"""m/s that a mission may ask for, at most."""
Speed = Annotated[float, msgspec.Meta(gt=0, le=FASTEST_M_S)]


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all tables: an unknown key is an error."""


def one_of(key: str, value: str, *known: str) -> None:
    """Raises ValueError for a value of a setting that is none of those that are known."""
    if value not in known:
        raise ValueError(f"{key} {value!r}: there are " + ", ".join(f'"{each}"' for each in known))
