"""The paper's controller as settings of ours, in one place."""

NOTHING_ADDED = (
    "control.position.adaptation=[0.0, 0.0, 0.0]",
    "control.attitude.feedforward=false",
    "control.prediction.enabled=false",
    "control.estimation.disturbance=false",
    "control.estimation.thrust_scale=false",
    "control.estimation.drag_scale=false",
    "trajectory.max_lead=1e9",
)
"""What Courier's controller has beyond the paper's, switched off, and a reference that waits for nobody. Drag stays
made up for: the paper's vehicle has none."""


def paper_settings(c: float, angle_weight: float = 400.0, yaw_weight: float = 50.0) -> tuple[str, ...]:
    """Overrides for the laws (7)-(25) alone: c7 = c9 = c11 = `c`, c8 = c10 = c12 = 1, no avoidance.

    `angle_weight` is Q(1,1) = Q(3,3), `yaw_weight` Q(5,5). The paper's own angle weight of 1 does not fly.
    """
    return (
        f"control.position.c1=[{c}, {c}, {c}]",
        "control.position.c2=[1.0, 1.0, 1.0]",
        f"control.attitude.angle_weight=[{angle_weight}, {angle_weight}, {yaw_weight}]",
        'avoidance.method="none"',
        *NOTHING_ADDED,
    )
