"""Fields of cylinders after the manner of the BARN challenge, with its score."""

from studies import flown, worlds
from studies.campaign import DEFAULT, Row, Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "barn"
TITLE = "BARN-like fields"

BARN_SPEED = 2.0
"""m/s, the challenge's."""
SPEED = BARN_SPEED * worlds.BARN_SCALE
LIMIT_S = 100.0
SCORE = 0.43
SETUPS = (Setup("barn", "field", worlds.barn, (SPEED,), LIMIT_S, 100, has_way=True),)
FLOORS = (Floor("barn", 0.9, published="DWA 85 %"),)


def score(row: Row) -> float:
    """success * OT / clip(AT, 2 OT, 8 OT) with the optimal time OT, shortest way / SPEED, and the actual time AT."""
    if not row.succeeded or row.shortest_m is None:
        return 0.0
    optimal_s = row.shortest_m / SPEED
    return optimal_s / min(max(row.route_s, 2.0 * optimal_s), 8.0 * optimal_s)


def run(report: Report) -> None:
    report.text(
        f"""
30 x 30 cells of 0.15 m, 15 to 30 % full and smoothed by a cellular automaton, a cylinder of 0.075 m in each full cell
at an edge, 10 m of way, 100 s. All lengths are multiplied by {worlds.BARN_SCALE:.2f}, our hull's 0.72 m over the 0.43 m
of the challenge's robot, so that a passage is as many vehicles wide as there. Times stay, so the challenge's 2 m/s are
{SPEED:.2f} m/s here. The worlds are made here by that recipe and are not the challenge's own 300; only such are kept
through which the hull could go with 5 cm to spare. Arrival is within {2.0:g} m of the goal.
"""
    )
    flown.picture(report, SETUPS)
    for case in fly_and_tell(report, SETUPS, FLOORS):
        if case.method == DEFAULT:
            mean = case.mean(score, reached=False)
            report.check(f"BARN score, {DEFAULT}", f"> {SCORE}; DWA 0.169, best published 0.48", mean, mean > SCORE)
