"""The moving picture of a flight."""

import math
from pathlib import Path

import numpy as np
import pytest

from protocol.flightlog.mavlink_records import message_type
from protocol.messages import dialect
from studies.film import returns

FILM = Path(__file__).resolve().parents[2] / "docs" / "flight.gif"


def test_returns_stand_where_the_vehicle_sees_them() -> None:
    """A return ahead of a vehicle that faces east is in the east; what is out of range is no return."""
    scan = np.zeros(1, message_type(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, "/x")[0].dtype)
    scan["distances"], scan["increment_f"] = 1001, 5.0
    scan["min_distance"], scan["max_distance"] = 20, 1000
    scan["distances"][0, 0], scan["distances"][0, 18] = 500, 300
    seen = returns(scan[0], np.array((10.0, 20.0, -3.0)), math.pi / 2.0)
    assert seen == pytest.approx(np.array(((10.0, 25.0), (7.0, 20.0))))


def test_the_film_of_the_readme_is_small() -> None:
    assert FILM.stat().st_size < 600_000
