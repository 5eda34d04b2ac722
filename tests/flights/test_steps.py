"""Steps of one metre with the paper's control, both sides joined in memory."""

import numpy as np
import pytest

from companion.state import Output
from companion.supervision.states import State
from studies.joined import Joined, mission_of
from studies.paper_settings import paper_settings
from tests.flights import table_3


@pytest.mark.parametrize(
    ("c", "output"), [(1.0, Output.ATTITUDE), (2.5, Output.RATES), (2.5, Output.ACTUATORS), (5.0, Output.RATES)]
)
def test_step_of_one_metre_is_table_3(c: float, output: Output) -> None:
    """The nonlinear vehicle with motor lag and drag, each axis."""
    joined = Joined(mission_of("step"), output=output, overrides=paper_settings(c)).fly()
    assert joined.autopilot.supervisor.fault is None
    table_3.check(joined.trace(), c)


def test_lyapunov_function_falls_on_the_way() -> None:
    """V of the trace falls where the law promises it, on the ideal part of a step (after the attitude's lag)."""
    joined = Joined(mission_of("step"), overrides=paper_settings(2.5)).fly()
    trace = joined.trace()
    step = trace[(trace["step"] == 2) & (trace["state"] == State.FLY.value)]
    total = step["lyapunov"].sum(axis=1)[1:]
    assert total[0] > 0.5 and total[-1] < 1e-4
    assert (np.diff(total[75:]) < 1e-9).mean() > 0.97
