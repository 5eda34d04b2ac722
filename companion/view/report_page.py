"""What the report's page draws, as records: the JSON that its script reads (report_page.html)."""

import base64

import msgspec
import numpy as np

from companion.view.events import Event
from companion.view.finding import Finding
from companion.view.lines import Floats

BLUE, RED, GREEN, AMBER, VIOLET, TEAL, GREY = (
    "#3b7ddd",
    "#d64560",
    "#4c9f50",
    "#d08a1d",
    "#8a5cc9",
    "#1f9e9e",
    "#8b8b93",
)


def packed(values: Floats) -> str:
    """Numbers (m,) as base64 of little-endian float32."""
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


def unpacked(text: str) -> Floats:
    """The numbers (m,) of `packed`."""
    return np.frombuffer(base64.b64decode(text), "<f4")


class Curve(msgspec.Struct, frozen=True):
    """One line of a chart; x and y are `packed`."""

    name: str
    color: str
    x: str
    y: str
    dash: str = "solid"


class Chart(msgspec.Struct, frozen=True):
    """One chart. `kind`: "time" (x is s), "xy", "log" (both axes), "bars", "bars-log", "ring" (a LiDAR's scans)."""

    section: str
    title: str
    unit: str
    curves: tuple[Curve, ...]
    kind: str = "time"
    x_unit: str = "s"
    values: str = ""
    """The ranges of scans, `packed`, a row for each bearing."""
    flat: str = ""
    """Nothing in it ever moves: what it stays at, in words. It is shown folded."""


class Solid(msgspec.Struct, frozen=True):
    """An obstacle (m, east, north, up): its outline from above, and the flat corners and triangles of its mesh."""

    name: str
    east: tuple[float, ...]
    north: tuple[float, ...]
    corners: tuple[float, ...]
    faces: tuple[int, ...]
    height: float


class Way(msgspec.Struct, frozen=True):
    """A path (m, east, north, up) and the time (s) of each point; all of them are `packed`."""

    name: str
    color: str
    east: str
    north: str
    up: str
    time: str
    dash: str = "solid"


class Band(msgspec.Struct, frozen=True):
    """A stretch of time (s) that is shaded in the charts."""

    start: float
    stop: float
    name: str
    color: str


class Row(msgspec.Struct, frozen=True):
    """One topic of the log: its records, their mean rate (Hz), their usual and longest interval (ms), and the last of
    them in words."""

    topic: str
    count: int
    rate: float
    usual_ms: float
    longest_ms: float
    last: str


class Page(msgspec.Struct, frozen=True):
    """Everything that the page's script draws."""

    title: str
    subtitle: str
    tiles: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]
    events: tuple[Event, ...]
    begin: float
    end: float
    bands: tuple[Band, ...]
    charts: tuple[Chart, ...]
    solids: tuple[Solid, ...]
    ways: tuple[Way, ...]
    topics: tuple[Row, ...]
    changed: tuple[tuple[str, str, str], ...]
    """Settings: key, as flown, default."""
    parameters: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
