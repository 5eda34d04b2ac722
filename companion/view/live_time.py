"""Which moment of a flight the live page shows: its slider, and playing on from there."""

import math
from typing import TYPE_CHECKING, Any

from companion.view.history import History
from companion.view.live_strip import STYLE, strip
from companion.view.sources import Source

if TYPE_CHECKING:
    import viser

QUIET_S = 3.0
"""The page says that a flight is silent if nothing new came for this long (s)."""
_STEP_S = 0.01
_SPEEDS = ("0.25x", "1x", "4x", "16x")


class Playback:
    """The moment that is shown, with its slider, and whether it follows the flight, plays or stands still."""

    def __init__(self, gui: "viser.GuiApi") -> None:
        """Put the controls into the folder that is open."""
        self.time = 0.0
        """The moment that is shown (s)."""
        self.quiet_s = 0.0
        """Time since anything new came, while more may come (s)."""
        self._following = True
        self._ended = False
        self._slid_to = 0.0
        """Where the slider was put by the page itself (s)."""
        self._heard_until = 0.0
        self._slider: Any = gui.add_slider("s", 0.0, 1.0, _STEP_S, 0.0)
        gui.add_html(STYLE)
        self._strip = gui.add_html("")
        self._play = gui.add_checkbox("play", True)
        self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1x")
        self._now = gui.add_button("now")
        self._now.on_click(lambda _: self._follow())
        self._play.on_update(lambda _: self._restart())

    def advance(self, seconds: float, history: History, source: Source, *, watched: bool) -> None:
        """Go on by `seconds`. Time goes on where nothing new comes: what was heard last grows old.

        The page stays behind a source by its delay, so that it moves evenly. `watched`: somebody looks; a log is not
        played before.
        """
        ended = source.ended
        self._ended = ended
        self.quiet_s = 0.0 if ended or history.end != self._heard_until else self.quiet_s + seconds
        self._heard_until = history.end
        # A time between two of the slider's steps would come back from it as another time.
        start = math.floor(100.0 * history.start) / 100.0
        end = max(math.ceil(100.0 * (history.end + self.quiet_s)) / 100.0, start + 0.1)
        if self._slider.max != end or self._slider.min != start:
            self._slider.min, self._slider.max = start, end
        if self._slider.value != self._slid_to:  # moved by a person
            self.time, self._following = float(self._slider.value), False
        elif self._play.value:
            if self._following and not ended:
                live = history.end + self.quiet_s
                self.time = min(max(self.time + seconds, live - source.delay_s), live)
            elif watched:
                self.time += seconds * float(self._speed.value.removesuffix("x"))
        self._now.visible = not ended and not (self._following and self._play.value)
        self.time = min(max(self.time, start), end)
        self._slider.value = self._slid_to = round(self.time, 2)

    def draw(self, history: History) -> None:
        """The strip below the slider."""
        warnings = [text.time for text in history.warnings()]
        rows = [history.phases(), history.modes()]
        self._strip.content = strip(rows, warnings, self._slider.min, self._slider.max, self.time)

    @property
    def is_quiet(self) -> bool:
        """Whether nothing new has come for QUIET_S."""
        return self.quiet_s > QUIET_S

    def words(self) -> str:
        """How the moment that is shown relates to the whole flight."""
        if self.is_quiet:
            return f", nothing new for {self.quiet_s:.0f} s"
        if self._following and self._play.value and not self._ended:
            return ", live"
        return f" of {self._slider.max:.1f} s"

    def _follow(self) -> None:
        self._following = self._play.value = True

    def _restart(self) -> None:
        """Playing a finished log at its end starts it from the beginning."""
        if self._play.value and self._ended and self.time >= self._slider.max:
            self.time = self._slider.min
