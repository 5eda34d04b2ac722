"""Obstacles that appear before the vehicle, and walkers that cross its way."""

from studies import crowded, escape, flown, worlds
from studies.campaign import DEFAULT, Setup
from studies.campaign_report import Case, fly_and_tell
from studies.report import Report

NAME = "moving"
TITLE = "Pop-up pillars and walkers"

AT_REST_M_S = 0.2
SETUPS = (
    Setup("popup", "pillar 2 m ahead", worlds.pop_up, (3.0,), 60.0, 20),
    Setup("street", "street with walkers", worlds.street, (3.0,), 120.0, 50),
    Setup("oncoming", "mover ahead on", crowded.oncoming, (6.0,), 60.0, 100),
    Setup("crossing", "mover across", crowded.crossing, (6.0,), 60.0, 100),
    Setup("settingoff", "mover across soon after the start", crowded.setting_off, (6.0,), 60.0, 100),
    Setup("car", "mover as wide as a car", crowded.car, (6.0,), 60.0, 100),
    Setup("several", "three movers", crowded.several, (6.0,), 60.0, 100),
    Setup("overtaking", "mover from behind", crowded.overtaking, (6.0,), 60.0, 100),
    Setup("waiting", "mover where the vehicle waits", crowded.waiting, (6.0,), 60.0, 100),
)


def run(report: Report) -> None:
    report.text(
        f"""
A pillar of 0.2 m appears when the vehicle's centre is 2 m from its side. In a street of 12 m between walls ten walkers
of 0.6 m go to and fro at 0.6 to 1.5 m/s, half of them across it, without avoiding anything; they are taller than
people, whom a tilted scan would miss. In the open a mover of 0.6 m comes ahead on at 2 to 4 m/s, crosses the way at 0.7
to 4 m/s, comes from behind at 6.5 to 10 m/s, or passes over the place where the vehicle waits at 0.7 to 10 m/s. One of
0.3 to 0.6 m at 0.7 to 3 m/s crosses it where the vehicle still accelerates, so that its scan meets the ground ahead;
one of 1.4 to 3 m, as wide as a car, crosses it at 1 to 8 m/s; and three of 0.4 to 1 m at 0.5 to 4 m/s come over it from
any side. They avoid nothing.

A contact is **avoidable** if there was an escape. {_how()}

A walker may also walk into a vehicle that hovers: such contacts count as avoidable where it could have moved away.
"""
    )
    flown.picture(report, SETUPS)
    for case in fly_and_tell(report, SETUPS, ()):
        if case.method == DEFAULT:
            _check(report, case)


def _how() -> str:
    text = (escape.__doc__ or "").split("\n\n", 1)[1]
    return " ".join(text.split())


def _check(report: Report, case: Case) -> None:
    contacts = [row for row in case.rows if row.outcome == "contact"]
    avoidable = sum(row.avoidable is not False for row in contacts)
    resting = sum(row.contact_speed is not None and row.contact_speed < AT_REST_M_S for row in contacts)
    report.check(
        f"{case.setup.title}: contacts that could have been avoided, {DEFAULT}, {case.speed:g} m/s",
        "0",
        f"{avoidable} of {len(contacts)} contacts in {len(case.rows)} flights ({resting} at rest)",
        avoidable == 0,
    )
