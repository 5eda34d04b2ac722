"""The figures of a flight, from its log."""

from pathlib import Path

import pytest

from companion.mission.plan import Phase
from companion.runtime.summary import summarize
from companion.supervision.states import State
from tests.companion.view.made_logs import SPEED, Values, make


def test_what_is_near_and_how_far_it_is_count_all_the_time_in_the_air(tmp_path: Path) -> None:
    """Not only while the mission is flown, unlike the tracking."""

    def change(time: float, values: Values) -> None:
        values["clearance"] = 2.0
        if time < 1.0:
            values |= {"phase": Phase.PREPARE.value, "clearance": 0.01}
        elif 3.0 <= time < 4.0:
            values |= {"state": State.HOLD.value, "clearance": 0.05}
            values["reference_position_ned"] = (0.0, 9.0, 0.0)
        elif time >= 6.0:
            values |= {"state": State.ENDED.value, "clearance": 0.02}

    summary = summarize(make(tmp_path, 7.0, change=change))
    assert summary.seen_clearance_m == pytest.approx(0.05)
    assert summary.distance_m == pytest.approx(5.0 * SPEED, rel=0.01)
    assert summary.rmse_m == pytest.approx((0.1, 0.0, 0.0), abs=1e-6)
