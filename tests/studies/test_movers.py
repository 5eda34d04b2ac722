"""What moves at the vehicle in the open: flights of the campaign `moving` and one in a street that is faster, of which
four once ended in a contact."""

from pathlib import Path

import pytest

from studies.campaign import DEFAULT, Job, fly
from studies.moving import SETUPS

SETUP = {setup.name: setup for setup in SETUPS}


@pytest.mark.parametrize(
    ("setup", "seed"), [("overtaking", 229), ("overtaking", 275), ("waiting", 244), ("street", 209), ("oncoming", 216)]
)
def test_it_is_evaded(setup: str, seed: int, tmp_path: Path) -> None:
    """It comes from behind, meets a vehicle that waits, walks across, comes ahead on."""
    row = fly(Job(SETUP[setup], DEFAULT, SETUP[setup].speeds[0], seed, tmp_path, ()))
    assert row.outcome == "reached"


@pytest.mark.parametrize("stops", [True, False])
def test_among_many_an_evasion_ends_with_a_stop(stops: bool, tmp_path: Path) -> None:
    """Without it the vehicle runs from one to the next, faster than it was asked to be, into a third."""
    overrides = (f"avoidance.guard.evasion_stops={str(stops).lower()}",)
    row = fly(Job(SETUP["street"], DEFAULT, 4.0, 11, tmp_path, overrides))
    assert (row.outcome == "reached") == stops
    assert row.top_speed is not None and (row.top_speed < 5.0) == stops
