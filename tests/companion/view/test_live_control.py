"""The page's buttons, clicked in a browser, and what a simulated vehicle in a process of its own makes of them."""

import re
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from playwright.sync_api import Page as Browser
from playwright.sync_api import expect

from companion.view.control import Control
from companion.view.lines import Floats
from companion.view.live import Page
from companion.view.sources import Link
from protocol.clock import RealClock
from protocol.frames import rotate
from protocol.messages import Encoder, dialect
from protocol.toml_files import find
from protocol.transport import Udp
from tests.companion.view.browser import PATIENCE_MS, assert_legible, needs_chromium, opened
from tests.flights.processes import Process
from vehicle_sim.airframe import Airframe

AIRFRAME = Airframe.load(find("vehicles", "paper_quad"))
HOVER = AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n
expect.set_options(timeout=PATIENCE_MS)
SETPOINT_S = 0.05
PICTURE_S = 0.3
"""A browser that draws in software can't keep up with more."""


class Watched:
    """A page on a simulator over UDP, and the setpoints of a companion that would hover, each in its thread."""

    def __init__(self) -> None:
        self._transport = Udp("127.0.0.1", 0, bind=True)
        self.address = f"127.0.0.1:{self._transport.port}"
        self.control = Control(self._transport.send, RealClock().now_ns)
        self.page = Page(Link(self.address, self._transport, b""), 0, control=self.control)
        self._stepped = threading.Condition()
        self._ends = threading.Event()
        self._threads = [threading.Thread(target=run) for run in (self._watch, self._stream)]

    def __enter__(self) -> "Watched":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        for thread in self._threads:
            thread.join()
        self.page.stop()
        self._transport.close()

    def _watch(self) -> None:
        while not self._ends.wait(PICTURE_S):
            with self._stepped:
                self.page.step(PICTURE_S)
                self._stepped.notify_all()

    def _stream(self) -> None:
        companion = Encoder(1, 191)
        level = (0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, HOVER)
        while not self._ends.wait(SETPOINT_S):
            self._transport.send(companion.encode_fields(dialect.MAVLink_set_attitude_target_message, *level))

    def until(self, is_right: Callable[[], bool]) -> None:
        """Wait until something holds after a step of the page."""
        with self._stepped:
            assert self._stepped.wait_for(is_right, PATIENCE_MS * 1e-3), (self.mode, self.place, self.control.answer)

    @property
    def mode(self) -> str:
        return self.page.history.at(self.page.history.end).mode

    @property
    def place(self) -> Floats:
        place = self.page.position_ned()
        return np.full(3, np.nan) if place is None else place

    def take_off(self) -> None:
        """By another ground station."""
        self.until(lambda: self.mode == "hold" and self.page.history.end - self.page.history.start > 1.5)
        other = Encoder(254, 190)
        for command, first in ((dialect.MAV_CMD_NAV_TAKEOFF, np.nan), (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)):
            fields = (1, 1, command, 0, first, 0.0, 0.0, *(np.nan,) * 4)
            self._transport.send(other.encode_fields(dialect.MAVLink_command_long_message, *fields))
        self.until(lambda: self.mode == "hold" and bool(self.place[2] < -2.3))


@pytest.fixture
def watched() -> Iterator[Watched]:
    with (
        Watched() as watched,
        Process("vehicle_sim", ("--bind", f"udpout:{watched.address}", "--world", "empty")),
    ):
        yield watched


def click(browser: Browser, name: str) -> None:
    """A button, once it is there. Its own event: the mouse would wait for pictures that are slow to come."""
    browser.get_by_role("button", name=name, exact=True).evaluate("button => button.click()")


def confirm(browser: Browser, name: str) -> None:
    click(browser, name)
    expect(browser.get_by_text(f"Ask the vehicle to {name}?")).to_be_visible()
    click(browser, f"yes, {name}")


def under_the_pixel(watched: Watched, x: float, y: float, width: float, height: float) -> Floats:
    """North and east of the ground at a pixel, by the camera's own pose: right, down, forward are its axes."""
    (client,) = watched.page._server.get_clients().values()
    camera = client.camera
    focal = 0.5 * height / np.tan(0.5 * camera.fov)
    ray = rotate(camera.wxyz, np.array([(x - 0.5 * width) / focal, (y - 0.5 * height) / focal, 1.0]))
    place = camera.position - camera.position[2] / ray[2] * ray
    return np.array([place[1], place[0]])


def resume(watched: Watched, browser: Browser) -> None:
    """Tried again where the machine was too busy for a stream of setpoints without gaps."""
    for _ in range(3):
        confirm(browser, "resume")
        watched.until(
            lambda: watched.control.answer.startswith("resume") and not watched.control.answer.endswith("sent")
        )
        if watched.control.answer == "resume: accepted":
            return


def go_to_a_place(watched: Watched, browser: Browser) -> None:
    """Click on the ground; the place that is named is the one under the pixel, and the vehicle flies there."""
    canvas = browser.locator("canvas").first.bounding_box()
    assert canvas is not None
    x, y = 0.75 * canvas["width"], 0.45 * canvas["height"]
    browser.mouse.click(canvas["x"] + x, canvas["y"] + y)
    title = browser.get_by_text(re.compile("Go to north"))
    expect(title).to_be_visible()
    named = [float(number) for number in re.findall(r"-?\d+\.\d", title.inner_text())]
    assert named == pytest.approx(under_the_pixel(watched, x, y, canvas["width"], canvas["height"]), abs=0.1)
    assert np.linalg.norm(named - watched.place[:2]) > 3.0
    height = browser.get_by_label("height, m")
    height.fill("4.5")
    height.press("Enter")
    expect(browser.get_by_text("4.5 m high")).to_be_visible()
    click(browser, "yes, go to")
    target = np.array([*named, -4.5])
    watched.until(lambda: bool(np.linalg.norm(watched.place - target) < 0.3))
    assert watched.mode == "hold"
    assert watched.control.answer.startswith("go to north") and watched.control.answer.endswith("accepted")


@needs_chromium
def test_each_button_reaches_the_vehicle(watched: Watched) -> None:
    with opened(watched.page.url, fine=0.4) as (browser, errors):
        browser.get_by_role("tab", name="View").click()
        browser.get_by_label("camera follows", exact=True).evaluate("box => box.click()")
        browser.get_by_role("tab", name="Flight").click()
        watched.take_off()
        mode = browser.locator("#mode")
        expect(mode).to_have_text("hold, armed")

        resume(watched, browser)
        expect(mode).to_have_text("external control, armed")
        confirm(browser, "hold")
        expect(mode).to_have_text("hold, armed")

        for request in ("return", "land"):
            click(browser, request)
            expect(browser.get_by_text(f"Ask the vehicle to {request}?")).to_be_visible()
            if request == "land":
                assert_legible(browser)
            click(browser, "no")
            expect(browser.get_by_text("Ask the vehicle to")).to_have_count(0)
        assert watched.control.answer == "hold: accepted", "a no sends nothing"

        aims = browser.get_by_text("click on the ground")
        click(browser, "go to …")
        expect(aims).to_be_visible()
        expect(browser.get_by_text("hold: accepted")).to_be_visible()
        click(browser, "go to …")
        expect(aims).to_have_count(0)
        click(browser, "go to …")
        expect(aims).to_be_visible()
        click(browser, "land")
        expect(aims).to_have_count(0)
        click(browser, "no")
        click(browser, "go to …")
        expect(aims).to_be_visible()
        go_to_a_place(watched, browser)

        shown = browser.locator("#time")
        play = browser.get_by_label("play", exact=True)
        play.evaluate("box => box.click()")  # it stands still, and nobody moves the slider but the test
        expect(browser.get_by_role("button", name="now", exact=True)).to_be_visible()
        slider = browser.locator("input[inputmode=decimal]").first
        past = round(watched.page.history.start) + 3
        slider.fill(str(past))
        slider.press("Enter")
        expect(shown).to_have_text(re.compile(rf"^{past}\.00 s of \d+\.\d s$"))
        play.evaluate("box => box.click()")
        expect(shown).to_have_text(re.compile(rf"^({past + 1}|{past + 2}|{past + 3})\.\d\d s"))
        click(browser, "now")
        watched.until(lambda: watched.page.playback.time == watched.page.history.end)
        assert errors == []
