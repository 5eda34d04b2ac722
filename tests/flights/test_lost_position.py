"""The receiver falls silent in flight. As PX4, the vehicle goes on to tell a local position, which drifts away."""

from pathlib import Path

import numpy as np
import pytest

from companion.mission.plan import Mission, Waypoint
from companion.supervision.states import State
from protocol.toml_files import ROOT
from studies.joined import Joined

SILENT_S = 12.0
HOVER = Mission("hover", waypoints=[Waypoint(0.0, 0.0, 4.0, 90.0)], takeoff_height=4.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_it_lands_when_the_estimator_says_so(tmp_path: Path, seed: int) -> None:
    """PX4's dead reckoning lasts 5 s, and its status comes once a second."""
    sensors = tmp_path / "silent.toml"
    table = (ROOT / "vehicles" / "sensors" / "gnss.toml").read_text(encoding="utf-8")
    sensors.write_text(table.replace("[gnss]", f"[gnss]\noutages_s = [[{SILENT_S}, 1000.0]]"), encoding="utf-8")
    joined = Joined(
        HOVER,
        output=None,
        overrides=('avoidance.method="none"',),
        vehicle_overrides=(f'estimator.sensors="{sensors}"',),
        seed=seed,
    )
    joined.fly(until=lambda joined: joined.autopilot.supervisor.state is State.LAND)
    assert SILENT_S + 5.0 < joined.vehicle.time_ns * 1e-9 < SILENT_S + 6.5
    joined.fly()
    assert str(joined.autopilot.supervisor.fault).endswith("the vehicle's estimator has lost its position: landing")
    assert joined.vehicle.flight.landed and joined.vehicle.flight.crash is None and not joined.vehicle.flight.armed
    assert np.linalg.norm(joined.vehicle.state[:2]) < 6.0, "metres, not hundreds, from where it hovered"
