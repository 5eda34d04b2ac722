"""The states of a flight as the supervisor tells them apart."""

from enum import IntEnum

from companion.state import FlightMode, VehicleRequest


class State(IntEnum):
    """The numbers go into the log."""

    FIND = 0
    CHECK = 1
    STREAM = 2
    ENGAGE = 3
    ARM = 4
    FLY = 5
    HOLD = 6
    WITHDRAW = 7
    LAND = 8
    RELEASED = 9
    ENDED = 10
    RELINQUISHED = 11
    GAP = 12
    WATCH = 13
    DISARM = 14
    ADOPT = 15


STREAMING = frozenset({State.STREAM, State.ENGAGE, State.ARM, State.FLY, State.HOLD, State.RELINQUISHED, State.ADOPT})
"""States in which setpoints are sent (and in the beginning of a landing: supervisor.py)."""
OWN = frozenset({State.FLY, State.HOLD})
"""States in which the companion flies the vehicle."""
FLYING = frozenset(
    {State.FLY, State.HOLD, State.WITHDRAW, State.LAND, State.RELINQUISHED, State.GAP, State.WATCH, State.ADOPT}
)
"""States between arming and the end in which the companion answers for the vehicle, or is ready to."""
FOLLOWING = frozenset({State.RELINQUISHED, State.ADOPT})
"""States in which setpoints are sent to stay wherever the vehicle is, which others fly, or its own failsafe."""
AWAY = FOLLOWING | {State.GAP}
"""States in which the companion does not move the vehicle, and from which a hold leads back to the mission."""
ENDING = frozenset({State.WITHDRAW, State.LAND, State.WATCH, State.RELEASED, State.DISARM, State.ENDED})
"""States from which nothing leads back to the mission."""

COMMANDED = {State.WITHDRAW: FlightMode.HOLD, State.LAND: FlightMode.LAND}
"""The mode that a state asks the vehicle for, until the vehicle was in it once."""
REQUESTS = {
    State.CHECK: VehicleRequest.VERSION,
    State.ENGAGE: VehicleRequest.EXTERNAL_CONTROL,
    State.ARM: VehicleRequest.ARM,
    State.WITHDRAW: VehicleRequest.HOLD,
    State.LAND: VehicleRequest.LAND,
    State.ADOPT: VehicleRequest.EXTERNAL_CONTROL,
    State.GAP: VehicleRequest.STATUS,
    State.DISARM: VehicleRequest.DISARM,
}
"""What a state asks the vehicle for."""
