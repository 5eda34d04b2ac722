"""Others have flown the vehicle to above a house, and give it back there: what is below was not seen."""

from pathlib import Path

import pytest

from companion.mission.plan import Phase
from studies.joined import Joined
from studies.worlds import Site
from tests.flights.short import SMALL_MAP, landing
from vehicle_sim.autopilot import orders
from vehicle_sim.autopilot.modes import Mode

ROOF, ROUTE, HIGH = 4.9, 3.0, 7.0
"""m"""
LENGTH = 22.0
"""m to the goal; the house ends 5 m before it."""


@pytest.mark.parametrize("method", ["astar", "none"])
def test_it_keeps_its_height_up_to_the_goal(method: str, tmp_path: Path) -> None:
    house = {"name": "house", "center": [10.0, 0.0], "size": [14.0, 20.0], "height": ROOF}
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}
    site = Site("house", {"name": "house", "origin": origin, "box": [house]}, ((LENGTH, 0.0),), ROUTE)
    mission, choice = site.mission(4.0, site.save(tmp_path)[0]), f'avoidance.method="{method}"'
    joined = Joined(mission, overrides=(SMALL_MAP, choice), remembers=False)
    joined.fly(until=lambda now: now.autopilot.navigator.phase is Phase.ROUTE)

    def sent(north: float) -> bool:
        orders.reposition(joined.vehicle.flight, (north, 0.0, -HIGH), None, None)
        joined.fly(limit_s=9.0, until=lambda now: abs(now.vehicle.motion.position_ned[2] + HIGH) < 0.1 and north == 0.0)
        return bool(abs(joined.vehicle.motion.position_ned[0] - north) < 0.5)

    assert sent(0.0) and sent(8.0)
    joined.vehicle.flight.set_mode(Mode.OFFBOARD)
    least = HIGH

    def watch(now: Joined) -> bool:
        nonlocal least
        north, _, down = now.vehicle.motion.position_ned
        least = min(least, -down) if north < LENGTH - 3.0 else least
        return landing(now) or now.vehicle.summary().contacts > 0

    joined.fly(limit_s=60.0, until=watch)
    assert landing(joined) and joined.vehicle.summary().contacts == 0 and joined.autopilot.supervisor.fault is None
    assert least > HIGH - 0.3
    assert -joined.vehicle.motion.position_ned[2] == pytest.approx(ROUTE, abs=0.3), "at the goal it has come down"
    assert sum("m of height: what is below was not seen" in line for line in joined.said) == 1
