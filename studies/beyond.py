"""docs/control.md: what the default controller adds to the paper's, and what that is worth."""

from studies.report import Page

CONTROL = Page(
    name="control",
    introduction="""# Past the paper: the default controller, measured

The paper's laws stay what they are (backstepping for position, an LQR for attitude). Around them the default controller
has: rates, angular acceleration and thrust of the reference from its jerk and snap by differential flatness with drag;
a prediction of the state over the age of the telemetry and the hold of the command; estimates of the thrust's scale,
the drag's scale and a disturbing acceleration; an adaptive (integral) term. Each is a setting (docs/settings.md).

Every figure here comes from the command above it: `make control` runs all of them.
""",
    studies=("studies.agile", "studies.ellipses", "studies.ablation", "studies.disturbed"),
)
