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

With the seeds 1 to 12 two of 480 flights in memory came out otherwise:

- *delay each way jumps, 20 to 200 ms* on *courier* 12 touched the ground. The delay jumped while the vehicle braked at
  the house. It was commanded in rates, and a vehicle holds the last ones: for some 360 ms nothing new reached it. Other
  moments of that braking were flown, too: in rates two of four flights crashed, tilted by up to 84 degrees; in
  attitudes, which the companion chooses for this vehicle by itself, none of four did. **This is not cured.**
- *attitude, frozen* on *square* 11 was answered after 1.13 s. The vehicle flew straight on then; the attitude began to
  move 1 s after it was frozen, and 0.1 s later it was answered.

`python -m studies.faults FAULT MISSION SEED` flies one of them.
""",
    studies=("studies.faults.matrix", "studies.faults.over_udp", "studies.faults.kills", "studies.faults.soak"),
)
