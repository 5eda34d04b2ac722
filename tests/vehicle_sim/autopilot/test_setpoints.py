"""The setpoints by themselves: what they command, and their stream."""

import math

import pytest

from tests.vehicle_sim.foreign_pilot import AIRFRAME, tilted
from vehicle_sim.autopilot.control_laws import Level
from vehicle_sim.autopilot.setpoints import STALE, OffboardSetpoints
from vehicle_sim.autopilot.settings import Settings

SECOND = STREAM_LOSS_NS = 1_000_000_000
UNIT = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("thrust", [-0.5, 0.0, 0.4, 1.0, 3.0, math.nan, math.inf])
def test_thrust_is_limited_and_never_nan(thrust: float) -> None:
    setpoints = OffboardSetpoints(AIRFRAME, Settings.of(AIRFRAME))
    setpoints.rates((0.1, 0.2, 0.3), thrust, SECOND)
    most = AIRFRAME.body.max_thrust_n
    expected = min(max(thrust, 0.0), 1.0) * most if math.isfinite(thrust) else 0.0
    assert setpoints.command["thrust_n"][0] == pytest.approx(expected)


def test_a_value_that_is_not_finite_leaves_everything_as_it_was() -> None:
    setpoints = OffboardSetpoints(AIRFRAME, Settings.of(AIRFRAME))
    setpoints.attitude(tilted(0.2, (0.0, 1.0, 0.0)), 0.5, SECOND)
    before = setpoints.command.tobytes()
    setpoints.rates((math.nan, 0.0, 0.0), 0.1, 2 * SECOND)
    setpoints.torque((math.inf, math.nan, 0.0, 0.1), 2 * SECOND)
    setpoints.attitude((math.nan, 0.0, 0.0, 0.0), 0.1, 2 * SECOND)
    assert setpoints.command.tobytes() == before
    assert setpoints.stream.age_ns(2 * SECOND) == SECOND, "and does not count for the stream"


def test_a_stream_begins_is_lost_and_begins_again() -> None:
    setpoints = OffboardSetpoints(AIRFRAME, Settings.of(AIRFRAME))
    assert setpoints.problem(0) == "no setpoint stream"
    for now_ns in (SECOND, 5 * SECOND):
        setpoints.attitude(UNIT, 0.5, now_ns)
        assert setpoints.problem(now_ns + STREAM_LOSS_NS) is None, "one setpoint suffices, as for PX4"
        assert not setpoints.is_lost(now_ns + STREAM_LOSS_NS)
        assert setpoints.is_lost(now_ns + STREAM_LOSS_NS + 1)
        assert setpoints.problem(now_ns + STREAM_LOSS_NS + 1) == "no setpoint stream"


def test_the_lower_the_level_the_sooner_a_setpoint_is_stale() -> None:
    """A stream loss that is five times as long is scaled too, since the pace is."""
    assert STALE[Level.TORQUE] < STALE[Level.RATES] < STALE[Level.ATTITUDE] < 1.0
    settings = Settings.of(AIRFRAME)
    setpoints = OffboardSetpoints(AIRFRAME, settings)
    setpoints.torque((0.0, 0.0, 0.0, 0.5), SECOND)
    for settings.stream_loss_ns in (STREAM_LOSS_NS, 5 * STREAM_LOSS_NS):
        stale_ns = SECOND + settings.stream_loss_ns // 10
        assert not setpoints.is_stale(stale_ns)
        assert setpoints.is_stale(stale_ns + 1)


@pytest.mark.parametrize("landed", [True, False])
def test_braking_is_not_stale_until_the_stream_is_lost(landed: bool) -> None:
    setpoints = OffboardSetpoints(AIRFRAME, Settings.of(AIRFRAME))
    setpoints.torque((0.0, 0.0, 0.0, 0.5), SECOND)
    setpoints.brake((1.0, 2.0, -3.0), 0.5, landed=landed)
    assert setpoints.command["level"][0] == (Level.STOPPED if landed else Level.POSITION)
    assert not setpoints.is_stale(SECOND + STREAM_LOSS_NS)
    setpoints.rates((0.0, 0.0, 0.0), 0.5, 2 * SECOND)
    assert setpoints.command["level"][0] == Level.RATES, "the next setpoint is followed again"
