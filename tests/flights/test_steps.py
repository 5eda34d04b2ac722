"""Steps of one metre with the paper's control, both sides joined in memory."""

import numpy as np
import pytest
from msgspec.structs import replace

from companion.state import Output
from companion.supervision.states import State
from studies.joined import Joined, mission_of
from studies.paper_settings import paper_settings
from tests.flights import table_3
from tests.flights.short import returning

STEP = mission_of("step")
STEP = replace(
    STEP, waypoints=[replace(each, hold_s=5.0 if number else 1.0) for number, each in enumerate(STEP.waypoints)]
)
"""As long as is looked at: the first place is where the steps begin."""


@pytest.mark.parametrize(("c", "output"), [(1.0, Output.ATTITUDE), (2.5, Output.RATES), (5.0, Output.ACTUATORS)])
def test_step_of_one_metre_is_table_3(c: float, output: Output) -> None:
    """The nonlinear vehicle with motor lag and drag, each axis; V of the trace falls where the law promises it, on the
    ideal part of a step (after the attitude's lag)."""
    joined = Joined(STEP, output=output, overrides=paper_settings(c), remembers=False)
    joined.fly(until=returning)
    assert joined.autopilot.supervisor.fault is None
    trace = joined.trace()
    table_3.check(trace, c)
    step = trace[(trace["step"] == 2) & (trace["state"] == State.FLY.value)]
    total = step["lyapunov"].sum(axis=1)[1:]
    assert total[0] > 0.5 and total[-1] < 1e-4
    assert (np.diff(total[75:]) < 1e-9).mean() > 0.97
