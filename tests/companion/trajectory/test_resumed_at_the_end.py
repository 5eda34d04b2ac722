"""A time law that is resumed where it ends, as after a stop at a figure's last point."""

import numpy as np
import pytest

from companion.trajectory.timing import TimeLaw


@pytest.mark.parametrize("time_s", [0.0, 0.5, 1.0, 10.0])
def test_a_law_resumed_at_its_end_stays_there(time_s: float) -> None:
    law = TimeLaw(start=0.0, end=6.0, wanted_rate=1.0, up_s=1.0, down_s=2.0).resumed(6.0, 1.0)
    np.testing.assert_array_equal(law.at(time_s), [6.0, 0.0, 0.0, 0.0, 0.0])
    assert law.duration_s == 3.0
