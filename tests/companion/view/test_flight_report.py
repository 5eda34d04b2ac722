"""The report as a browser shows it: complete in one file, every chart drawn, no error; for our logs and for others'."""

import base64
import math
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.logs.writer import Writer
from companion.view.attitudes import euler_deg
from companion.view.gather import GatheredFlight
from companion.view.lines import Floats
from companion.view.report import compose, write
from companion.view.report_page import Page
from companion.view.scene import solids
from protocol.flightlog import Direction, FlightLogError
from protocol.frames import to_euler
from protocol.messages import Encoder, dialect
from tests.companion.view.browser import assert_legible, needs_chromium, opened
from tests.companion.view.made_logs import SPEED, WORLD, from_tlog, make

SHOWS = """([start, stop]) => Array.from(document.querySelectorAll(".plot"))
  .filter(plot => plot.layout.shapes?.length).map(plot => plot.layout.xaxis.range)
  .every(range => Math.abs(range[0] - start) < 1e-6 && Math.abs(range[1] - stop) < 1e-6)"""
"""Whether every chart over time shows that stretch."""
DATA = Path(__file__).resolve().parents[2] / "data"


def points(packed: str) -> Floats:
    return np.frombuffer(base64.b64decode(packed), "<f4")


@needs_chromium
def test_the_report_opens_draws_every_chart_and_follows_a_look(tmp_path: Path) -> None:
    report = write(make(tmp_path, jump_at=15.0)).path
    assert report == tmp_path / "report.html"
    with opened(report.as_uri()) as (page, errors):
        page.eval_on_selector_all(".flat h3", "all => all.forEach(heading => heading.click())")
        plots = page.locator(".plot")
        for index in range(plots.count()):
            plots.nth(index).scroll_into_view_if_needed()
            page.wait_for_selector(f".plot[data-drawn] >> nth={index}", state="attached")
        assert plots.count() > 25
        lines = page.eval_on_selector_all(".plot", "plots => plots.map(plot => plot.data.length)")
        assert all(lines)
        flown = page.evaluate(
            "() => { const way = document.querySelector('.plot').data.find(line => line.name === 'flown');"
            " return [Math.max(...way.y), Math.max(...way.x)]; }"
        )
        assert flown == pytest.approx([2.0 * 19.98 + 1.5, 0.0], abs=0.01), "as the vehicle told it"
        obstacles = page.evaluate("document.querySelectorAll('.plot')[1].data.at(-1).i.length")
        assert (
            obstacles
            == sum(len(solid.faces) for solid in compose(GatheredFlight(tmp_path / "flight.mcap")).solids) // 3
        )
        page.locator(".finding.warning button").first.click()
        page.wait_for_function(SHOWS, arg=[10.0, 20.0])
        looked = page.locator(".card.looked")
        assert looked.locator("h3").inner_text().startswith("Position north") and looked.is_visible()
        mark = looked.locator(".plot").evaluate("plot => plot.layout.shapes.at(-1).x0")
        assert mark == pytest.approx(15.0, abs=0.02)
        top, height = looked.evaluate("card => [card.getBoundingClientRect().top, window.innerHeight]")
        assert 0.0 <= top < height, "scrolled to"
        page.locator("#whole").click()
        page.wait_for_function(SHOWS, arg=[0.0, 19.996])
        page.locator(".finding.warning button").first.click()
        page.wait_for_function(SHOWS, arg=[10.0, 20.0])
        plots.nth(2).locator(".nsewdrag").dblclick()
        page.wait_for_function(SHOWS, arg=[0.0, 19.996])
        assert not page.locator("#whole").is_visible()
        assert page.locator("#title").inner_text() == "made" and page.locator(".banner.good").count() == 1
        assert errors == []


def test_the_motion_is_drawn_to_its_end_though_the_trace_ends_before(tmp_path: Path) -> None:
    page = compose(GatheredFlight(make(tmp_path, traced=12.0)))
    charts = {chart.title: {curve.name: points(curve.x) for curve in chart.curves} for chart in page.charts}
    for title in ("Height", "Speed", "Position north", "Velocity down", "Roll", "Pitch rate"):
        assert charts[title]["is"][-1] == pytest.approx(19.98)
        assert charts[title]["wanted"][-1] == pytest.approx(12.0, abs=0.05)
    (flown,) = [way for way in page.ways if way.name == "flown"]
    assert points(flown.north)[-1] == pytest.approx(SPEED * 19.98)
    assert [(band.name, round(band.start), round(band.stop)) for band in page.bands] == [
        ("route", 0, 10),
        ("return", 10, 12),
        ("Offboard", 12, 19),
    ]


def test_only_what_stands_around_the_path_is_drawn(tmp_path: Path) -> None:
    """A street of 120 m, of which 4 m are flown."""
    shown = {solid.name for solid in compose(GatheredFlight(make(tmp_path, 2.0))).solids}
    everything = solids(WORLD)
    near = {prism.name for prism in everything if min(abs(north) + abs(east) for north, east in prism.outline) < 20.0}
    far = {prism.name for prism in everything if min(north for north, _ in prism.outline) > 40.0}
    assert near and far and near <= shown and not shown & far


def test_the_greatest_tilt_is_of_the_whole_attitude(tmp_path: Path) -> None:
    """Roll and pitch of 30 degrees each lean by 41.4: cos 30 deg squared is 3/4."""
    path, vehicle = tmp_path / "leaning.mcap", Encoder(1, 1)
    with Writer(path, 0, {}) as writer:
        for number, angle in enumerate((0.0, math.pi / 6.0)):
            beat = (dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)
            attitude = (20 * number, angle, angle, 1.0, 0.0, 0.0, 0.0)
            data = vehicle.encode_fields(dialect.MAVLink_heartbeat_message, *beat)
            data += vehicle.encode_fields(dialect.MAVLink_attitude_message, *attitude)
            writer.datagram(number * 20_000_000, number, Direction.IN, "", data)
    assert ("greatest tilt", f"{math.degrees(math.acos(0.75)):.0f}°") in compose(GatheredFlight(path)).tiles


def test_px4_s_integer_parameters_are_read_by_their_bits(tmp_path: Path) -> None:
    shown = dict(compose(GatheredFlight(from_tlog(DATA / "px4_offboard.tlog", tmp_path))).parameters)
    assert (shown["CAL_ACC0_ID"], shown["CAL_MAG0_PRIO"], shown["CAL_BARO0_OFF"]) == ("1310988", "50", "0")


def test_nothing_is_fetched_from_elsewhere(tmp_path: Path) -> None:
    class Links(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.found: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.found += [value or "" for name, value in attrs if name in ("src", "href")]

    links = Links()
    links.feed(write(make(tmp_path, 1.0)).path.read_text(encoding="utf-8"))
    assert links.found == ["data:,"]


def test_a_text_of_the_vehicle_can_t_break_out_of_the_page(tmp_path: Path) -> None:
    fault = "</script><script>document.title = 'broken'</script><!--<script>"
    path = make(tmp_path, 1.0, result={"fault": fault, "landed": "False"})
    text = write(path).path.read_text(encoding="utf-8")
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert block is not None
    page = msgspec.json.decode(block[1], type=Page)
    assert fault in page.findings[0].text


@pytest.mark.parametrize("name", [b"l\xe9.mcap", b"l\xe9/flight.mcap"])
def test_names_of_files_may_be_any_bytes(tmp_path: Path, name: bytes) -> None:
    """Also that of a log that is not whole, of which a finding tells."""
    path = tmp_path / os.fsdecode(name)
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(make(tmp_path / "made", 1.0).read_bytes()[:-5])
    text = write(path).path.read_text(encoding="utf-8")
    assert text.count("l\\\\udce9") >= 2


@pytest.mark.parametrize("name", ["px4_offboard", "ardupilot_guided"])
def test_flights_of_other_systems_are_reported_on(tmp_path: Path, name: str) -> None:
    """Recorded from PX4 and ArduCopter: what they flew is in the recordings' description."""
    path = from_tlog(DATA / f"{name}.tlog", tmp_path)
    flight = GatheredFlight(path)
    page = compose(flight)
    titles = {chart.title for chart in page.charts}
    assert {"Height", "Roll", "Yaw rate", "Velocity down", "Thrust", "Battery voltage", "Body rates"} <= titles
    height = flight.lines["1/1/LOCAL_POSITION_NED:height"].points()[1]
    assert 3.0 < height.max() < 40.0
    assert len(page.ways) == 1
    said = [event.text for event in page.events]
    assert "armed" in said and "disarmed" in said
    assert {"px4_offboard": "Offboard", "ardupilot_guided": "Guided"}[name] in {band.name for band in page.bands}
    assert name == "ardupilot_guided" or {"Satellites", "Temperature", "Acceleration, raw"} <= titles
    report = write(path).path
    assert report.stat().st_size < 12_000_000


@needs_chromium
def test_a_report_of_another_system_draws(tmp_path: Path) -> None:
    report = write(from_tlog(DATA / "px4_offboard.tlog", tmp_path)).path
    with opened(report.as_uri()) as (page, errors):
        page.wait_for_selector(".plot[data-drawn]")
        page.eval_on_selector_all(".flat h3", "all => all.forEach(heading => heading.click())")
        last = page.locator(".plot").last
        last.scroll_into_view_if_needed()
        page.wait_for_function("Array.from(document.querySelectorAll('.plot')).at(-1).dataset.drawn !== undefined")
        assert_legible(page)
        page.emulate_media(color_scheme="dark")
        assert_legible(page)
        assert errors == []


def test_euler_angles_are_those_of_the_frames_module() -> None:
    generator = np.random.default_rng(5)
    attitudes = generator.normal(size=(200, 4))
    attitudes /= np.linalg.norm(attitudes, axis=1)[:, None]
    wanted = np.degrees([to_euler(attitude) for attitude in attitudes])
    assert np.allclose(euler_deg(attitudes), wanted)


def test_a_report_that_can_t_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    path = make(tmp_path, 1.0)
    with pytest.raises(FlightLogError, match="nowhere"):
        write(path, tmp_path / "nowhere" / "report.html")
    with pytest.raises(FlightLogError, match="missing"):
        write(tmp_path / "missing.mcap")


def test_what_never_moves_is_folded_and_says_where_it_stays(tmp_path: Path) -> None:
    flat = {chart.title: chart.flat for chart in compose(GatheredFlight(make(tmp_path, 4.0))).charts}
    assert flat["Position north"] == "" and flat["Height"] == "always wanted 3, is 3"
