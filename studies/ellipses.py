"""The ellipses of Sun et al. 2022 on their vehicle, nominal and with changes that the controller does not know."""

import math

import numpy as np

from companion.control.flatness import inverse
from companion.curves import Shape
from companion.runtime.files import load_body
from companion.trajectory.shapes import shape_of
from protocol.vehicle_parameters import VehicleParameters
from studies import style
from studies.engine import on_all_cores
from studies.report import Report
from studies.tracks import Flight, fly

NAME = "ellipses"
TITLE = "Sun et al.'s ellipses"

VEHICLE = "sun_quad"
SPEEDS = (5.0, 8.0, 11.0, 14.0, 17.0, 20.0)
ACCELERATIONS = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0, 60.0)
SPARE = 0.05
"""Share of a rotor's thrust that a feasible ellipse leaves unused at both ends of its range."""

CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...], float, float]] = {
    "nominal": ((), (), 0.084, 0.084),
    "drag +50 %": (("body.drag_kg_s=[0.39, 0.42, 0.63]",), (), 0.10, 0.194),
    "mass -30 %": (("body.mass_kg=0.5264",), (), 0.15, 0.477),
    "mass +30 %": (("body.mass_kg=0.9776",), (), 0.20, 0.687),
    "5 N force": ((), ("disturbance.force_ned=[5.0, 0.0, 0.0]",), 0.10, 0.302),
    "latency 30 ms": (("telemetry.delay_s=0.03",), (), 0.15, 0.333),
}
"""Overrides of the simulated vehicle and of the world; floor and published RMSE (m)."""


def ellipse(speed: float, acceleration: float) -> Shape:
    """An ellipse with its peak speed (m/s) at the ends of the short axis, and its peak acceleration (m/s2) at the ends
    of the long one, which is twice as long."""
    lap_s = 2.0 * math.pi * speed / acceleration
    return Shape("ellipse", speed, acceleration=acceleration, laps=max(round(12.0 / lap_s), 2) + 0.0, ramp_s=6.0)


def feasible(body: VehicleParameters, speed: float, acceleration: float) -> bool:
    """Whether every rotor stays within its thrust, less SPARE, on the ellipse at its full rate, by the model's
    flatness."""
    path = shape_of(ellipse(speed, acceleration))
    rate = acceleration / speed
    most, inertia, drag = body.rotor_max_thrust_n, np.array(body.inertia_kgm2), np.array(body.drag_kg_s)
    for angle in np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False):
        motion = path.at(angle) * (rate ** np.arange(5))[:, None]
        _, rates, turning, thrust = inverse(motion[1], motion[2], motion[3], motion[4], np.zeros(3), body.mass_kg, drag)
        roll, pitch, yaw = inertia * turning + np.cross(rates, inertia * rates)
        away = max(abs(roll), abs(pitch)) / (2.0 * body.arm_length_m) + abs(yaw) / (4.0 * body.torque_per_thrust_m)
        if not SPARE * most <= thrust / 4.0 - away <= thrust / 4.0 + away <= (1.0 - SPARE) * most:
            return False
    return True


def run(report: Report) -> None:
    body = load_body(VEHICLE)
    grid = [(speed, acceleration) for speed in SPEEDS for acceleration in ACCELERATIONS]
    flown = [each for each in grid if feasible(body, *each)]
    report.text(
        f"Horizontal ellipses of peak speed V and peak acceleration a, semi-axes V^2/a and half of that, on "
        f"`vehicles/{VEHICLE}.toml`. Of the {len(grid)} of V in {SPEEDS[0]:g}-{SPEEDS[-1]:g} m/s and a in "
        f"{ACCELERATIONS[0]:g}-{ACCELERATIONS[-1]:g} m/s2, {len(flown)} are feasible: every rotor keeps {SPARE:.0%} of "
        "its thrust to spare at both ends. Each is flown from rest to its speed and for at least 12 s. The companion "
        "knows the nominal vehicle in every row; the published figures are those of differential-flatness control "
        "without incremental inversion (DFBC), simulated, over their own 76 ellipses, whose grid the paper does not "
        "give point by point; so the rows compare as a whole, not ellipse by ellipse. With mass +30 % the vehicle "
        "can't follow the ellipses that are at its limit when it is not so loaded; they are in the mean."
    )
    jobs = [(case, each) for case in CASES for each in flown]
    plans = [
        Flight(ellipse(*each), VEHICLE, vehicle_overrides=CASES[case][0], world_overrides=CASES[case][1], height=15.0)
        for case, each in jobs
    ]
    errors: dict[str, list[float]] = {case: [] for case in CASES}
    for (case, _), tracked in report.progress(zip(jobs, on_all_cores(fly, plans), strict=True), "ellipses"):
        errors[case].append(tracked.rmse_m)
    rows = []
    for case, (_, _, floor, published) in CASES.items():
        all_m = np.array(errors[case])
        failed = int(np.isnan(all_m).sum())
        mean = float(np.mean(all_m)) if not failed else float("nan")
        middle, most = float(np.nanmedian(all_m)), float(np.nanmax(all_m))
        rows.append((case, len(all_m), failed, mean, middle, most, published))
        what = f"ellipses, {case}, mean of {len(all_m)}"
        report.check(what, f"<= {floor:g} m", f"{mean:.4f} m", not failed and mean <= floor)
    headers = ("case", "flown", "failed", "mean / m", "median / m", "worst / m", "published DFBC / m")
    report.table(headers, rows, "RMSE of position")
    figure, axes = style.sheet(1, 1, height=3.4)
    for case, values in errors.items():
        axes.plot(np.sort(1e3 * np.array(values)), np.arange(1, len(values) + 1) / len(values), label=case)
    axes.plot([1e3 * CASES["nominal"][3]], [0.5], label="published DFBC, nominal (mean)", **style.PUBLISHED)
    axes.set(xlabel="RMSE / mm", ylabel="share of the ellipses", xscale="log", ylim=(0.0, 1.02))
    axes.legend()
    report.figure(figure, "ellipses", "Share of the ellipses that are flown with at most so much error.")
