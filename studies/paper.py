"""The page docs/paper.md: each experiment of the paper, flown here."""

from studies.report import Page

PAPER = Page(
    name="paper",
    introduction="""
# The paper's experiments, flown here

*State Feedback Controller Design by Utilizing Linear Quadratic Regulator and Backstepping Control for UAV Quadrotor*:
each of its experiments, its numbers beside ours. `make paper` runs all of it and writes this page (some ten minutes);
`python -m studies NAME` runs one study and writes the page anew. Crosses in the figures are values that the paper
prints. "Flown" means the companion and the vehicle simulator in lockstep, MAVLink between them, unless a section says
otherwise; "checked" are the figures of an independent recomputation before this project.

## What came out

**Reproduced**: Table 2, every figure but the misprints below, and why it misses its setpoints; Table 3, every figure
but the misprints; the law behind the columns of Table 4; the outcomes of Figs. 7 to 9. What each of them took is in
its section.

**Misprinted**, and read here as in the right column:

| where | printed | read as |
| --- | --- | --- |
| Table 1 | a second Ixx | Izz = 0.02098 kg m2 |
| (4) | I U2 / Ixx, I U3 / Iyy | l U2 / Ixx, l U3 / Iyy, as in (6) |
| (4), (6) | U4 / Ixx | U4 / Izz; the row of psi in Table 2 agrees |
| (4) | z'' = U1 / m (cos phi cos theta - g) | U1 / m cos phi cos theta - g |
| (4) | theta'': - phi' Jr w_r / Iyy, psi' theta' (Izz - Ixx) / Iyy | + phi' Jr w_r / Iyy, psi' phi' (Izz - Ixx) / Iyy |
| (21) | last bracket times e11, c11 e11 in it | times e12 as in (20), c11 (x_d' - x12) |
| (23) to (25) | + c12 e12 + c12 (...), + c8 e8, + c10 e10 | - c12 e12 + c11 (...), - c8 e8, - c10 e10; else unstable |
| (30), (31) | x_abs, x_av twice | x_obs, y_av in (31), whose farther edge is the one to get past: see Figs. 6-9 |
| Table 2 | phi, Q = 1: rise 2 s | 2.31 s |
| Table 2 | phi, theta, Q = 5: settling 4.56 s, error -0.45 rad | 1.96 s, -0.55 rad (0.45 rad is the angle reached) |
| Table 3 | x, y, c = 2.5: rise 2 s | 1.63 s, as z |
| abstract | 0.000024 m for orientation | rad, as in the conclusion |
| text | "Table 2" for position, "Table 3" for attitude | the other way round |

**Not known**, because the text does not have it: the trajectory of Fig. 4 and so Table 4 point by point; the places,
speeds and field of view of Figs. 6 to 9; Jr, kf and km (here those of OS4, see `vehicles/paper_quad.toml`); the angle
weights under which the trajectory and the avoidance were flown; whether the simulated vehicle had motors with lag; when
the 0.000024 rad of the conclusion were read (Table 2's 0.00007 rad are those after 10 s).
""",
    studies=(
        "studies.open_loop",
        "studies.attitude_loop",
        "studies.position_loop",
        "studies.tracking",
        "studies.waypoints",
        "studies.lyapunov",
    ),
)
