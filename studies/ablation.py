"""The default controller with each part switched off alone, and with other position laws."""

from companion.curves import Shape
from companion.state import Output
from studies.engine import on_all_cores
from studies.paper_settings import NOTHING_ADDED
from studies.report import Cell, Report
from studies.tracks import Flight, fly

NAME = "ablation"
TITLE = "What each part is worth, and other laws"

TRACK = Shape("lemniscate", 8.0, radius=6.0, laps=3.0)

CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "nominal": ((), ()),
    "28 ms late": (("telemetry.delay_s=0.028",), ()),
    "mass +20 %": (("body.mass_kg=1.56",), ()),
    "drag +50 %": (("body.drag_kg_s=[0.674, 0.726, 1.089]",), ()),
    "3 N": ((), ("disturbance.force_ned=[0.0, 3.0, 0.0]",)),
    "wind 6 m/s, gusts": ((), ("wind.mean_ned=[6.0, 0.0, 0.0]", "wind.turbulence_m_s=6.0")),
}
"""Overrides of the simulated vehicle and of the world; the companion does not know them."""

_ANYWHERE = ("trajectory.settled_distance=3.0", "trajectory.settled_speed=3.0")
"""Laws with a steady error would never count as arrived at the shape's start."""
_NO_ESTIMATE = tuple(f"control.estimation.{part}=false" for part in ("disturbance", "thrust_scale", "drag_scale"))
_NO_ADAPTATION = "control.position.adaptation=[0.0, 0.0, 0.0]"

PARTS: dict[str, tuple[str, ...]] = {
    "default": (),
    "without drag compensation": ("control.position.drag_compensation=false",),
    "without rates and torque fed forward": ("control.attitude.feedforward=false",),
    "without acceleration fed forward": ("control.position.feedforward=velocity",),
    "without prediction": ("control.prediction.enabled=false",),
    "without adaptation": (_NO_ADAPTATION,),
    "without the thrust's scale": ("control.estimation.thrust_scale=false",),
    "without the drag's scale": ("control.estimation.drag_scale=false",),
    "without the disturbance": ("control.estimation.disturbance=false",),
    "without any estimate": _NO_ESTIMATE,
    "adaptation alone, gamma = 3, no estimate": ("control.position.adaptation=[3.0, 3.0, 3.0]", *_NO_ESTIMATE),
    "with the sampled LQR": ("control.attitude.design=sampled",),
    "with a bandwidth of 14, 14, 7 rad/s by the rule": ("control.attitude.bandwidth=[14.0, 14.0, 7.0]",),
    "the paper's laws, drag made up for": (*NOTHING_ADDED, *_ANYWHERE),
}
LAWS: dict[str, tuple[str, ...]] = {
    "backstepping": (),
    "SE(3), geometric": ("control.position.law=se3",),
    "LQR with sliding mode": ("control.position.law=sliding_mode",),
    "PID": ("control.position.law=pid",),
}


def run(report: Report) -> None:
    report.text(
        "RMSE of position in mm on the lemniscate of 6 m at 8 m/s (as in the study before, output rates). The columns "
        "are what the simulator has and the companion does not know. A dash is a flight that failed."
    )
    _table(report, PARTS, Output.RATES, "Each part off (or changed) alone")
    report.text(
        "The other laws stand in the same place: their acceleration goes through the same thrust and attitude stages. "
        "Their gains give the same closed loop as backstepping with c1 = c2 = 2.5 where they have one "
        "(e'' + 5 e' + 7.25 e = 0). PID alone gets no acceleration fed forward. First with all that the default adds "
        "around the law, then bare: no prediction, no estimate, no rates fed forward, no drag made up for."
    )
    _table(report, LAWS, Output.RATES, "Laws within the default controller")
    bare = {
        name: (*law, *NOTHING_ADDED, *_ANYWHERE, "control.position.drag_compensation=false")
        for name, law in LAWS.items()
    }
    _table(report, bare, Output.RATES, "Laws alone")
    on_torque = {"continuous LQR": (), "sampled LQR": ("control.attitude.design=sampled",)}
    _table(report, on_torque, Output.ACTUATORS, "The attitude's LQR, torques commanded (output actuators)")


def _table(report: Report, variants: dict[str, tuple[str, ...]], output: Output, caption: str) -> None:
    jobs = [(variant, case) for variant in variants for case in CASES]
    plans = [Flight(TRACK, "paper_quad", output, variants[variant], *CASES[case]) for variant, case in jobs]
    done = dict(report.progress(zip(jobs, on_all_cores(fly, plans), strict=True), caption))
    rows: list[list[Cell]] = [[each, *(1e3 * done[each, case].rmse_m for case in CASES)] for each in variants]
    report.table(("", *CASES), rows, caption)
