"""`companion view`: a flight in the browser while it is flown, or again from its log, drawn by viser (three.js).

The page runs in a process of its own and only reads: the log, as it grows, or a link of its own.
"""

import threading
from collections.abc import Callable

from companion.view.control import Control, Panel
from companion.view.door import LOOPBACK, Door
from companion.view.history import History, Moment
from companion.view.lines import Floats
from companion.view.live_charts import Charts
from companion.view.live_scene import Cameras, MapLayer, Stage
from companion.view.live_time import Playback
from companion.view.live_words import words
from companion.view.sources import Source
from protocol.clock import RealClock
from protocol.flightlog import FlightLogError

FRAME_S = 0.05
"""Time between two pictures of the vehicle (s). Words and charts are drawn with every fifth of them."""
_WORDS_EVERY, _MAP_EVERY, _PATHS_EVERY = 5, 10, 20


class Page:
    """The server of a page, and what the page shows of a source.

    `control`: what the page's buttons send; None for a page that only shows.
    """

    def __init__(self, source: Source, port: int, address: str = LOOPBACK, control: Control | None = None) -> None:
        """Serve at a port of an IPv4 address; 0 is any, and another one is taken if it is in use."""
        self._source = source
        self._control = control
        self.history = History()
        self._clock = RealClock()
        self._stop = threading.Event()
        self._frame = 0
        self._problem: str | None = None
        door = Door(address)
        self._server = door.open(port, f"Courier · {source.name}")
        self.wanted_port = port
        self.port: int = self._server.get_port()
        self.url = f"http://{door.address}:{self.port}/{door.token}/"
        """Where the page is, with its controls; without the token one looks on."""
        self.stage = Stage(self._server.scene)
        self._map = MapLayer(self._server.scene)
        self.cameras = Cameras(self._server)
        gui = self._server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label("Courier")
        with gui.add_folder("Time"):
            self.playback = Playback(gui)
            self._chase = gui.add_checkbox("camera follows", True)
            self._map_shown = gui.add_checkbox("map", True)
        self.words = gui.add_html("")
        self._panel: Panel | None = None
        if control is not None:
            self._panel = Panel(self._server, control, self.position_ned, lambda: source.world)
        self._charts = Charts(gui)

    def run(self) -> None:
        """Serve until `stop` or an interrupt."""
        before_ns = self._clock.now_ns()
        while not self._stop.wait(FRAME_S):
            now_ns = self._clock.now_ns()
            self.step((now_ns - before_ns) * 1e-9)
            before_ns = now_ns

    def stop(self) -> None:
        """End `run` and the server."""
        self._stop.set()
        self._server.stop()

    def step(self, seconds: float) -> None:
        """Take in what is new and draw the moment that is due `seconds` after the last one."""
        self._read()
        if self._control is not None:
            self._control.step()
        self.playback.advance(seconds, self.history, ended=self._source.ended, watched=self.cameras.watched)
        moment = self.history.at(self.playback.time)
        with self._server.atomic():
            self._draw(moment)
        self._frame += 1

    def _read(self) -> None:
        try:
            for batch in self._source.poll():
                self.history.take(batch)
                if self._control is not None:
                    self._control.take(batch)
        except FlightLogError as error:
            self._problem = str(error)

    def _draw(self, moment: Moment) -> None:
        """The vehicle, and in turns what changes more slowly or costs more."""
        if moment.position_ned is not None:
            self.cameras.follow(moment.position_ned, moving=bool(self._chase.value))
        self.stage.draw(moment)
        if self._frame % _WORDS_EVERY == 0:
            self._draw_words(moment)
            self._charts.draw(self.history, moment.time)
        if self._frame % _MAP_EVERY == 0:
            self._map.draw(self.history, self._source.settings, moment.time, visible=bool(self._map_shown.value))
        if self._frame % _PATHS_EVERY == 0:
            self.stage.draw_world(self._source.world)
            self.stage.draw_paths(self.history)

    def _draw_words(self, moment: Moment) -> None:
        playback, problem = self.playback, self._problem or self._source.problem
        verdict, when = self._source.verdict, playback.words()
        self.words.content = words(moment, self._source.name, when, problem, verdict, quiet=playback.is_quiet)
        if self._panel is not None:
            self._panel.show()

    def position_ned(self) -> Floats | None:
        """Where the vehicle is now (3,) in m, whatever moment is shown; None if that is not known."""
        return self.history.at(self.history.end).position_ned


def serve(page: Page, say: Callable[[str], None]) -> None:
    """Say where the page is, and serve it until an interrupt."""
    taken = f" ({page.wanted_port} is in use)" if page.wanted_port not in (0, page.port) else ""
    say(f"view: {page.url}{taken}")
    try:
        page.run()
    except KeyboardInterrupt:
        page.stop()
