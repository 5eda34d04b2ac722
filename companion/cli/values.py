"""What the values of options stand for, where that is more than their text."""

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.runtime.flight import Pace
    from companion.state import Output


def pinned(vehicle: int | None) -> list[str]:
    """`--vehicle` as an override of the settings."""
    return [] if vehicle is None else [f"identity.vehicle={vehicle}"]


def avoided_by(name: str) -> str:
    """`--avoid` as an override of the settings. Raises PlanError."""
    from companion.avoidance_methods import method_of
    from companion.runtime.flight import PlanError

    try:
        return f"avoidance.method={json.dumps(method_of(name).name)}"
    except ValueError as error:
        raise PlanError(f"--avoid: {error}") from None


def output_of(text: str) -> "Output | None":
    """None: chosen once the vehicle is known. Raises PlanError."""
    from companion.runtime.flight import AUTO, PlanError
    from companion.state import Output

    if text == AUTO:
        return None
    try:
        return Output(text)
    except ValueError:
        names = ", ".join(each.value for each in Output)
        raise PlanError(f"--output {text}: there are {names} and {AUTO}") from None


def pace_of(text: str) -> "Pace":
    """Raises PlanError."""
    from companion.runtime.flight import PlanError

    if text == "lockstep":
        return "lockstep"
    if text == "realtime":
        return 1.0
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.001 <= factor <= 1000.0:
        raise PlanError(f"--pace {text}: there are realtime, lockstep and factors such as 4, from 0.001 to 1000")
    return factor
