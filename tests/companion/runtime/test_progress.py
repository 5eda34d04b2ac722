"""What a person who watches a flight is shown of it."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.curves import Route
from companion.mission.plan import Mission, Phase, Step
from companion.runtime.progress import Progress, ahead, clock_text
from protocol.flightlog import Status
from studies.joined import Joined
from tests.companion.runtime import hop

SPEEDS = 4.0, 2.0


def place(north: float, east: float, height: float) -> Step:
    return Step(Phase.ROUTE, np.array((north, east, -height)))


def test_what_is_left_is_the_way_through_all_places_and_down() -> None:
    left = [(place(40.0, 0.0, 3.5), None), (place(40.0, 30.0, 3.5), None), (Step(Phase.LAND), None)]
    metres, seconds = ahead(left, np.array((0.0, 0.0, -3.5)), 0.0, SPEEDS, 0.0)
    assert metres == pytest.approx(40.0 + 30.0 + 3.5)
    assert seconds == pytest.approx(70.0 / 4.0 + 3.5 / 0.7)
    assert ahead(left[1:], np.array((40.0, 0.0, -3.5)), 0.0, SPEEDS, 0.0).metres == pytest.approx(metres - 40.0)
    climb = ahead([(place(0.0, 0.0, 8.0), None)], np.zeros(3), 0.0, SPEEDS, 0.0)
    assert climb.seconds == pytest.approx(8.0 / 2.0 + 8.0 / 0.7)


def test_holds_speeds_and_tracks_take_their_time() -> None:
    slow = Step(Phase.ROUTE, np.array((10.0, 0.0, 0.0)), hold_s=5.0, speed=1.0)
    assert ahead([(slow, None)], np.zeros(3), 0.0, SPEEDS, 0.0).seconds == pytest.approx(15.0)
    track = Step(Phase.TRACK, np.zeros(3), curve=Route(np.zeros((2, 3)), 1.0))
    metres, seconds = ahead([(track, 20.0)], np.zeros(3), 8.0, SPEEDS, 0.0)
    assert math.isinf(metres) and seconds == pytest.approx(12.0)
    assert ahead([(track, 20.0)], np.zeros(3), 30.0, SPEEDS, 0.0).seconds == 0.0
    later = ahead([(place(0.0, 0.0, 0.0), None), (track, 20.0)], np.zeros(3), 8.0, SPEEDS, 0.0)
    assert later.seconds == pytest.approx(20.0)


def test_clock() -> None:
    assert [clock_text(at) for at in (0.4, 65.0, 3605.0, 59.6, math.nan)] == ["0:00", "1:05", "1:00:05", "1:00", "-"]


def test_a_flight_is_shown_from_its_start_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = list[Status]()
    told = Progress.status

    def keep(self: Progress, now_ns: int, flown_s: float) -> Status:
        shown.append(told(self, now_ns, flown_s))
        return shown[-1]

    monkeypatch.setattr(Progress, "status", keep)
    monkeypatch.setattr("companion.runtime.runner._STATUS_EVERY_S", 0.0)
    autopilot = hop.fly(tmp_path, console=True)
    titles = [status.title for status in shown]
    assert any(title.startswith("hop: takeoff, step 1 of 3") for title in titles) and titles[-1].startswith("hop: land")
    done = [status.done for status in shown if status.done is not None]
    assert done[0] < 0.2 and done[-1] > 0.9 and min(np.diff(done)) > -0.1
    figures = [dict(status.figures) for status in shown]
    assert max(float(each["height"].split()[0]) for each in figures if "height" in each) == pytest.approx(0.6, abs=0.11)
    assert figures[-1]["link"] == "good" and figures[-1]["battery"].endswith("%")
    autopilot.supervisor.waiting_for = "no ring"
    assert Progress(autopilot).status(0, 0.0).title.endswith("waiting: no ring")


def test_what_waits_for_orders_has_no_share_done() -> None:
    """Nor has it an end: it was shown as done by nan %, and so was all that was ordered afterwards."""
    joined = Joined(Mission("script", takeoff_height=2.0, waits=True), overrides=("avoidance.method=none",))
    progress, shown = Progress(joined.autopilot), list[Status]()

    def waits(flight: Joined) -> bool:
        shown.append(progress.status(flight.vehicle.time_ns, 0.0))
        return flight.autopilot.navigator.phase is Phase.WAIT

    joined.fly(until=waits)
    assert shown[-1].title.startswith("script: wait") and ("time to go", "-") in shown[-1].figures
    assert {status.done for status in shown} == {None}
