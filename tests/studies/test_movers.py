"""What moves at the vehicle in the open: flights of the campaign `moving`, of which the first three once ended in a
contact."""

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
