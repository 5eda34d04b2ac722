"""The live page's instruments, alerts and strip, made of values that are known."""

import math
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from companion.outcomes import Outcome, Verdict
from companion.view.accumulators.texts import Text, level_of
from companion.view.history import History, Moment, Span
from companion.view.live_hud import alerts, hud
from companion.view.live_instruments import Flown, flown, instruments
from companion.view.live_strip import strip
from companion.view.live_words import words
from companion.view.sources import NextFlight, open_log
from protocol.flightlog.mavlink_records import message_type
from protocol.frames import from_euler
from protocol.messages import dialect
from tests.companion.view.made_logs import Values, make

SVG = "{http://www.w3.org/2000/svg}"
KNOWN = Flown(10.0, 5.0, 350.0, 4.2, 12.0, -1.5, 80.0, 200.0, 14.0, 5.0)


def at(time: float, folder: Path) -> Moment:
    history = History()
    for batch in open_log(make(folder, 12.0)).poll():
        history.take(batch)
    return history.at(time)


def texts_of(picture: str) -> dict[str, str]:
    root = ElementTree.fromstring(picture)
    return {each.get("id", ""): each.text or "" for each in root.iter("text") if each.get("id")}


def test_the_instruments_show_a_moment_in_people_s_units(tmp_path: Path) -> None:
    moment = replace(
        at(5.0, tmp_path),
        attitude_ned_frd=from_euler(math.radians(10.0), math.radians(-5.0), math.radians(-90.0)),
        velocity_ned=np.array([3.0, 4.0, 1.0]),
        position_ned=np.array([0.0, 20.0, -7.5]),
    )
    values = flown(moment)
    assert (values.roll_deg, values.pitch_deg, values.heading_deg) == pytest.approx((10.0, -5.0, 270.0))
    assert (values.speed, values.climb, values.height) == pytest.approx((5.0, -1.0, 7.5))
    assert values.course_deg == pytest.approx(math.degrees(math.atan2(4.0, 3.0)))
    assert values.home_deg == pytest.approx(270.0)
    assert (values.wanted_height, values.speed_limit) == pytest.approx((3.0, 4.0))
    assert texts_of(instruments(values)) == {
        "speed-value": "5.0",
        "height-value": "7.5",
        "climb-value": "-1.0",
        "heading-value": "270°",
    }


def test_the_horizon_tilts_against_the_vehicle_and_sinks_when_the_nose_rises() -> None:
    for roll, pitch in ((10.0, 5.0), (-30.0, -8.0)):
        picture = instruments(replace(KNOWN, roll_deg=roll, pitch_deg=pitch))
        moved = re.search(r"rotate\(([-\d.]+)\) translate\(0 ([-\d.]+)\)", picture)
        assert moved is not None
        assert float(moved[1]) == -roll and math.copysign(1.0, float(moved[2])) == math.copysign(1.0, pitch)


def test_what_is_higher_is_higher_on_its_tape_and_what_is_east_of_the_nose_right_of_it() -> None:
    root = ElementTree.fromstring(instruments(KNOWN))
    height = next(each for each in root if each.get("id") == "height")
    places = {
        int(text.text or ""): float(text.get("y", ""))
        for text in height.iter("text")
        if not text.get("id") and (text.text or "").isdigit()
    }
    assert places[14] < places[12] < places[10]
    compass = next(each for each in root if each.get("id") == "compass")
    names = {text.text: float(text.get("x", "")) for text in compass.iter("text")}
    assert names["330"] < names["350°"] < names["N"] < names["30"]


@pytest.mark.parametrize("name", ["speed", "height", "climb", "heading"])
def test_what_is_not_known_is_crossed_out(name: str) -> None:
    values = replace(KNOWN, **{name if name != "heading" else "heading_deg": None})
    shown = texts_of(instruments(values))
    assert f"{name}-value" not in shown and len(shown) == 3


def test_the_worst_alert_is_first_and_old_warnings_go(tmp_path: Path) -> None:
    calm = at(5.0, tmp_path)
    assert alerts(calm) == []
    said = (Text(4.0, 3, "1/1", "old news"), Text(4.5, 3, "1/1", "<b>"), Text(4.6, 5, "1/1", "rotor lost"))
    moment = replace(calm, warnings=said, failsafe=True, battery=20.0, link_age=2.0)
    told = [alert.text for alert in alerts(moment)]
    assert told[0] == "rotor lost" and told[-2:] == ["<b>", "old news"]
    assert set(told[1:3]) == {"the vehicle is in a failsafe", "link lost: nothing heard for 2 s"}
    assert told[3] == "battery: 20 % left"
    page = hud(moment, "5.0 s", alerts(moment))
    assert "<b>" not in page and "and 3 more" in page and page.index("rotor lost") < page.index("failsafe")
    assert [alert.text for alert in alerts(replace(calm, time=30.0, warnings=said))] == []
    crashed = Verdict(Outcome.CRASHED, "hit the ground")
    assert [alert.level for alert in alerts(calm, verdict=crashed)] == [4]
    assert alerts(calm, verdict=Verdict(Outcome.DELIVERED, "")) == []


def test_levels_are_those_of_mavlink() -> None:
    levels = [level_of(severity) for severity in range(dialect.MAV_SEVERITY_DEBUG + 1)]
    assert levels == [5, 5, 5, 4, 3, 2, 2, 1] and level_of(255) == 1


def test_phases_follow_each_other_without_gaps(tmp_path: Path) -> None:
    history = History()
    for batch in open_log(make(tmp_path, 12.0)).poll():
        history.take(batch)
    first, second = history.phases()
    assert (first.name, second.name) == ("route", "return")
    assert first.end == second.start == pytest.approx(10.0, abs=0.01)
    assert [mode.name for mode in history.modes()] == ["external control"]


def test_what_the_companion_says_of_its_way_is_told_apart(tmp_path: Path) -> None:
    """Blocked, limited, or both."""

    def change(time: float, values: Values) -> None:
        values |= {"blocked": 2.0 <= time < 6.0, "limited": time >= 4.0, "speed_limit": 2.5, "clearance": 1.5}

    history = History()
    for batch in open_log(make(tmp_path, 8.0, change=change)).poll():
        history.take(batch)
    for time, flags in ((1.0, (False, False)), (3.0, (True, False)), (5.0, (True, True)), (7.0, (False, True))):
        plan = history.at(time).plan
        assert plan is not None and (plan.blocked, plan.limited) == flags
        assert (plan.speed_limit, plan.clearance) == (2.5, 1.5)


def test_without_control_steps_somebody_is_waited_for_or_there_is_no_companion(tmp_path: Path) -> None:
    silent = replace(at(5.0, tmp_path), plan=None, phase=None, state=None)
    for age, doing in ((None, "waiting"), (0.1, "no companion")):
        assert f'id="bar-phase">{doing}<' in hud(replace(silent, link_age=age), "5.0 s", [])


def test_after_hours_a_vehicle_is_shown_as_it_was_at_any_moment() -> None:
    """What is thinned is no more than a second from its neighbour; what is recent is whole."""
    history, hours, part_s = History(), 3, 60.0
    for start in np.arange(0.0, hours * 3600.0, part_s):
        for name, rate in (("ATTITUDE_QUATERNION", 50.0), ("LOCAL_POSITION_NED", 30.0), ("HEARTBEAT", 1.0)):
            kind = message_type(getattr(dialect, f"MAVLINK_MSG_ID_{name}"), f"/mavlink/1/1/{name}")[0]
            times = start + np.arange(0.0, part_s, 1.0 / rate)
            table = np.zeros(len(times), kind.dtype)
            if name == "ATTITUDE_QUATERNION":
                table["q1"] = 1.0
            elif name == "LOCAL_POSITION_NED":
                table["x"] = times
            else:
                table["autopilot"], table["base_mode"] = dialect.MAV_AUTOPILOT_PX4, 128
            history.take((kind.topic, kind, np.round(1e9 * times).astype(np.int64), table))
    for time in (*np.linspace(60.0, history.end - 60.0, 200), *np.linspace(history.end - 60.0, history.end, 200)):
        moment = history.at(float(time))
        assert moment.attitude_ned_frd is not None and moment.armed
        assert moment.link_age is not None and moment.link_age <= 1.0
        off = 0.04 if time > history.end - 60.0 else 10.0
        assert moment.position_ned is not None and moment.position_ned[0] == pytest.approx(time, abs=off)


def test_a_text_counts_as_a_warning_from_that_level_on() -> None:
    history = History()
    history.texts = [Text(1.0, level, "companion", "said") for level in range(1, 6)]
    assert [text.level for text in history.warnings()] == [3, 4, 5]


def test_a_companion_that_watches_the_landing_is_still_one(tmp_path: Path) -> None:
    """Without control steps there is no trace."""
    history = History()
    for batch in open_log(make(tmp_path, 8.0, traced=2.0)).poll():
        history.take(batch)
    moment = history.at(7.9)
    assert (moment.plan, moment.doing) == (None, "route")
    assert "no companion" not in hud(moment, "7.9 s", []) and "route" in words(moment, "made", "", None)
    (span,) = history.phases()
    assert span.end == history.end > 7.9


def test_the_strip_is_as_long_as_the_flight() -> None:
    rows = [[Span(0.0, 5.0, "route"), Span(5.0, 10.0, "<land>")]]
    page = strip(rows, [7.5], 0.0, 20.0, 10.0)
    places = re.findall(r'style="left:([\d.]+)%(?:;width:([\d.]+)%)?', page)
    assert places == [("0.00", "25.00"), ("25.00", "25.00"), ("37.50", ""), ("50.00", "")]
    assert "<land>" not in page and "&lt;land&gt;" in page


def test_a_page_waits_for_the_flight_that_begins_next(tmp_path: Path) -> None:
    make(tmp_path / "old", 1.0)
    source = NextFlight(tmp_path)
    assert list(source.poll()) == [] and not source.ended and "waiting" in source.name
    begun = make(tmp_path / "new", 1.0)
    history = History()
    for batch in source.poll():
        history.take(batch)
    assert source.name == str(begun) and source.ended
    assert history.at(0.5).position_ned is not None
