"""Table 2: the attitude loop under Q = 1, 5, 10, as published, with a reference gain, and in flight."""

from studies.report import Report

NAME = "attitude-loop"
TITLE = "Table 2: the attitude loop"


def run(report: Report) -> None:
    """Sections 2.2 and 3.1 of the paper."""
