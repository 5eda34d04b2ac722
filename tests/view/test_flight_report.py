"""The report as a browser shows it: complete in one file, every chart drawn, no error; for our logs and for others'."""

import re
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.view.gather import Gathered
from companion.view.report import Page, compose, write
from protocol.flightlog import FlightLogError
from tests.view.browser import needs_chromium, opened
from tests.view.made_logs import from_tlog, make

SHOWS = """([start, stop]) => Array.from(document.querySelectorAll(".plot"))
  .filter(plot => plot.layout.shapes?.length).map(plot => plot.layout.xaxis.range)
  .every(range => Math.abs(range[0] - start) < 1e-6 && Math.abs(range[1] - stop) < 1e-6)"""
"""Whether every chart over time shows that stretch."""
DATA = Path(__file__).resolve().parent.parent / "data"


@needs_chromium
def test_the_report_opens_draws_every_chart_and_follows_a_look(tmp_path: Path) -> None:
    report = write(make(tmp_path, jump_at=15.0))
    assert report == tmp_path / "report.html"
    with opened(report.as_uri()) as (page, errors):
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
        assert flown == pytest.approx([2.0 * 19.996, 0.0], abs=0.05)
        obstacles = page.evaluate("document.querySelectorAll('.plot')[1].data.at(-1).i.length")
        assert obstacles == sum(len(solid.faces) for solid in compose(Gathered(tmp_path / "flight.mcap")).solids) // 3
        page.locator(".finding.warning button").first.click()
        page.wait_for_function(SHOWS, arg=[10.0, 20.0])
        page.locator("#whole").click()
        page.wait_for_function(SHOWS, arg=[0.0, 19.996])
        assert page.locator("#title").inner_text() == "made"
        assert errors == []


def test_nothing_is_fetched_from_elsewhere(tmp_path: Path) -> None:
    class Links(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.found: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.found += [value or "" for name, value in attrs if name in ("src", "href")]

    links = Links()
    links.feed(write(make(tmp_path, 1.0)).read_text(encoding="utf-8"))
    assert links.found == ["data:,"]


def test_a_text_of_the_vehicle_can_t_break_out_of_the_page(tmp_path: Path) -> None:
    fault = "</script><script>document.title = 'broken'</script><!--<script>"
    path = make(tmp_path, 1.0, result={"fault": fault, "landed": "False"})
    text = write(path).read_text(encoding="utf-8")
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert block is not None
    page = msgspec.json.decode(block[1].replace("<\\!--", "<!--"), type=Page)
    assert fault in page.findings[0].text


@pytest.mark.parametrize("name", ["px4_offboard", "ardupilot_guided"])
def test_flights_of_other_systems_are_reported_on(tmp_path: Path, name: str) -> None:
    """Recorded from PX4 and ArduCopter: what they flew is in the recordings' description."""
    path = from_tlog(DATA / f"{name}.tlog", tmp_path)
    flight = Gathered(path)
    page = compose(flight)
    titles = {chart.title for chart in page.charts}
    assert {"Height", "Roll", "Yaw rate", "Velocity down", "Thrust", "Battery voltage", "Body rates"} <= titles
    height = flight.lines["1/1/LOCAL_POSITION_NED:height"].points()[1]
    assert 3.0 < height.max() < 40.0
    assert len(page.ways) == 1
    said = [event.text for event in page.events]
    assert "armed" in said and "disarmed" in said
    assert "external control" in {band.name for band in page.bands}
    report = write(path)
    assert report.stat().st_size < 12_000_000


@needs_chromium
def test_a_report_of_another_system_draws(tmp_path: Path) -> None:
    report = write(from_tlog(DATA / "px4_offboard.tlog", tmp_path))
    with opened(report.as_uri()) as (page, errors):
        page.wait_for_selector(".plot[data-drawn]")
        last = page.locator(".plot").last
        last.scroll_into_view_if_needed()
        page.wait_for_function("Array.from(document.querySelectorAll('.plot')).at(-1).dataset.drawn !== undefined")
        assert errors == []


def test_euler_angles_are_those_of_the_frames_module() -> None:
    from companion.view.gather import euler_deg
    from protocol.frames import to_euler

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
