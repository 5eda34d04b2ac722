"""The page docs/paper.md: each experiment of the paper, flown here."""

from studies.report import Page

PAPER = Page(
    name="paper",
    introduction="""
# The paper's experiments, flown here

*State Feedback Controller Design by Utilizing Linear Quadratic Regulator and Backstepping Control for UAV Quadrotor*:
each of its experiments, its numbers beside ours. `make paper` runs all of it and writes this page;
`python -m studies NAME` runs one. Crosses in the figures are values that the paper prints.
""",
    studies=("studies.open_loop", "studies.attitude_loop", "studies.position_loop", "studies.lyapunov"),
)
