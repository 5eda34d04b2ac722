"""Converts a flight log to tables: a CSV or Parquet file for each topic, a row for each message."""

import itertools
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np

from companion.logs.message_names import with_name
from companion.logs.recordings import records, unpack
from protocol.flightlog import DATAGRAM, SCALARS, FlightLogError, LogReader, Record, RecordType
from protocol.flightlog.record_types import VARIABLE

TIME = "time_ns"
"""Name of the first column: time since the log's time 0."""
_BATCH = 4096
"""Rows that are written together."""
_LONGEST_NAME = 200
"""Bytes."""
Column = tuple[str, Any]
"""Name; values as an array (n,) or (n, k), or a list of n str, bytes or arrays."""


def to_tables(log: LogReader, folder: Path, kind: Literal["csv", "parquet"]) -> dict[str, int]:
    """Write a file for each topic but the datagrams themselves; returns the number of rows by file name.

    Arrays of fixed length become columns `name[0]`, `name[1]`, ... in CSV and lists in Parquet; bytes are hexadecimal
    in CSV. Raises FlightLogError if the log can't be read or pyarrow is missing, OSError if the folder is there
    already or can't be written.
    """
    kinds = {topic: record_type for topic, record_type in log.topics.items() if topic != DATAGRAM.topic}
    table = _Csv if kind == "csv" else _parquet()
    folder.mkdir()
    names: set[str] = set()
    with ExitStack() as stack:
        tables: dict[str, _Table] = {}
        for record in records(log, kinds):
            each = tables.get(record.topic)
            if each is None:
                path = folder / f"{_file_name(with_name(record.topic), names)}.{kind}"
                each = tables[record.topic] = stack.enter_context(table(path, log, kinds[record.topic]))
            each.add(record)
    return {each.path.name: each.rows for each in tables.values()}


def _file_name(topic: str, taken: set[str]) -> str:
    """A file name for the topic that differs from those `taken` by more than upper and lower case."""
    plain = re.sub(r"[^\w.-]", "_", topic.removeprefix("/mavlink/").strip("/"))
    plain = plain.encode()[:_LONGEST_NAME].decode(errors="ignore") or "_"
    name = next(name for number in itertools.count(1) if (name := _numbered(plain, number)).casefold() not in taken)
    taken.add(name.casefold())
    return name


def _numbered(name: str, number: int) -> str:
    return name if number == 1 else f"{name}_{number}"


class _Table(ABC):
    """One file; rows are collected and written many at a time."""

    def __init__(self, path: Path, log: LogReader, kind: RecordType) -> None:
        self.path = path
        self.rows = 0
        self._log = log
        self._kind = kind
        self._records: list[Record] = []

    def __enter__(self) -> "_Table":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._flush()
        self.close()

    def add(self, record: Record) -> None:
        """Add a row."""
        self._records.append(record)
        self.rows += 1
        if len(self._records) == _BATCH:
            self._flush()

    def _flush(self) -> None:
        if self._records:
            try:
                times = np.array([record.time_ns for record in self._records], np.int64)
            except OverflowError:
                raise FlightLogError(f"{self._log.path}: a record's time is beyond 292 years") from None
            self.write([(TIME, times), *_columns(self._log, self._kind, self._records)])
            self._records = []

    @abstractmethod
    def write(self, columns: Sequence[Column]) -> None:
        """Write more rows; the columns are the same each time."""

    @abstractmethod
    def close(self) -> None: ...


def _columns(log: LogReader, kind: RecordType, found: Sequence[Record]) -> list[Column]:
    values: list[Any]
    names = [field.name if field.name != TIME else f"{TIME}_" for field in kind.fields]
    if not kind.fields:
        return []
    if kind.size is not None:
        rows = np.frombuffer(b"".join(record.data for record in found), kind.dtype)
        values = [rows[field.name] for field in kind.fields]
    else:
        unpacked = [unpack(log, kind, record) for record in found]
        values = [[row[field.name] for row in unpacked] for field in kind.fields]
    return [
        (name, _plain(field.kind, field.length, value))
        for name, field, value in zip(names, kind.fields, values, strict=True)
    ]


def _plain(kind: str, length: int | None, values: Any) -> Any:
    """Numbers as an array (n,) or, for arrays of fixed length, (n, k), and of any length, a list of n arrays; str and
    bytes as they are."""
    if kind == "time":
        if isinstance(values, list):
            return np.array([seconds * 1_000_000_000 + rest for seconds, rest in values], np.int64)
        return values["sec"].astype(np.int64) * 1_000_000_000 + values["nsec"]
    if length == VARIABLE and kind != "uint8":
        return [np.array(value, "<" + SCALARS[kind]) for value in values]  # an empty one has its type, too
    if kind == "string" or length == VARIABLE:
        return values
    return values if isinstance(values, np.ndarray) else np.array(values, "<" + SCALARS[kind])


class _Csv(_Table):
    """Its file is open while rows are written: a log may have more topics than a process may have files."""

    _headed = False

    def write(self, columns: Sequence[Column]) -> None:
        names: list[str] = []
        texts: list[Sequence[str]] = []
        for name, values in columns:
            if isinstance(values, list):
                names.append(name)
                texts.append([_text(value) for value in values])
                continue
            flat = _digits(values.reshape(len(values), -1))
            names += [name] if values.ndim == 1 else [f"{name}[{index}]" for index in range(flat.shape[1])]
            texts += list(flat.T)
        with self.path.open("a" if self._headed else "w", newline="", encoding="utf-8") as file:
            if not self._headed:
                file.write(",".join(names) + "\n")
                self._headed = True
            file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))

    def close(self) -> None:
        """Nothing is open."""


def _text(value: Any) -> str:
    """A text, bytes or an array of numbers as a CSV field."""
    if isinstance(value, np.ndarray):
        digits = _digits(value).tolist()
        value = f"({digits[0]},)" if len(digits) == 1 else f"({', '.join(digits)})"
    return value.hex() if isinstance(value, bytes) else _quoted(str(value))


def _digits(numbers: Any) -> Any:
    """The shortest ones that give the same numbers of that type."""
    return numbers.astype(str)


def _quoted(text: str) -> str:
    """A CSV field. Python's own writer leaves a carriage return unquoted, which ends a row for other readers."""
    return '"' + text.replace('"', '""') + '"'


def _parquet() -> "type[_Table]":
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError:
        raise FlightLogError("Parquet needs pyarrow, which is not installed: pip install pyarrow") from None

    class Parquet(_Table):
        _writer: Any = None

        def write(self, columns: Sequence[Column]) -> None:
            table = arrow.table({name: self._column(values) for name, values in columns})
            if self._writer is None:
                self._writer = parquet.ParquetWriter(self.path, table.schema, compression="zstd")
            self._writer.write_table(table)

        @staticmethod
        def _column(values: Any) -> Any:
            if isinstance(values, np.ndarray) and values.ndim == 2:
                flat = arrow.array(np.ascontiguousarray(values).reshape(-1))
                return arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
            return arrow.array(values if isinstance(values, list) else np.ascontiguousarray(values))

        def close(self) -> None:
            if self._writer is not None:
                self._writer.close()

    return Parquet
