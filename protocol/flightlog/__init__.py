"""The flight log: MCAP (mcap.dev), written by a process of its own, and reading it back.

The flying process (`FlightLog`) packs each record as an MCAP message into a buffer in shared memory. The recorder moves
them into the file, decodes the MAVLink frames of each datagram beside it, and ends a chunk at least every 0.1 s. It
lives until the pipe from the flying process closes, so nothing is lost when that is killed, and at most 0.2 s when the
recorder is.

Topics:

    /courier/datagrams               every datagram byte for byte: direction, address, data
    /mavlink/{system}/{component}/*  the messages in them, under their own names, with their datagram's sequence
    /log                             text, as Foxglove shows it
    others                           the types that are given to `FlightLog.open`

log_time is `epoch_ns` (in the metadata "flightlog") plus the time that was given. `sequence` counts the records that
were given, in that order: where records were dropped, it has a gap.

Modules: writer (`FlightLog`), shared_buffer and recorder (the process, with mcap_file, mavlink_records, console and
panel); status; reader (`LogReader`) and follower (`LogFollower`, of a log that grows) on outline, chunks, definitions
and selection; summary; record_types for both sides; tlog for telemetry logs. Importing this package loads neither numba
nor numpy nor the MAVLink dialect.
"""

from protocol.flightlog.follower import LogFollower
from protocol.flightlog.mcap_format import FILE_NAME, MAGIC, Direction, FlightLogError
from protocol.flightlog.reader import LogReader, datagrams, digest, read
from protocol.flightlog.record_types import DATAGRAM, SCALARS, TEXT, RecordType, datagram_of, record_type
from protocol.flightlog.selection import Record
from protocol.flightlog.status import Status
from protocol.flightlog.writer import FlightLog, RecorderProcess

__all__ = [
    "DATAGRAM",
    "FILE_NAME",
    "MAGIC",
    "SCALARS",
    "TEXT",
    "Direction",
    "FlightLog",
    "FlightLogError",
    "LogFollower",
    "LogReader",
    "Record",
    "RecordType",
    "RecorderProcess",
    "Status",
    "datagram_of",
    "datagrams",
    "digest",
    "read",
    "record_type",
]
