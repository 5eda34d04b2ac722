"""What is read from files."""

import numpy as np
import pytest

from companion.runtime.files import load_body
from protocol import toml_files

VEHICLES = sorted(path.stem for path in (toml_files.ROOT / "vehicles").glob("*.toml"))


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_is_one_that_can_be(name: str) -> None:
    """It hovers with room to climb, and its moments of inertia are those of a body: none exceeds the other two."""
    body = load_body(name)
    assert 0.2 < body.hover_thrust * (body.mass_kg + body.parcel_mass_kg) / body.mass_kg < 0.7
    least, middle, most = np.sort(body.inertia_kgm2)
    assert most <= least + middle
