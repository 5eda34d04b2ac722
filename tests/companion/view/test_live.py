"""The live page: what it knows of a moment, that all sources tell it the same, and what a browser shows of it."""

import io
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page as Browser
from viser import ClientHandle

from companion.logs.recordings import newest
from companion.perception.distance_field import FAR_M
from companion.state import Reason
from companion.view.attitudes import quaternions, rotated
from companion.view.history import History, Moment
from companion.view.live import Page
from companion.view.live_scene import BEHIND, ahead, spaced
from companion.view.live_words import HIGHLIGHT, words
from companion.view.sources import GrowingLog, Link, Source, open_log
from protocol.arrays import Array
from protocol.flightlog import MAGIC, FlightLogError
from protocol.frames import from_euler, rotate
from protocol.messages import Encoder, dialect
from protocol.transport import Memory
from tests.companion.view.browser import assert_legible, needs_chromium, opened
from tests.companion.view.made_logs import SPEED, STEP_NS, Values, make, telemetry


def filled(source: Source) -> History:
    history = History()
    for batch in source.poll():
        history.take(batch)
    return history


def said(moment: Moment) -> str:
    return words(moment, "made", " of 20.0 s", None)


def test_a_moment_is_what_was_logged_at_that_time(tmp_path: Path) -> None:
    history = filled(open_log(make(tmp_path)))
    assert [history.start, history.end] == pytest.approx([0.0, 19.996])
    moment = history.at(7.5)
    assert moment.position_ned == pytest.approx([SPEED * 7.5, 0.0, -3.0], abs=0.05)
    assert moment.velocity_ned == pytest.approx([SPEED, 0.0, 0.0])
    assert moment.returns_frd == pytest.approx(np.array([[3.0 / math.sqrt(2.0), 3.0 / math.sqrt(2.0), 0.0]]))
    assert (moment.mode, moment.armed, moment.failsafe) == ("external control", True, False)
    plan = moment.plan
    assert plan is not None
    assert plan.reference_ned == pytest.approx([SPEED * 7.5 + 0.1, 0.0, -3.0], abs=0.01)
    assert (moment.phase, moment.state, plan.clearance) == ("route", "fly", 5.0)
    assert history.at(12.0).phase == "return"


def test_the_guard_s_intervention_is_seen_for_a_while_and_only_then(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        if 3.0 <= time < 3.1:
            values |= {"guard_reason": Reason.STOP.value, "guard_change": 1.5 + time}
            values["acceleration_command_ned"] = (-2.0, 0.5, 0.0)

    history = filled(open_log(make(tmp_path, 6.0, change=change)))
    for time, is_seen in ((2.9, False), (3.05, True), (3.5, True), (3.7, False)):
        plan = history.at(time).plan
        assert plan is not None and (plan.guard == "keeps room to stop") is is_seen
        text = said(history.at(time))
        assert ("keeps room to stop" in text) is is_seen and ("quiet" in text) is not is_seen
    plan = history.at(3.5).plan
    assert plan is not None
    assert plan.guard_change == pytest.approx(4.6, abs=0.01)
    assert plan.pushed_ned == pytest.approx([-2.0, 0.5, 0.0])


def test_the_planned_way_is_that_of_the_moment(tmp_path: Path) -> None:
    """From the vehicle over the corners, at the height of the target; straight to the target where none is planned."""
    around = [(3.9, 0.0), (4.0, 1.0), (8.0, 1.0), (12.0, 0.0)]
    history = filled(open_log(make(tmp_path, 6.0, planned=lambda time: around if 2.0 <= time < 4.0 else [])))
    for time, corners in ((1.5, 0), (3.0, 4), (5.0, 0)):
        moment = history.at(time)
        assert moment.plan is not None and moment.position_ned is not None and len(moment.plan.way_ned) == corners
        segments = ahead(moment.position_ned, moment.plan)
        assert segments.shape == (max(corners - 1, 1), 2, 3)
        assert segments[0, 0] == pytest.approx([0.0, SPEED * time, 3.0], abs=0.05)
        assert segments[:-1, 1] == pytest.approx(segments[1:, 0])
        if corners:
            assert segments[:, 1] == pytest.approx(np.array([(east, north, 0.0) for north, east in around[1:]]))


def test_a_path_is_drawn_by_points_along_its_length() -> None:
    """Wherever the vehicle flew slowly or stood."""
    north = np.concatenate((np.zeros(5000), np.linspace(0.0, 1.0, 5000), np.linspace(1.0, 300.0, 600)))
    path = np.column_stack((north, np.zeros((len(north), 2))))
    drawn = spaced(path)[:, 0]
    assert (drawn[0], drawn[-1]) == (0.0, 300.0) and len(drawn) < 620
    gaps = np.diff(drawn)
    assert gaps.min() > 0.0 and gaps.max() < 0.8
    assert len(spaced(path[:9000])) < 20 and len(spaced(path[:5000])) == 2
    assert len(spaced(path[:1])) == 1


def test_what_has_become_too_old_is_not_shown(tmp_path: Path) -> None:
    history = filled(open_log(make(tmp_path, silent=(5.0, 12.0))))
    assert history.at(5.5).position_ned is not None
    silent = history.at(9.0)
    assert silent.position_ned is None and len(silent.returns_frd) == 0
    assert silent.link_age == pytest.approx(4.02)
    assert "heard 4020 ms ago" in said(silent)
    assert history.at(12.5).position_ned is not None


def test_a_growing_log_gives_each_record_once_wherever_it_is_cut(tmp_path: Path) -> None:
    whole = make(tmp_path / "whole", 4.0)
    wanted = filled(open_log(whole))
    data = whole.read_bytes()
    growing = tmp_path / "growing.mcap"
    growing.write_bytes(data[: len(MAGIC)])
    source = GrowingLog(growing)
    history = History()
    for size in range(len(MAGIC), len(data) + 997, 997):
        growing.write_bytes(data[:size])
        for batch in source.poll():
            history.take(batch)
    assert source.ended
    assert source.world.startswith(b"# A street")
    assert (history.start, history.end) == (wanted.start, wanted.end)
    assert np.array_equal(history.path_ned(), wanted.path_ned())
    assert np.array_equal(history.reference_ned(), wanted.reference_ned())


def test_a_log_without_an_end_may_grow_if_it_was_written_to_lately_and_was_cut_off_otherwise(tmp_path: Path) -> None:
    path = make(tmp_path, 4.0)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    growing = open_log(path)
    assert isinstance(growing, GrowingLog)
    history = filled(growing)
    assert 0.5 < history.end < 4.0
    assert not growing.ended
    os.utime(path, (1.7e9, 1.7e9))
    cut = open_log(path)
    assert filled(cut).end == pytest.approx(history.end, abs=0.1)
    assert cut.ended and cut.problem is not None and "cut off" in cut.problem


def test_the_clearance_is_drawn_up_to_where_it_is_known(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        values["clearance"] = 1.5 if 2.0 <= time < 3.0 else math.inf

    times, clearance = filled(open_log(make(tmp_path, 5.0, change=change))).clearance(0.0, 5.0)
    near = (times > 2.01) & (times < 2.99)
    assert clearance[near] == pytest.approx(1.5)
    assert clearance[(times < 1.99) | (times > 3.01)] == pytest.approx(FAR_M)
    alone = filled(open_log(make(tmp_path / "alone", 5.0, traced=0.0)))
    assert alone.clearance(0.0, 5.0)[1] == pytest.approx(3.0), "the nearest return"


def test_a_damaged_log_is_said_to_be_damaged(tmp_path: Path) -> None:
    path = make(tmp_path, 4.0)
    data = bytearray(path.read_bytes()[:-8])
    mark = data.index(b"\x04\x00\x00\x00zstd")
    data[mark + 40 : mark + 60] = bytes(20)
    path.write_bytes(data)
    with pytest.raises(FlightLogError, match="damaged at byte"):
        list(GrowingLog(path).poll())


def test_a_link_shows_what_its_vehicle_says_and_says_nothing_itself() -> None:
    ours, theirs = Memory.pair()
    source = Link("memory", ours, b"")
    vehicle = Encoder(1, 1)
    history = History()
    for step in range(500):
        data = telemetry(vehicle, step, SPEED * step * STEP_NS * 1e-9)
        if data:
            theirs.send(data)
    for batch in source.poll():
        history.take(batch)
    moment = history.at(history.end)
    assert moment.position_ned == pytest.approx([SPEED * 1.98, 0.0, -3.0], abs=1e-5)
    assert moment.nearest == pytest.approx(3.0)
    assert moment.mode == "external control"
    assert theirs.receive(0.0) is None


def test_a_page_on_a_link_with_several_vehicles_shows_the_one_that_is_chosen() -> None:
    ours, theirs = Memory.pair()
    page = Page(Link("memory", ours, b""), 0)
    try:
        for system, north in ((7, 3.0), (9, 40.0)):
            vehicle = Encoder(system, 1)
            beat = (dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_PX4, 128, 6 << 16, 4, 3)
            theirs.send(vehicle.encode_fields(dialect.MAVLink_heartbeat_message, *beat))
            theirs.send(telemetry(vehicle, 0, north, (0.0, 0.0, 0.0), 1))
            for _ in range(20):
                page.step(0.01)
            assert page._chosen.visible is (system == 9), "there is nothing to choose between one"
        assert page._chosen.options == ("7/1", "9/1")
        for sender, north in (("9/1", 40.0), ("7/1", 3.0)):
            page._chosen.value = sender
            place = page.position_ned()
            assert place is not None and place[0] == pytest.approx(north)
    finally:
        page.stop()


def test_many_vectors_are_rotated_as_one_is() -> None:
    generator = np.random.default_rng(3)
    angles = generator.uniform(-1.5, 1.5, (50, 3))
    attitudes = quaternions(angles)
    vectors = generator.normal(size=(4, 3))
    for angle, attitude in zip(angles, attitudes, strict=True):
        assert attitude == pytest.approx(from_euler(*angle))
        for vector, result in zip(vectors, rotated(attitude, vectors), strict=True):
            assert result == pytest.approx(rotate(attitude, vector))


def test_the_newest_flight_is_found(tmp_path: Path) -> None:
    with pytest.raises(FlightLogError, match="no flight"):
        newest(tmp_path)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "flight.mcap").write_bytes(MAGIC)
    os.utime(tmp_path / "a" / "flight.mcap", (2e9, 2e9))
    assert newest(tmp_path).parent.name == "a"
    os.utime(tmp_path / "b" / "flight.mcap", (2.1e9, 2.1e9))
    assert newest(tmp_path).parent.name == "b"


def test_what_a_vehicle_says_can_t_become_part_of_the_page(tmp_path: Path) -> None:
    history = filled(open_log(make(tmp_path, 1.0)))
    text = words(history.at(0.5), "<b>", " <i>", "<script>")
    for tag in ("script", "b", "i"):
        assert f"<{tag}>" not in text and f"&lt;{tag}&gt;" in text


def test_time_goes_on_where_a_vehicle_falls_silent_and_the_page_says_so() -> None:
    ours, theirs = Memory.pair()
    live = Page(Link("memory", ours, b""), 0)
    vehicle = Encoder(1, 1)
    try:
        theirs.send(telemetry(vehicle, 0, 1.0))
        for _ in range(20):
            live.step(0.0)
        assert "heard 0 ms ago" in live.words.content and ", live" in live.words.content
        assert HIGHLIGHT not in live.words.content
        for _ in range(20):
            live.step(0.25)
        for _ in range(6):
            live.step(0.0)
        text = live.words.content
        assert "heard 5000 ms ago" in text and "nothing new for 5 s" in text and "north" not in text
        assert text.count(HIGHLIGHT) == 2, "the time and the link"
        theirs.send(telemetry(vehicle, 25, 1.0))
        for _ in range(6):
            live.step(0.0)
        assert ", live" in live.words.content
    finally:
        live.stop()


T = TypeVar("T")


def wait_for(look: Callable[[], T], is_right: Callable[[T], bool]) -> T:
    """What is seen, once it is right; each look takes its time."""
    for _ in range(200):
        seen = look()
        if is_right(seen):
            return seen
    raise AssertionError(f"never seen, but {seen}")


def returns_on(picture: bytes) -> NDArray[np.int64]:
    """Columns of the pixels that have the colour of the scan's returns and nothing else's."""
    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), np.int64), 2, 0)
    return np.nonzero((red > 200) & (green < 120) & (blue < 40))[1]


class Looked:
    """A page that is stepped by hand, in a browser: one that draws in software can't keep up with 20 pictures a
    second."""

    def __init__(self, live: Page, browser: Browser) -> None:
        self.live = live
        self.browser = browser

    def step(self, seconds: float = 0.0) -> None:
        self.live.step(seconds)
        for _ in range(20):  # the words and the paths take turns
            self.live.step(0.0)

    def waits_for(self, element: str, start: str) -> None:
        """Until an element's text begins so."""

        def read() -> str:
            self.step()
            return self.text(element)

        wait_for(read, lambda text: text.startswith(start))

    def go_to(self, time: str) -> None:
        """A whole second, by the slider."""
        slider = self.browser.locator("input[inputmode=decimal]").first
        slider.fill(time)
        slider.press("Enter")
        self.waits_for("#time", f"{time}.00 s")

    def show(self, tab: str) -> None:
        self.browser.get_by_role("tab", name=tab).click()

    def tick(self, label: str) -> None:
        self.browser.get_by_label(label, exact=True).evaluate("box => box.click()")

    def returns(self) -> NDArray[np.int64]:
        """`returns_on` the page once it is drawn as it is now: three frames later."""
        self.browser.evaluate("async () => { for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame); }")
        return returns_on(self.browser.screenshot())

    def text(self, element: str) -> str:
        return str(self.browser.locator(element).text_content())


SHOWN_AT_5 = {
    "#bar-phase": "route",
    "#bar-mode": "external control",
    "#bar-armed": "armed",
    "#bar-time": "5.0 s of 20.0 s",
    "#speed-value": "2.0",
    "#height-value": "3.0",
    "#climb-value": "+0.0",
    "#heading-value": "000°",
}
TURNED = np.array([7.0, -6.0, 4.0])
"""Where somebody has turned a camera to (m, east, north, up of the vehicle)."""
NORTH_8 = np.array([0.0, 8.0, 3.0])
"""Where the vehicle is after 4 s (m, east, north, up)."""
SIZES = ((1280, 720), (1920, 1080), (820, 1180))
UNTIDY = """async () => {
  await new Promise(requestAnimationFrame);
  const box = id => document.getElementById(id).getBoundingClientRect();
  const panel = document.querySelector('[role=tablist]').getBoundingClientRect();
  const notices = [...document.querySelectorAll('.mantine-Notification-root')].map(e => e.getBoundingClientRect());
  const side = new DOMRect(panel.x, 0, panel.width, innerHeight);
  const parts = [box('bar'), box('alerts'), box('pfd'), side, ...notices];
  const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
  const wrong = [];
  parts.forEach((a, i) => {
    if (a.left < 0 || a.top < 0 || a.right > innerWidth || a.bottom > innerHeight) wrong.push('outside ' + i);
    parts.slice(i + 1).forEach((b, k) => { if (!apart(a, b)) wrong.push(`${i} on ${i + 1 + k}`); });
  });
  for (const e of document.querySelectorAll('*'))
    if (e.scrollHeight > e.clientHeight + 1 && ['auto', 'scroll'].includes(getComputedStyle(e).overflowY))
      wrong.push('scrolls: ' + e.className);
  return wrong;
}"""


def away_of(client: ClientHandle) -> Array:
    """(3,) from what a camera looks at to the camera (m, east, north, up)."""
    away: Array = client.camera.position - client.camera.look_at
    return away


def is_at(reported: list[Array], place: Array) -> bool:
    """Whether a place (3,) is what the browser has said last of its camera."""
    return bool(reported) and np.allclose(reported[-1], place, atol=0.1)


def turn(client: ClientHandle, away: Array) -> None:
    """Put a camera `away` (3,) from what it looks at (m, east, north, up)."""
    look_at = client.camera.look_at
    with client.atomic():
        client.camera.position = look_at + away
        client.camera.look_at = look_at  # which the line above has moved along


def assert_tidy(looked: Looked) -> None:
    """Each tab at each size: nothing is outside, on top of another thing, or to be scrolled to."""
    for width, height in SIZES:
        looked.browser.set_viewport_size({"width": width, "height": height})
        for tab in ("Flight", "Said", "Charts", "View"):
            looked.show(tab)
            wait_for(lambda: looked.browser.evaluate(UNTIDY), lambda wrong: wrong == [])


@pytest.fixture
def looked(tmp_path: Path) -> Iterator[Looked]:
    """A log of 20 s, silent from 12 to 16 s, played from the moment when somebody looks."""
    live = Page(open_log(make(tmp_path, silent=(12.0, 16.0))), 0)
    try:
        live.step(2.0)
        assert live.playback.time == 0.0, "it waits for somebody to look"
        with opened(live.url) as (browser, errors):
            wait_for(lambda: (browser.screenshot(), live.cameras.watched)[1], bool)
            yield Looked(live, browser)
            assert errors == []
    finally:
        live.stop()


@needs_chromium
def test_a_camera_follows_the_vehicle_from_where_it_was_put(looked: Looked) -> None:
    """From behind at first, from above if asked, and from wherever somebody has turned it to."""
    page, live = looked.browser, looked.live
    looked.step(2.0)
    looked.waits_for("#place", "north 4.0")
    looked.step(1.0)
    looked.waits_for("#place", "north 6.0")
    (client,) = live._server.get_clients().values()
    away = np.linalg.norm(BEHIND)
    reports: list[Array] = []
    client.camera.on_update(lambda camera: reports.append(camera.position - camera.look_at))
    wait_for(  # the page tells where its camera is and what it looks at one after the other
        lambda: (page.screenshot(), (client.camera.look_at, client.camera.position))[1],
        lambda seen: (
            np.allclose(seen[0], (0.0, 6.0, 3.0), atol=0.05)
            and bool(np.linalg.norm(seen[1] - seen[0]) == pytest.approx(away, rel=0.05))
        ),
    )
    looked.show("View")
    looked.tick("camera follows")
    looked.tick("map from above")
    (down,) = wait_for(lambda: (page.screenshot(), reports[-1:])[1], lambda last: bool(last) and last[0][2] > 1e3)
    assert abs(down[:2]).max() < 1.0 and client.camera.fov < 0.1
    looked.tick("map from above")
    wait_for(lambda: (page.screenshot(), reports[-1:])[1], lambda last: is_at(last, BEHIND))
    turn(client, TURNED)  # as by a hand, while the vehicle stands
    wait_for(lambda: (page.screenshot(), reports[-1:])[1], lambda last: is_at(last, TURNED))
    looked.tick("camera follows")
    looked.step(1.0)
    looked.waits_for("#place", "north 8.0")

    def seen_after_a_step() -> tuple[Array, Array]:
        looked.step()
        page.screenshot()
        return client.camera.look_at, away_of(client)

    wait_for(
        seen_after_a_step,
        lambda seen: np.allclose(seen[0], (0.0, 8.0, 3.0), atol=0.05) and np.allclose(seen[1], TURNED, atol=0.1),
    )


@needs_chromium
def test_the_page_moves_the_vehicle_draws_the_scan_and_obeys_the_slider(looked: Looked) -> None:
    """And begins again when a log is played at its end."""
    page = looked.browser
    (client,) = looked.live._server.get_clients().values()
    reports: list[Array] = []
    client.camera.on_update(lambda camera: reports.append(camera.position))
    for place in ("north 4.0", "north 8.0"):
        looked.step(2.0)
        looked.waits_for("#place", place)
    looked.show("View")
    looked.tick("camera follows")
    with client.atomic():
        client.camera.position, client.camera.look_at = NORTH_8 + BEHIND, NORTH_8
    wait_for(lambda: (page.screenshot(), reports[-1:])[1], lambda last: is_at(last, NORTH_8 + BEHIND))
    looked.show("Flight")
    looked.tick("play")
    looked.go_to("5")
    assert page.title() == "Courier"
    for element, text in SHOWN_AT_5.items():
        assert looked.text(element) == text
    assert looked.text("#place") == "north 10.0, east 0.0, height 3.0 m"
    assert looked.text("#phase") == "route"
    first = wait_for(looked.returns, lambda found: len(found) > 10)
    looked.go_to("6")
    assert looked.text("#place") == "north 12.0, east 0.0, height 3.0 m"
    wait_for(looked.returns, lambda found: len(found) > 5 and bool(abs(found.mean() - first.mean()) > 3.0))
    looked.go_to("15")
    assert looked.text("#alerts") == "link lost: nothing heard for 3 s"
    assert page.locator("#place, #speed-value, #height-value, #heading-value").count() == 0
    assert looked.text("#phase") == "return"
    wait_for(looked.returns, lambda found: len(found) == 0)
    looked.go_to("19")
    looked.tick("play")
    looked.waits_for("#time", "19.00 s of 20.0 s")
    looked.step(5.0)
    looked.waits_for("#time", "20.00 s")
    for _ in range(2):  # off, and on again
        looked.tick("play")
        looked.step()
    looked.waits_for("#time", "0.00 s")
    looked.show("Charts")
    assert page.locator(".uplot").count() == 3
    assert_tidy(looked)
    for tab in ("Flight", "View"):
        looked.show(tab)
        assert_legible(page)
