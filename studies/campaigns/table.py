"""The table of a campaign on disk: Parquet, a row a flight.

Rows are added as parts, each a file that is there as a whole or not at all. `finish` merges them into `rows.parquet`,
sorted, so the table does not depend on the order in which flights ended. Most readers take the folder as one table.
"""

import dataclasses
import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

from studies.campaign import CaseKey, Job, Key, Row

MERGED = "rows.parquet"
PARTS = "parts"
LOCK = "flying"
"""Locked by the campaign that flies."""
ENDS = "ends.json"
"""The first and the last seed that count, of each case: all other rows are of files of before, or were in the air when
a case had enough flights."""
_OLDER = 4
"""Columns of an older file of ends, which knows no more than the last seed of some cases."""
TIMINGS = ("wall_s", "map_us", "way_us", "space_us", "step_us")
"""Columns of wall times: all others are the same whenever and wherever a flight is flown."""

Seeds = tuple[int, int]
"""The first and the last one."""


class TableError(Exception):
    """A table that can't be read or written, or whose rows can't be told apart; the text names the file or folder."""


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """A block in which no other campaign flies into the folder: each would write over the other's parts. Raises
    TableError if one does; one that was killed does not any more."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK).open("w")
    except OSError as error:
        raise TableError(f"{folder}: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise TableError(f"{folder}: another campaign is flying into it") from None
        yield


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """A block in which whatever the system refuses names this file or folder, if it names none: what says that a disk
    is full does not."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


class Table:
    """The rows of a campaign; a later row of the same flight replaces an earlier one."""

    def __init__(self, folder: Path) -> None:
        """Raises TableError for a folder that can't be written to, before anything is flown."""
        self.folder = folder
        try:
            (folder / PARTS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TableError(f"{folder}: {error.strerror}") from error
        self._rows = {row.key: row for row in read(folder)}
        numbers = (int(path.stem) for path in (folder / PARTS).glob("*.parquet") if path.stem.isdecimal())
        self._parts = max(numbers, default=0)

    def row(self, job: Job) -> Row | None:
        """The row of a flight; None if it was not flown, or by other code or settings."""
        row = self._rows.get(job.key)
        return row if row is not None and row.code == job.code else None

    def add(self, rows: Sequence[Row]) -> None:
        """Keep rows on disk."""
        self._parts += 1
        write(rows, self.folder / PARTS / f"{self._parts:08}.parquet")
        self._rows |= {row.key: row for row in rows}

    def end(self, cases: Mapping[CaseKey, Seeds]) -> None:
        """Keep which seeds of each case count: no other rows do."""
        path = self.folder / ENDS
        unfinished = path.with_suffix(".unfinished")
        text = json.dumps([[*case, *seeds] for case, seeds in cases.items()], indent=1)
        with naming(path):
            unfinished.write_text(text, encoding="utf-8")
            unfinished.replace(path)

    def finish(self) -> list[Row]:
        """Merge all parts; the rows, sorted."""
        old = [path for path in _files(self.folder) if path.name != MERGED]
        rows = [self._rows[key] for key in sorted(self._rows)]
        if old:
            write(rows, self.folder / MERGED)
        for path in old:
            path.unlink()
        return rows


def digest(rows: Iterable[Row]) -> str:
    """A digest of rows without their wall times, in the order of their keys."""
    plain = [
        repr([getattr(row, field.name) for field in dataclasses.fields(Row) if field.name not in TIMINGS])
        for row in sorted(rows, key=lambda row: row.key)
    ]
    return hashlib.sha256("\n".join(plain).encode()).hexdigest()[:16]


def write(rows: Sequence[Row], path: Path) -> None:
    """Write rows as one file, which is there as a whole or not at all."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(field.name, kinds[_kind(field.type)]) for field in dataclasses.fields(Row)])
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.Table.from_pylist([dataclasses.asdict(row) for row in rows], schema=schema)
    unfinished = path.with_suffix(".unfinished")
    with naming(path):
        parquet.write_table(table, unfinished, compression="zstd")
        unfinished.replace(path)


def _kind(annotation: Any) -> type:
    """`float | None` -> float."""
    kind: type
    for kind in get_args(annotation) or (annotation,):
        if kind is not type(None):
            return kind
    raise TypeError(f"{annotation} is no type of a column")


def _files(folder: Path) -> list[Path]:
    """The newest rows last."""
    whole = sorted(folder.glob("*.parquet"), key=lambda path: (path.name == MERGED, path.name))
    return [*whole, *sorted((folder / PARTS).glob("*.parquet"))]


def read(folder: Path) -> list[Row]:
    """All rows in a folder, sorted, each flight once. Raises TableError."""
    latest: dict[Key, Row] = {row.key: row for path in _files(folder) for row in _rows_of(path)}
    return [latest[key] for key in sorted(latest)]


def _rows_of(path: Path) -> list[Row]:
    from pyarrow import ArrowException, parquet

    names = {field.name for field in dataclasses.fields(Row)}  # older files have more
    try:
        rows = parquet.read_table(path).to_pylist()
        return [Row(**{name: value for name, value in row.items() if name in names}) for row in rows]
    except (ArrowException, OSError, TypeError) as error:  # a column that is not there is a TypeError
        raise TableError(f"{path}: no table of flights ({error})") from error


def counting(folder: Path) -> list[Row]:
    """The rows that the campaign's page counts: of what was in the air when a case had enough flights, and of what the
    campaign's file has no more, nothing. Raises TableError, too, if a case has rows of two versions of code or
    settings: a campaign that was begun anew by another version and is not at its end yet."""
    ends = _ends(folder)
    rows = [row for row in read(folder) if ends is None or _counts(row, ends)]
    codes: dict[CaseKey, str] = {}
    for row in rows:
        if codes.setdefault(row.key[:3], row.code) != row.code:
            raise TableError(f"{folder}: {row.setup}, {row.method}, {row.speed:g} m/s: its rows are of two versions; "
                             "fly all its seeds by one, or into a folder of its own")  # fmt: skip
    return rows


def _counts(row: Row, ends: Mapping[CaseKey, Seeds]) -> bool:
    first, last = ends.get(row.key[:3], (1, 0))
    return first <= row.seed <= last


def _ends(folder: Path) -> dict[CaseKey, Seeds] | None:
    """None where all rows count: those of an older campaign, and of a study."""
    path = folder / ENDS
    try:
        read_back = [tuple(each) for each in json.loads(path.read_text(encoding="utf-8"))]
        if any(len(each) == _OLDER for each in read_back) or not read_back:
            return None
        return {
            (str(setup), str(method), float(speed)): (int(first), int(last))
            for setup, method, speed, first, last in read_back
        }
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError) as error:
        raise TableError(f"{path}: no ends of cases ({error})") from error
