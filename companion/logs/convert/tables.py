"""A table for each topic of a flight log: CSV or Parquet files in a folder, a row a message."""

import csv
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np

from protocol.flightlog import DATAGRAM, FlightLogError, LogReader, RecordType

TIME = "time_ns"
"""First column: from the log's time 0."""
_BATCH = 4096
Column = tuple[str, Any]
"""Its name; values as an array with a row a message, or a list of str or bytes."""


def to_tables(source: Path, folder: Path, kind: Literal["csv", "parquet"]) -> dict[str, int]:
    """Write a file for each topic but the datagrams themselves; the rows in each by its name.

    Arrays of fixed length become columns `name[0]`, `name[1]`, ... in CSV and lists in Parquet; bytes are hexadecimal
    in CSV. Raises FlightLogError if the log can't be read, the folder is there already, or pyarrow is missing.
    """
    log = LogReader(source)
    kinds = {topic: record_type for topic, record_type in log.topics.items() if topic != DATAGRAM.topic}
    table = _Csv if kind == "csv" else _parquet()
    try:
        folder.mkdir(parents=True)
        with ExitStack() as stack:
            tables: dict[str, _Table] = {}
            for record in log.records(kinds):
                each = tables.get(record.topic)
                if each is None:
                    path = folder / f"{_file_name(record.topic)}.{kind}"
                    each = tables[record.topic] = stack.enter_context(table(path, kinds[record.topic]))
                each.add(record.time_ns, record.data)
    except OSError as error:
        raise FlightLogError(f"{error.filename or folder}: {error.strerror or error}") from error
    return {each.path.name: each.rows for each in tables.values()}


def _file_name(topic: str) -> str:
    return topic.removeprefix("/mavlink/").strip("/").replace("/", "_")


class _Table(ABC):
    """One file; rows are gathered and written many at a time."""

    def __init__(self, path: Path, kind: RecordType) -> None:
        self.path = path
        self.rows = 0
        self._kind = kind
        self._times: list[int] = []
        self._data: list[bytes] = []

    def __enter__(self) -> "_Table":
        return self

    def __exit__(self, *_: object) -> None:
        self._flush()
        self.close()

    def add(self, time_ns: int, data: bytes) -> None:
        """A row."""
        self._times.append(time_ns)
        self._data.append(data)
        self.rows += 1
        if len(self._times) == _BATCH:
            self._flush()

    def _flush(self) -> None:
        if self._times:
            self.write([(TIME, np.array(self._times, np.int64)), *_columns(self._kind, self._data)])
            self._times, self._data = [], []

    @abstractmethod
    def write(self, columns: Sequence[Column]) -> None:
        """Some rows more; always the same columns."""

    @abstractmethod
    def close(self) -> None: ...


def _columns(kind: RecordType, data: Sequence[bytes]) -> list[Column]:
    values: list[Any]
    names = [field.name if field.name != TIME else f"{TIME}_" for field in kind.fields]
    if kind.size is not None:
        rows = np.frombuffer(b"".join(data), kind.dtype)
        values = [rows[field.name] for field in kind.fields]
    else:
        unpacked = [kind.unpack(each) for each in data]
        values = [[row[field.name] for row in unpacked] for field in kind.fields]
    return [
        (name, _plain(field.kind, field.length, value))
        for name, field, value in zip(names, kind.fields, values, strict=True)
    ]


def _plain(kind: str, length: int | None, values: Any) -> Any:
    """Numbers as an array, with a second axis for those of fixed length; str and bytes as they are."""
    if kind == "time":
        if isinstance(values, list):
            return np.array([seconds * 1_000_000_000 + rest for seconds, rest in values], np.int64)
        return values["sec"].astype(np.int64) * 1_000_000_000 + values["nsec"]
    if kind == "string" or (length is not None and length < 0):
        return values
    return values if isinstance(values, np.ndarray) else np.array(values)


class _Csv(_Table):
    def __init__(self, path: Path, kind: RecordType) -> None:
        super().__init__(path, kind)
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._headed = False

    def write(self, columns: Sequence[Column]) -> None:
        names: list[str] = []
        texts: list[Sequence[Any]] = []
        for name, values in columns:
            if isinstance(values, list):
                names.append(name)
                texts.append([value.hex() if isinstance(value, bytes) else value for value in values])
                continue
            flat = values.reshape(len(values), -1).astype(str)  # the shortest digits that are the same number again
            names += [name] if values.ndim == 1 else [f"{name}[{index}]" for index in range(flat.shape[1])]
            texts += list(flat.T)
        if not self._headed:
            self._writer.writerow(names)
            self._headed = True
        self._writer.writerows(zip(*texts, strict=True))

    def close(self) -> None:
        self._file.close()


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
