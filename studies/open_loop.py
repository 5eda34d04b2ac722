"""The open loop: the nonlinear model (4) and its linearisation (6) under steps of thrust and torque, and where they
diverge.

World and body axes are ours, NED and FRD, where the paper's z is up: (6) is x'' = -g theta, y'' = g phi,
z'' = g - U1 / m.
"""

import math
from dataclasses import dataclass

import numpy as np

from protocol import toml_files
from protocol.arrays import Array
from protocol.frames import to_euler
from protocol.vehicle_parameters import GRAVITY
from studies import style
from studies.report import Cell, Report
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.physics.integrator import step, work_array
from vehicle_sim.physics.rigid_body import ATTITUDE, POSITION, ROTORS, STATES, VELOCITY
from vehicle_sim.timing import STEP_S

NAME = "open-loop"
TITLE = "Open loop: (4) and (6)"

PHI, THETA = 0, 1
SECONDS = 2.0
PART = 0.1
"""The models have diverged when one is off by this share."""


@dataclass(frozen=True)
class Motion:
    """Angles, positions and velocities of a model from hover, at `time` (n,) in s."""

    time: Array
    angles: Array
    """(n, 3) roll, pitch, yaw in rad."""
    position: Array
    """(n, 3) m, NED."""
    velocity: Array
    """(n, 3) m/s, NED."""

    @property
    def acceleration(self) -> Array:
        """(n, 3) m/s2, NED, by central differences."""
        rates: Array = np.gradient(self.velocity, self.time, axis=0)
        return rates

    @property
    def tilt(self) -> Array:
        """(n,) rad, between the thrust and the vertical."""
        tilt: Array = np.arccos(np.cos(self.angles[:, PHI]) * np.cos(self.angles[:, THETA]))
        return tilt


def thrusts(airframe: Airframe, inputs: Array) -> Array:
    """(4,) N of front, right, back and left for U1 (N), U2, U3 (N, at the arm's length) and U4 (N m)."""
    u1, u2, u3, u4 = inputs
    yaw = 0.25 * u4 / airframe.body.torque_per_thrust_m
    each: Array = 0.25 * u1 + np.array([0.5 * u3 + yaw, -0.5 * u2 - yaw, -0.5 * u3 + yaw, 0.5 * u2 - yaw])
    return each


def rigid_body(airframe: Airframe, inputs: Array, seconds: float) -> Motion:
    """The simulator's rigid body under constant inputs, its rotors at their speeds from the start: no motor lag, no
    drag, no ground, no parcel."""
    vehicle = parameters(airframe)
    vehicle["mass_kg"] = airframe.body.mass_kg
    vehicle["drag_kg_s"] = 0.0
    speeds = np.sqrt(thrusts(airframe, inputs) / airframe.rotors.thrust_constant_ns2)
    state, room = np.zeros(STATES), work_array()
    state[2] = -1000.0
    state[ATTITUDE] = (1.0, 0.0, 0.0, 0.0)
    state[ROTORS] = speeds
    states = [state.copy()]
    for _ in range(round(seconds / STEP_S)):
        step(state, speeds, vehicle, STEP_S, room)
        states.append(state.copy())
    flown = np.array(states)
    angles = np.unwrap([to_euler(attitude) for attitude in flown[:, ATTITUDE]], axis=0)
    return Motion(_times(seconds), angles, flown[:, POSITION] - flown[0, POSITION], flown[:, VELOCITY])


def coupling(airframe: Airframe, spin: float, rates: Array, *, printed: bool = False) -> Array:
    """(3,) N m: the gyroscopic and inertial terms of (4), corrected or as `printed`, at body rates (3,), the rotors'
    angular momentum along z being `spin` (N m s)."""
    ix, iy, iz = airframe.body.inertia_kgm2
    p, q, r = rates
    pitch = -p * spin + r * q * (iz - ix) if printed else p * spin + r * p * (iz - ix)
    return np.array([-q * spin + q * r * (iy - iz), pitch, p * q * (ix - iy)])


def equation_4(airframe: Airframe, inputs: Array, seconds: float) -> Motion:
    """(4) with its misprints corrected, as it stands: the angles' second derivatives are those of the body rates."""
    from scipy.integrate import solve_ivp

    body = airframe.body
    inertia = np.array(body.inertia_kgm2)
    front, right, back, left = np.sqrt(thrusts(airframe, inputs) / airframe.rotors.thrust_constant_ns2)
    spin = airframe.rotors.inertia_kgm2 * (right + left - front - back)
    lift = inputs[0] / body.mass_kg
    torque = np.array([body.arm_length_m, body.arm_length_m, 1.0]) * inputs[1:]

    def rate(_: float, state: Array) -> Array:
        phi, theta, psi = state[:3]
        turning = (torque + coupling(airframe, spin, state[3:6])) / inertia
        ux = math.cos(phi) * math.sin(theta) * math.cos(psi) + math.sin(phi) * math.sin(psi)
        uy = math.cos(phi) * math.sin(theta) * math.sin(psi) - math.sin(phi) * math.cos(psi)
        moving = (-lift * ux, -lift * uy, GRAVITY - lift * math.cos(phi) * math.cos(theta))
        return np.array([*state[3:6], *turning, *state[9:], *moving])

    time = _times(seconds)
    states = solve_ivp(rate, (0.0, seconds), np.zeros(12), t_eval=time, rtol=1e-10, atol=1e-12).y.T
    return Motion(time, states[:, :3], states[:, 6:9], states[:, 9:])


def equation_6(airframe: Airframe, inputs: Array, seconds: float) -> Motion:
    """(6), by python-control."""
    import control

    body = airframe.body
    A, B = np.zeros((12, 12)), np.zeros((12, 4))  # angles, rates, position, velocity
    A[:3, 3:6] = A[6:9, 9:] = np.eye(3)
    A[9, THETA], A[10, PHI] = -GRAVITY, GRAVITY
    arms = np.array([body.arm_length_m, body.arm_length_m, 1.0])
    B[3:6, 1:] = np.diag(arms / body.inertia_kgm2)
    B[11, 0] = -1.0 / body.mass_kg
    time = _times(seconds)
    from_hover = inputs - np.array([body.mass_kg * GRAVITY, 0.0, 0.0, 0.0])
    held = np.outer(from_hover, np.ones_like(time))
    states = np.asarray(control.forced_response(control.ss(A, B, np.eye(12), 0), time, held).outputs).T
    return Motion(time, states[:, :3], states[:, 6:9], states[:, 9:])


def _times(seconds: float) -> Array:
    count = round(seconds / STEP_S)
    return np.linspace(0.0, count * STEP_S, count + 1)


def parted(model: Motion, truth: Motion) -> tuple[int | None, ...]:
    """The first sample at which a model is off by PART, in attitude, horizontal and vertical acceleration; None: never.

    Differences are measured against the truth's angles and horizontal acceleration as a whole and against gravity.
    """
    across, across_truth = model.acceleration[:, :2], truth.acceleration[:, :2]
    pairs = (
        (model.angles - truth.angles, np.linalg.norm(truth.angles, axis=1)),
        (across - across_truth, np.linalg.norm(across_truth, axis=1)),
        (model.acceleration[:, 2:] - truth.acceleration[:, 2:], np.full(len(truth.time), GRAVITY)),
    )
    firsts: list[int | None] = []
    for difference, scale in pairs:
        off = np.flatnonzero(np.linalg.norm(difference, axis=1) > PART * scale + 1e-6)
        firsts.append(int(off[0]) if len(off) else None)
    return tuple(firsts)


def run(report: Report) -> None:
    """Section 2.1 of the paper."""
    airframe = Airframe.load(toml_files.find("vehicles", "paper_quad"))
    weight = airframe.body.mass_kg * GRAVITY
    steps = {
        "thrust, U1 + 10 %": np.array([1.1 * weight, 0.0, 0.0, 0.0]),
        "roll, U2 = 0.05 N": np.array([weight, 0.05, 0.0, 0.0]),
        "pitch, U3 = 0.05 N": np.array([weight, 0.0, 0.05, 0.0]),
        "yaw, U4 = 0.02 N m": np.array([weight, 0.0, 0.0, 0.02]),
        "roll and pitch": np.array([weight, 0.05, 0.05, 0.0]),
        "roll, pitch and yaw": np.array([weight, 0.05, 0.05, 0.02]),
    }
    models = (rigid_body, equation_4, equation_6)
    motions = {
        name: tuple(model(airframe, inputs, SECONDS) for model in models)
        for name, inputs in report.progress(steps.items(), "steps of thrust and torque")
    }
    report.text(INTRODUCTION)
    _table(report, motions)
    _checks(report, airframe, motions)
    _picture(report, motions)


Motions = dict[str, tuple[Motion, ...]]


def _table(report: Report, motions: Motions) -> None:
    rows: list[tuple[Cell, ...]] = []
    for name, (truth, of_4, of_6) in motions.items():
        for label, model in (("(6)", of_6), ("(4)", of_4)):
            shown = (
                "-" if at is None else f"{math.degrees(truth.tilt[at]):.1f} deg ({truth.time[at]:.2f} s)"
                for at in parted(model, truth)
            )
            rows.append((name, label, *shown))
    headers = ("step of", "model", "attitude", "horizontal acceleration", "vertical acceleration")
    report.table(headers, rows, "Tilt and time at which a model is 10 % off the rigid body (-: never within 2 s).")


def _checks(report: Report, airframe: Airframe, motions: Motions) -> None:
    from scipy.optimize import brentq

    truth, of_4, of_6 = motions["thrust, U1 + 10 %"]
    apart = max(float(np.abs(model.position - truth.position).max()) for model in (of_4, of_6))
    report.check("step of thrust: models and rigid body apart by at most", "<= 1 um", f"{apart:.1e} m", apart <= 1e-6)
    truth, of_4, of_6 = motions["roll, U2 = 0.05 N"]
    _, across, down = parted(of_6, truth)
    assert across is not None and down is not None
    sideways = math.degrees(brentq(lambda angle: angle - (1.0 + PART) * math.sin(angle), 0.1, 1.5))
    for what, at, exact in (("sideways", across, sideways), ("down", down, math.degrees(math.acos(1.0 - PART)))):
        tilt = math.degrees(truth.tilt[at])
        report.check(
            f"roll: (6) parts {what} at", f"{exact:.1f} +- 0.2 deg", f"{tilt:.1f} deg", abs(tilt - exact) < 0.2
        )
    rates = np.array([1.0, 2.0, 0.5])
    power, printed = (float(rates @ coupling(airframe, 0.01, rates, printed=wrong)) for wrong in (False, True))
    what = f"work of the gyroscopic and inertial terms of (4) as corrected (as printed {1000.0 * printed:.0f} mW)"
    report.check(what, "0", f"{1000.0 * power:.1e} mW", abs(power) < 1e-15)


def _picture(report: Report, motions: Motions) -> None:
    figure, grid = style.sheet(2, 3, height=4.2)
    looks = (
        ("rigid body", style.PALETTE[0], "-", 2.6),
        ("(4)", style.PALETTE[3], "-", 1.2),
        ("(6)", style.PALETTE[1], "--", 1.2),
    )
    every = slice(None, None, 20)
    upper = (
        ("thrust, U1 + 10 %", 2, "height / m"),
        ("roll, U2 = 0.05 N", 1, "y / m"),
        ("roll, U2 = 0.05 N", 2, "height / m"),
    )
    for axes, (name, axis, label) in zip(grid[0], upper, strict=True):
        for motion, (who, colour, line, width) in zip(motions[name], looks, strict=True):
            path = -motion.position[:, axis] if axis == 2 else motion.position[:, axis]
            axes.plot(motion.time[every], path[every], color=colour, ls=line, lw=width, label=who)
        axes.set(title=name, ylabel=label)
    name = "roll, pitch and yaw"
    for axis, (axes, label) in enumerate(zip(grid[1], ("phi", "theta", "psi"), strict=True)):
        for motion, (_, colour, line, width) in zip(motions[name], looks, strict=True):
            axes.plot(motion.time[every], np.degrees(motion.angles[every, axis]), color=colour, ls=line, lw=width)
        axes.set(title=name, ylabel=f"{label} / deg", xlabel="time / s")
    for name, row, first in (("roll, U2 = 0.05 N", grid[0, 1:], 1), ("roll, pitch and yaw", grid[1], 0)):
        truth, _, of_6 = motions[name]
        ats = parted(of_6, truth)[first:] if first else (parted(of_6, truth)[0],) * 3
        for axes, at in zip(row, ats, strict=True):
            if at is not None:
                axes.axvline(truth.time[at], color=style.GREY, lw=0.8, ls=":")
                axes.annotate("10 %", (truth.time[at], 0.5), xycoords=("data", "axes fraction"), fontsize=7, ha="right")
    grid[0, 0].legend()
    report.figure(figure, "open-loop", "From hover, without motor lag and drag. Dotted: (6) is 10 % off.")


INTRODUCTION = """
From hover, constant inputs: the rigid body of `vehicle_sim` (quaternion, the rotors' gyroscopic torques; without motor
lag, drag and ground), the paper's (4) with its misprints corrected, and its linearisation (6) by python-control.

Height under thrust and each angle under its own torque are the same in all three: a single axis of rotation is linear.
What (6) leaves out is where the thrust points: the lift that is lost with the tilt, the sine of the tilt, and the turn
of both with the heading. (4) has all of that; it takes the angles for the integrals of the body's rates, which they are
not once two of them are large, so with two or three torques at once it parts from the rigid body nearly as soon as (6).
The companion therefore turns thrust vectors into attitudes exactly and takes the attitude's error from quaternions.

Two misprints of (4) beside those of Table 1's inertia, l and g: the coupling in theta'' is of psi' and phi', not of
psi' and theta', and its gyroscopic term is + phi' Jr w_r. As printed these terms do work; gyroscopic torque does none.
"""
