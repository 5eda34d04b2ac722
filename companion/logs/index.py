"""A list of the logs in a folder with their results, from an index that is updated where it is stale.

The index is in the user's cache: a folder that is listed is not written to.
"""

import contextlib
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np

from companion.known_topics import is_foreign
from companion.logs.info import Info, info
from companion.logs.recordings import FARTHEST_M, is_export, printable
from companion.logs.target import DRAFTS, output
from companion.logs.traffic import open_traffic
from companion.records import TRACE
from companion.runtime.summary import summarize
from protocol.flightlog import Direction, FlightLogError, LogReader
from protocol.messages import decode, dialect

_VERSION = 4
_SUFFIXES = frozenset((".mcap", ".tlog"))


class Row(msgspec.Struct, frozen=True):
    """One log in the list; None for what it doesn't say."""

    log: str
    """Path relative to the folder that is listed."""
    started_unix_s: float | None
    mission: str | None
    result: str
    """The word of an outcome, or "unreadable"; "recorded" for another system's log."""
    duration_s: float
    distance_m: float | None
    clearance_m: float | None
    """Least distance from the hull to a return of the LiDAR, in flight."""
    faults: tuple[str, ...]

    def table(self) -> dict[str, object]:
        """Names and values for JSON."""
        return msgspec.structs.asdict(self)

    def cells(self) -> tuple[str, ...]:
        """Texts for a table."""
        date = "-"
        if self.started_unix_s is not None:
            date = datetime.fromtimestamp(self.started_unix_s).strftime("%Y-%m-%d %H:%M:%S")
        numbers = (f"{self.duration_s:.1f}", _text(self.distance_m, 1), _text(self.clearance_m, 2))
        return (self.log, date, self.mission or "-", self.result, *numbers, "; ".join(self.faults) or "-")


class _Entry(msgspec.Struct, frozen=True):
    size: int
    changed_ns: int
    row: Row


class _Index(msgspec.Struct, frozen=True):
    version: int
    entries: dict[str, _Entry]


def listing(folder: Path) -> list[Row]:
    """All logs in the folder and its subfolders, the newest first. Raises FlightLogError if it isn't a folder, or can't
    be looked into."""
    try:
        next(folder.iterdir(), None)
    except OSError as error:
        raise FlightLogError(f"{printable(folder)}: {error.strerror}") from error
    index = index_of(folder)
    known = _read(index)
    entries: dict[str, _Entry] = {}
    for path in _logs(folder):
        name = printable(path.relative_to(folder))
        with contextlib.suppress(OSError):  # gone meanwhile
            state = path.stat()
            entry = known.get(name)
            if entry is None or (entry.size, entry.changed_ns) != (state.st_size, state.st_mtime_ns):
                entry = _Entry(state.st_size, state.st_mtime_ns, describe(path, name))
            entries[name] = entry
    if entries != known:
        _write(index, entries)
    return sorted((entry.row for entry in entries.values()), key=lambda row: (-(row.started_unix_s or 0.0), row.log))


def index_of(folder: Path) -> Path:
    """Where the index of a folder is: under the digest of its path."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    with contextlib.suppress(RuntimeError):  # a user without a home, for whom nothing is kept
        cache = cache.expanduser()
    digest = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:16]
    return cache / "courier" / "logs" / f"{digest}.json"


def _logs(folder: Path) -> Iterator[Path]:
    """Paths of recordings, without exports of them and without drafts."""
    for path in sorted(folder.rglob("*")):
        with contextlib.suppress(OSError):
            draft = any(part.startswith(DRAFTS) for part in path.relative_to(folder).parts)
            if path.suffix in _SUFFIXES and not draft and path.is_file() and not is_export(path):
                yield path


def _read(path: Path) -> dict[str, _Entry]:
    """The index's entries; empty if there is no index, or one that is damaged or of another version."""
    with contextlib.suppress(OSError, msgspec.DecodeError):
        index = msgspec.json.decode(path.read_bytes(), type=_Index)
        if index.version == _VERSION:
            return index.entries
    return {}


def _write(path: Path, entries: dict[str, _Entry]) -> None:
    """Write the index, whole or not at all; without a cache there is none."""
    with contextlib.suppress(FlightLogError, OSError):
        if not path.is_absolute():
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        with output(path, replaces=True) as draft:
            draft.write_bytes(msgspec.json.encode(_Index(_VERSION, entries)))


def describe(path: Path, name: str) -> Row:
    """One log's row; that of a log that can't be read says so."""
    try:
        found = info(path)
        distance, clearance = _flown(found)
    except Exception as error:  # what nobody foresaw in one log must not hide all the others
        return Row(name, None, None, "unreadable", 0.0, None, None, (printable(error or type(error).__name__),))
    problem = (printable(found.problem.removeprefix(f"{path}: ")),) if found.problem else ()
    verdict = found.verdict
    fault = () if verdict is None or not verdict.cause else (verdict.cause,)
    return Row(
        log=name,
        started_unix_s=found.started_unix_s,
        mission=found.flight.get("mission"),
        result="recorded" if verdict is None else verdict.outcome.value,
        duration_s=round(found.duration_s, 3),
        distance_m=distance,
        clearance_m=clearance,
        faults=(*fault, *problem),
    )


def _flown(found: Info) -> tuple[float | None, float | None]:
    """Distance flown and least clearance (m), from the companion's trace or else from the vehicle's positions. Raises
    FlightLogError for a record that is not as its schema says."""
    trace = LogReader(found.path).topics.get(TRACE.topic) if TRACE.topic in found.topics else None
    if trace is not None and not is_foreign(trace):
        summary = summarize(found.path)
        return round(summary.distance_m, 2), _rounded(summary.seen_clearance_m)
    told: defaultdict[tuple[int, int], list[tuple[float, float, float]]] = defaultdict(list)
    for datagram, frames in open_traffic(found.path).framed():
        for frame in frames if datagram.direction is Direction.IN else ():
            if frame.message_id == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED and (message := decode(frame)) is not None:
                told[frame.system, frame.component].append((message.x, message.y, message.z))
    positions = np.array(max(told.values(), key=len, default=[])).reshape(-1, 3)  # of several vehicles, of one
    positions = positions[(abs(positions) <= FARTHEST_M).all(axis=1)]
    if not len(positions):
        return None, None
    steps = np.diff(positions, axis=0)
    return round(float(np.sqrt((steps**2).sum(axis=1)).sum()), 2), None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
