"""Circle and lemniscate on sensors with an estimator, beside other laws, and with all that is wrong at once."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from companion.curves import Shape
from studies import style
from studies.agile import RADII_M
from studies.engine import on_all_cores
from studies.paper_settings import NOTHING_ADDED
from studies.report import Cell, Report
from studies.tracks import Flight, Tracked, fly

NAME = "sensed"
TITLE = "On sensors with an estimator"

LEVELS = ("perfect", "rtk", "gnss")
_ANYWHERE = ("trajectory.settled_distance=3.0", "trajectory.settled_speed=3.0")
"""Laws with a steady error would never count as arrived at the shape's start."""
LAWS: dict[str, tuple[str, ...]] = {
    "default": (),
    "SE(3), nothing added": ("control.position.law=se3", *NOTHING_ADDED, *_ANYWHERE),
    "the paper's laws": (*NOTHING_ADDED, *_ANYWHERE),
}
SHAPES = ("circle", "lemniscate")
FLOORS_M = {("rtk", 4.0): 0.03, ("rtk", 8.0): 0.05}
BESIDE_M = 0.05
"""What the vehicle may be beside the reference on a receiver, beyond its estimator's own error."""
TIMES_BETTER = 3.0
WRONG_M = 0.15

WRONG = (
    'estimator.sensors="gnss"',
    "rotors.thrust_share=[0.8, 1.0, 1.0, 1.0]",
    "battery.drives_speed=true",
)
"""What the simulated vehicle has, and the companion does not know."""
CENTRES_M = {"to the right": (0.0, 0.02), "ahead, at the weak rotor": (0.02, 0.0)}
"""Where the centre of mass is, ahead and to the right."""
VEHICLE = "sun_quad"
"""It lifts all of that; `paper_quad` with 30 % more mass has not enough thrust left for the gusts."""
MASSES = {"-30 %": (0.526, 0.05), "+30 %": (0.978, 0.02)}
"""kg, and the battery's resistance (ohm), by which it sags by some 15 %. The believed mass is 0.752 kg."""
GUSTS = ("wind.mean_ned=[6.0, 0.0, 0.0]", "wind.turbulence_m_s=6.0")

Case = tuple[str, str, float, str, int]
"""Law, shape, speed (m/s), level, seed."""


def plan(law: str, shape: str, speed: float, level: str, seed: int) -> Flight:
    """Three laps, including the ramp from rest, body rates commanded."""
    return Flight(
        Shape(shape, speed, radius=RADII_M[speed], laps=3.0),  # type: ignore[arg-type]
        overrides=LAWS[law],
        vehicle_overrides=(f'estimator.sensors="{level}"',),
        seed=seed,
    )


def wrong(centre: str, mass: str, seed: int) -> Flight:
    """All of `WRONG` at once, in gusts."""
    ahead, right = CENTRES_M[centre]
    mass_kg, resistance_ohm = MASSES[mass]
    battery = f"battery.internal_resistance_ohm={resistance_ohm}"
    changes = f"body.mass_kg={mass_kg}", battery, f"unmodelled.centre_of_mass_m=[{ahead}, {right}]"
    return Flight(
        Shape("lemniscate", 4.0, radius=RADII_M[4.0], laps=3.0),
        vehicle=VEHICLE,
        vehicle_overrides=(*WRONG, *changes),
        world_overrides=GUSTS,
        seed=seed,
    )


def sag(tracked: Tracked) -> float:
    """Share of the thrust that the battery's voltage cost at the worst."""
    return 1.0 - tracked.voltage_share**2


def run(report: Report) -> None:
    report.text(
        "The same flights by what the vehicle senses: the truth, a receiver that is corrected by a base station, and "
        "one that is not ([vehicle-sim.md](vehicle-sim.md#sensors-and-the-estimator)). *True* is the distance of the "
        "true place from the reference, *told* that of the place that the vehicle believes; RMSE in mm, the worst of "
        "the seeds. A dash is a flight that failed."
    )
    seeds = range(1, report.choice.seeds + 1)
    cases: list[Case] = [
        (law, shape, speed, level, seed)
        for law in LAWS
        for shape in SHAPES
        for speed in RADII_M
        for level in LEVELS
        for seed in seeds
    ]
    flown = dict(report.progress(zip(cases, on_all_cores(fly, [plan(*case) for case in cases]), strict=True), "tracks"))
    worst = {
        (law, shape, speed, level): max(
            (flown[law, shape, speed, level, seed] for seed in seeds),
            key=lambda each: np.nan_to_num(each.rmse_m, nan=9e9),
        )
        for law, shape, speed, level, _ in cases
    }
    headers = ("law", "shape", "m/s", *(f"{what}, {level}" for level in LEVELS for what in ("true", "told")))
    rows: list[Sequence[Cell]] = [
        (
            law,
            shape,
            speed,
            *(round(1e3 * value, 1) for level in LEVELS for value in _pair(worst[law, shape, speed, level])),
        )
        for law in LAWS
        for shape in SHAPES
        for speed in RADII_M
    ]
    report.table(headers, rows, f"RMSE of position / mm, seeds 1 to {len(seeds)}")
    _picture(report, worst)
    _check(report, worst)
    _all_at_once(report, list(seeds))


def _pair(tracked: Tracked) -> tuple[float, float]:
    return tracked.rmse_m, tracked.told_rmse_m


def _picture(report: Report, worst: dict[tuple[str, str, float, str], Tracked]) -> None:
    figure, axes = style.sheet(1, 1, height=2.8)
    for level in LEVELS:
        tracked = worst["default", "lemniscate", 8.0, level]
        axes.plot(tracked.time_s, 1e3 * np.linalg.norm(tracked.error_ned, axis=1), label=level)
    axes.set(xlabel="time since the shape's start / s", ylabel="true error / mm", yscale="log")
    axes.legend(loc="lower right", ncols=3)
    report.figure(figure, "sensed-error", "True distance from the reference, lemniscate at 8 m/s, the default laws")


def _check(report: Report, worst: dict[tuple[str, str, float, str], Tracked]) -> None:
    for (level, speed), floor in FLOORS_M.items():
        measured = max(worst["default", shape, speed, level].rmse_m for shape in SHAPES)
        report.check(f"circle and lemniscate, {speed:g} m/s, {level}, true", f"<= {floor:g} m", f"{measured:.4f} m",
                     measured <= floor)  # fmt: skip
    beyond = max(
        worst["default", shape, speed, "gnss"].rmse_m - worst["default", shape, speed, "gnss"].estimate_rmse_m
        for shape in SHAPES
        for speed in RADII_M
    )
    report.check("the same on gnss, beyond the estimator's own error", f"<= {BESIDE_M:g} m", f"{beyond:.4f} m",
                 beyond <= BESIDE_M)  # fmt: skip
    for law, level in product(list(LAWS)[1:], LEVELS[1:]):
        times = min(
            worst[law, shape, speed, level].told_rmse_m / worst["default", shape, speed, level].told_rmse_m
            for shape in SHAPES
            for speed in RADII_M
            if worst[law, shape, speed, level].fault is None
        )
        report.check(f"told error of {law}, times the default's, {level}", f">= {TIMES_BETTER:g}", f"{times:.1f}",
                     times >= TIMES_BETTER)  # fmt: skip


def _all_at_once(report: Report, seeds: list[int]) -> None:
    report.text(
        f"All at once, on the lemniscate at 4 m/s, vehicle `{VEHICLE}`: `gnss`, the centre of mass 2 cm aside, the "
        "front rotor 20 % weak, a battery whose voltage costs thrust (*sag*, at the worst of the flight), another mass "
        "than believed, and a wind of 6 m/s with gusts."
    )
    cases = [(centre, mass, seed) for centre in CENTRES_M for mass in MASSES for seed in seeds]
    flights = on_all_cores(fly, [wrong(*case) for case in cases])
    flown = list(report.progress(zip(cases, flights, strict=True), "wrong"))
    rows: list[Sequence[Cell]] = [
        (*case, *(round(1e3 * value, 1) for value in _pair(tracked)), 100.0 * sag(tracked)) for case, tracked in flown
    ]
    report.table(("centre of mass", "mass", "seed", "true / mm", "told / mm", "sag / %"), rows, "All at once")
    for centre in CENTRES_M:
        told = max(
            float(np.nan_to_num(tracked.told_rmse_m, nan=np.inf)) for case, tracked in flown if case[0] == centre
        )
        what = f"all at once, centre of mass {centre}, from the estimate"
        report.check(what, f"<= {WRONG_M:g} m", f"{told:.4f} m", told <= WRONG_M)
