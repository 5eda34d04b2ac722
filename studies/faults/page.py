"""docs/faults.md: what was promised of each fault, and what came of it."""

from studies.report import Page

FAULTS_PAGE = Page(
    name="faults",
    introduction="""# Faults, measured

What [failsafes](failsafes.md) promises of a link that is late, lossy or damaged, of telemetry and rings that are stuck
or wrong, of clocks that jump and of processes that end, beside what came of it in flight.
`studies/faults/catalogue.py` lists the faults; `studies/faults/injector.py` stands between the simulated vehicle and
the companion and does the harm, from a seed. A steady delay is there from the start, as jitter is; other faults begin
at a random moment between take-off and landing. What the vehicle says is wrong from the first message on that differs
from what it would have said: an attitude that stays the same anyhow is not frozen yet.

Faults of rings are flown on the courier's way alone; those that are there from the start on the *square*, too, which
nothing stands around; the others on one of the two, by seed. In memory, the companion commands in one half of the
flights on each mission what it chooses for the simulated vehicle, attitudes, and in the other half rates. Resets of the
heading are flown on rates alone: what is injected here does not reach the vehicle's own attitude control. Over UDP it
commands rates, too.

- *delivered*: the mission is done, without a fault of the companion;
- *astray*: so it says, but vehicle or parcel is more than a metre from where it belongs;
- *landed*: the companion held, and landed the vehicle;
- *withdrew*: the vehicle's own autopilot was asked to hold, and the vehicle is on the ground;
- *refused*: it never took off;
- *contact*: it touched an obstacle or hit the ground.

`python -m studies faults --seeds 50` flies all of it with as many seeds as the floors are meant for, hours on a small
machine. Flights are kept in `logs/faults/`, so that it goes on where it was ended; they are flown anew when the code of
what flies has changed. `--seeds 0` writes the page without flying.

Of a delay that jumps from 20 to 200 ms each way while the vehicle brakes hard, more was flown than the seeds below. On
rates a vehicle holds the last ones for some 360 ms then. At ten moments of the braking at the courier's house seven
flights crashed, tilted by up to 79 degrees. Since attitudes are sent where telemetry is overdue or the link late
([failsafes](failsafes.md#a-late-link)), none of the ten did (55 degrees), none of 40 at random moments of both
missions, and none of 30 with jumps between 0 and 200 ms (52 degrees).

`python -m studies.faults FAULT MISSION SEED` flies one of them.
""",
    studies=("studies.faults.matrix", "studies.faults.over_udp", "studies.faults.kills", "studies.faults.soak"),
)
