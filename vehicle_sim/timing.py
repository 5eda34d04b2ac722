"""The fixed time steps of the simulation."""

TICK_NS = 4_000_000
"""Period of the autopilot and of telemetry."""
TICK_S = TICK_NS * 1e-9
STEPS_PER_TICK = 4
"""Integration steps of the equations of motion in a tick."""
STEP_S = TICK_NS * 1e-9 / STEPS_PER_TICK
"""Length of one integration step (s)."""
