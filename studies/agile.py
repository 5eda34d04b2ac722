"""Circle and lemniscate at 4 and 8 m/s, with and without a delay of the pose, on each output."""

from companion.curves import Shape
from companion.state import Output
from studies import style
from studies.engine import on_all_cores
from studies.report import Report
from studies.tracks import Flight, fly

NAME = "agile"
TITLE = "Circle and lemniscate"

PUBLISHED_M = {
    ("circle", 4.0): (0.192, 0.025),
    ("lemniscate", 4.0): (0.134, 0.019),
    ("circle", 8.0): (0.502, 0.051),
    ("lemniscate", 8.0): (0.357, 0.045),
}
"""RMSE (m) of RotorPy's SE3 controller, and of the same gains with drag and jerk fed forward, on RotorPy's vehicle."""
DELAYED_M = {4.0: 0.089, 8.0: 0.173}
"""RMSE (m) of the same gains with drag and jerk fed forward, on the circle with 30 ms of motor lag and 25 ms of
delay."""
FLOORS_M = {(4.0, 0.0): 0.025, (8.0, 0.0): 0.05, (4.0, 0.025): 0.06, (8.0, 0.025): 0.12}
RADII_M = {4.0: 3.0, 8.0: 6.0}


def flights() -> list[tuple[str, float, float, Output]]:
    """Shape, speed (m/s), delay (s), output."""
    return [
        (shape, speed, delay, output)
        for output in Output
        for shape in ("circle", "lemniscate")
        for speed in RADII_M
        for delay in (0.0, 0.025)
    ]


def plan(shape: str, speed: float, delay: float, output: Output) -> Flight:
    """Three laps, including the ramp from rest."""
    delayed = (f"telemetry.delay_s={delay}",) if delay else ()
    return Flight(
        Shape(shape, speed, radius=RADII_M[speed], laps=3.0),  # type: ignore[arg-type]
        output=output,
        vehicle_overrides=delayed,
    )


def run(report: Report) -> None:
    report.text(
        "Flown by both sides joined in memory, the same stages and bytes as over UDP in lockstep: take-off, the shape "
        "from rest to its speed and back to rest, on the nonlinear vehicle (1 kHz, motor lag 30 ms, rotor drag). The "
        "error is between the true position and the reference, all three axes, from one second after the shape's "
        "start. The simulator rounds the delay of 25 ms up to 28, seven of its ticks. RotorPy's figures are on its own "
        "vehicle without motor lag, but for those with a delay."
    )
    jobs = flights()
    done = report.progress(zip(jobs, on_all_cores(fly, [plan(*job) for job in jobs]), strict=True), "tracks")
    rows = []
    worst: dict[tuple[float, float], float] = {}
    figure, axes = style.sheet(2, 1, height=4.4, sharex=True)
    for (shape, speed, delay, output), tracked in done:
        stock, best = PUBLISHED_M[shape, speed] if not delay else (float("nan"), DELAYED_M[speed])
        rows.append((shape, speed, 1e3 * delay, output.value, 1e3 * tracked.rmse_m, 1e3 * tracked.peak_m,
                     1e3 * stock, 1e3 * best))  # fmt: skip
        if output is Output.RATES:
            worst[speed, delay] = max(worst.get((speed, delay), 0.0), tracked.rmse_m)
            if speed == 8.0:
                label = f"{shape}, {'28 ms late' if delay else 'no delay'}"
                size = 1e3 * (tracked.error_ned**2).sum(axis=1) ** 0.5
                axes[0 if shape == "circle" else 1].plot(tracked.time_s, size, label=label)
    for axis in axes:
        axis.set(ylabel="error / mm", ylim=(0.0, 1.25 * axis.get_ylim()[1]))
        axis.legend(loc="upper right", ncols=2)
    axes[1].set(xlabel="time since the shape's start / s")
    report.figure(figure, "agile-error", "Distance from the reference at 8 m/s, output rates.")
    headers = ("shape", "m/s", "delay / ms", "output", "RMSE / mm", "peak / mm", "RotorPy SE3 / mm", "best known / mm")
    report.table(headers, rows, "RMSE of position")
    for (speed, delay), floor in FLOORS_M.items():
        what = f"circle and lemniscate, {speed:g} m/s, " + ("28 ms of delay" if delay else "no delay")
        measured = worst[speed, delay]
        report.check(what, f"<= {floor:g} m", f"{measured:.4f} m", measured <= floor)
