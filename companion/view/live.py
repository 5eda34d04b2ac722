"""`companion view`: a flight in the browser while it is flown, or again from its log, drawn by viser (three.js).

The page runs in a process of its own and only reads: the log, as it grows, or a link of its own.
"""

import threading
import webbrowser
from collections.abc import Callable

from companion.logs.recordings import printable
from companion.view.control import Control, Panel
from companion.view.door import LOOPBACK, Door
from companion.view.history import History, Moment
from companion.view.lines import Floats
from companion.view.live_charts import Charts
from companion.view.live_hud import PANEL_PX, STYLE, alerts, hud
from companion.view.live_scene import LEGEND, Cameras, MapLayer, Stage
from companion.view.live_time import Playback
from companion.view.live_words import legend, said, words
from companion.view.sources import Source
from protocol.clock import RealClock
from protocol.flightlog import FlightLogError
from protocol.transport import TransportError

_FRAME_NS = 1_000_000_000 // 32
"""Time between two pictures of the vehicle and its instruments: 30 a second come to the page though some are late."""
_WORDS_EVERY, _MAP_EVERY, _PATHS_EVERY = 6, 15, 20
"""One picture in so many has new words and charts, a new map, new paths."""


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
        self._server = door.open(port, "Courier")
        self.wanted_port = port
        self.port: int = self._server.get_port()
        self.url = f"http://{door.address}:{self.port}/{door.token}/"
        """Where the page is, with its controls; without the token one looks on."""
        self.stage = Stage(self._server.scene)
        self._map = MapLayer(self._server.scene)
        self.cameras = Cameras(self._server)
        gui = self._server.gui
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        gui.set_panel_label("Courier")
        gui.add_html(STYLE)
        self.hud = gui.add_html("")
        hint = "system/component of the one that is shown, and that buttons command"
        self._chosen = gui.add_dropdown("vehicle", ("",), visible=False, hint=hint)
        self._chosen.on_update(lambda _: self._choose())
        with gui.add_folder("Time"):
            self.playback = Playback(gui)
        self._panel: Panel | None = None
        if control is not None:
            self._panel = Panel(self._server, control, self.position_ned, lambda: source.world)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Flight"):
            self.words = gui.add_html("")
        with tabs.add_tab("Said"):
            self._said = gui.add_html("")
        with tabs.add_tab("Charts"):
            self._charts = Charts(gui)
        with tabs.add_tab("View"):
            self._chase = gui.add_checkbox("camera follows", True)
            self._flat = gui.add_checkbox("map from above", False)
            self._map_shown = gui.add_checkbox("map", True, hint="what the vehicle knows of free and occupied space")
            gui.add_html(legend(LEGEND))
        self._flat.on_update(lambda _: self._flatten())

    def run(self) -> None:
        """Serve until `stop` or an interrupt."""
        before_ns = due_ns = self._clock.now_ns()
        while not self._stop.wait(max(due_ns - self._clock.now_ns(), 0) * 1e-9):
            now_ns = self._clock.now_ns()
            self.step((now_ns - before_ns) * 1e-9)
            before_ns, due_ns = now_ns, max(due_ns + _FRAME_NS, now_ns)

    def stop(self) -> None:
        """End `run` and the server."""
        self._stop.set()
        self._server.stop()

    def step(self, seconds: float) -> None:
        """Take in what is new and draw the moment that is due `seconds` after the last one."""
        self._listen()
        self.playback.advance(seconds, self.history, self._source, watched=self.cameras.watched)
        moment = self.history.at(self.playback.time)
        with self._server.atomic():
            self._draw(moment)
        self._server.flush()  # otherwise it waits for windows of 17 ms
        self._frame += 1

    def _listen(self) -> None:
        """Take in what is new, and send what is due. Of a log that is damaged or a link that is gone the page goes on
        to show what was heard."""
        try:
            for batch in self._source.poll():
                self.history.take(batch)
                if self._control is not None:
                    self._control.take(batch)
            if self._control is not None:
                self._control.step()
        except (FlightLogError, TransportError) as error:
            self._problem = str(error)

    def _choose(self) -> None:
        """Show another vehicle of the link, and command that one."""
        self.history.shown = self._chosen.value
        self._map.forget()
        if self._control is not None:
            self._control.choose(self._chosen.value)

    def _flatten(self) -> None:
        flat = bool(self._flat.value)
        self.cameras.flatten(flat=flat)
        self.stage.flatten(flat=flat)

    def _draw(self, moment: Moment) -> None:
        """The vehicle, and in turns what changes more slowly or costs more."""
        if moment.position_ned is not None:
            self.cameras.follow(moment.position_ned, moving=bool(self._chase.value))
        self.stage.draw(moment)
        self._draw_hud(moment)
        if self._frame % _WORDS_EVERY == 0:
            self._draw_words(moment)
            self._charts.draw(self.history, moment.time)
        if self._frame % _MAP_EVERY == 0:
            self._map.draw(self.history, self._source.settings, moment.time, visible=bool(self._map_shown.value))
        if self._frame % _PATHS_EVERY == 0:
            self.stage.draw_world(self._source.world)
            self.stage.fade(self.cameras.eye(), moment.position_ned)
            self.stage.draw_paths(self.history)

    def _draw_hud(self, moment: Moment) -> None:
        is_over = self._source.ended and moment.time >= self.history.end
        found = alerts(moment, self._trouble, self._source.verdict if is_over else None)
        self.hud.content = hud(moment, f"{moment.time:.1f} s{self.playback.words()}", found)

    def _draw_words(self, moment: Moment) -> None:
        playback, verdict, when = self.playback, self._source.verdict, self.playback.words()
        self.words.content = words(
            moment, printable(self._source.name), when, self._trouble, verdict, quiet=playback.is_quiet
        )
        self._said.content = said(moment)
        playback.draw(self.history)
        if len(self.history.vehicles) > 1 and self._chosen.options != self.history.vehicles:
            self._chosen.options, self._chosen.visible = self.history.vehicles, True
        if self._panel is not None:
            self._panel.show()

    @property
    def _trouble(self) -> str | None:
        problem = self._problem or self._source.problem
        return None if problem is None else printable(problem)

    def position_ned(self) -> Floats | None:
        """Where the vehicle is now (3,) in m, whatever moment is shown; None if that is not known."""
        return self.history.at(self.history.end).position_ned


def serve(page: Page, say: Callable[[str], None], *, opens: bool) -> None:
    """Say where the page is, open a browser there if it `opens`, and serve it until an interrupt."""
    taken = f" ({page.wanted_port} is in use)" if page.wanted_port not in (0, page.port) else ""
    say(f"view: {page.url}{taken}")
    if opens:
        webbrowser.open(page.url)
    try:
        page.run()
    except KeyboardInterrupt:
        page.stop()
