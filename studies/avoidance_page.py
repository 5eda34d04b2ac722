"""docs/avoidance.md: how far each method of avoidance can be trusted."""

from studies.report import Page

AVOIDANCE = Page(
    name="avoidance",
    introduction="""# Avoidance, measured

Every method of `avoidance.method` in places that are made by seed: `python -m studies worlds NAME --seed N --picture`
makes one, with a mission that flies through it. A flight is the whole companion and the whole simulated vehicle,
MAVLink between them, joined in memory; the same bytes as from two processes (`tests/studies/test_campaign.py`). It is a
success if the vehicle came within 2 m of the goal, in time, and touched nothing until it stood there.

`python -m studies avoidance --seeds 100` flies the whole table, each set-up with as many seeds as its floor is meant
for (20, 50 or 100), hours on a small machine; `python -m studies forest --seeds 5 --method astar` a part of it. Each
case that is flown is kept as Parquet, one row a flight, in `logs/avoidance/`; a page tells of all that is kept there,
and `--seeds 0` writes it without flying. A floor is compared with the share itself; Wilson's 95 % interval stands
beside it.
""",
    studies=("studies.forest", "studies.traps", "studies.narrow", "studies.enclosed", "studies.moving", "studies.barn"),
)
