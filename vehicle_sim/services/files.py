"""MAVLink FTP (https://mavlink.io/en/services/ftp.html): a tree of files in memory that can be read, and only read."""

import struct
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from typing import Any, NamedTuple

from protocol.messages import dialect
from vehicle_sim.services.checksum import crc32
from vehicle_sim.services.outbox import Channel, Outbox, Payload

Tree = Mapping[str, Callable[[], bytes]]
"""By path, without a slash in front: what a file holds when it is opened."""
Asker = tuple[Channel, int, int]
"""Link, system, component."""

DATA_BYTES = 239
BURST_CHUNKS = 100
"""After so many the reader must ask for more."""
SESSIONS = 4
"""Open files of one asker."""

_header = struct.Struct("<HBBBBBxI")


class Opcode(IntEnum):
    """What is asked for; others write."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class Fault(IntEnum):
    """Why not."""

    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class Request(NamedTuple):
    """What was asked. `size` is that of the data, or of what is to be read."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        """As in the tree."""
        return self.data[: self.size].split(b"\0")[0].decode("ascii", "replace").strip("/")


class Reply(NamedTuple):
    """Data or a fault. `session`: that of the request, unless it is a new one."""

    data: bytes = b""
    session: int | None = None
    fault: Fault | None = None
    burst_complete: bool = False
    offset: int = 0


class FileService:
    """Reads files, lists folders."""

    capabilities = dialect.MAV_PROTOCOL_CAPABILITY_FTP

    def __init__(self, tree: Tree, outbox: Outbox) -> None:
        self._tree = tree
        self._outbox = outbox
        self._open: dict[Asker, dict[int, bytes]] = {}
        self._last: dict[Asker, tuple[bytes, Payload]] = {}
        """The last request and the answer, for a request that comes again since the answer was lost."""
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: self._handle,
        }
        self._works: dict[int, Callable[[Request, dict[int, bytes]], Reply]] = {
            Opcode.NONE: lambda request, files: Reply(),
            Opcode.TERMINATE_SESSION: self._terminate,
            Opcode.RESET_SESSIONS: self._reset,
            Opcode.LIST_DIRECTORY: self._list,
            Opcode.OPEN_FILE_RO: self._open_file,
            Opcode.READ_FILE: self._read,
            Opcode.CALC_FILE_CRC32: self._checksum,
        }

    def _handle(self, message: Any) -> None:
        raw = bytes(message.payload)
        sequence, session, opcode, size, _, _, offset = _header.unpack_from(raw)
        request = Request(sequence, session, opcode, size, offset, raw[_header.size :])
        asker = (self._outbox.here, message.get_srcSystem(), message.get_srcComponent())
        known = self._last.get(asker)
        if known is not None and known[0] == raw:
            self._outbox.put(known[1])
            return
        files = self._open.setdefault(asker, {})
        self._forget_closed()
        if opcode == Opcode.BURST_READ_FILE and session in files:
            self._outbox.pace(asker, _burst(request, files[session], asker))
            return
        answer = _packed(request, self._reply(request, files), asker)
        self._last[asker] = raw, answer
        self._outbox.put(answer)

    def _forget_closed(self) -> None:
        """What askers on links that are gone had open."""
        for asker in [asker for asker in self._open if asker[0] not in self._outbox.channels]:
            del self._open[asker]
            self._last.pop(asker, None)

    def _reply(self, request: Request, files: dict[int, bytes]) -> Reply:
        if request.opcode == Opcode.BURST_READ_FILE:
            return Reply(fault=Fault.INVALID_SESSION)
        work = self._works.get(request.opcode)
        if work is not None:
            return work(request, files)
        writes = Opcode.READ_FILE < request.opcode <= Opcode.RENAME
        return Reply(fault=Fault.FILE_PROTECTED if writes else Fault.UNKNOWN_COMMAND)

    def _terminate(self, request: Request, files: dict[int, bytes]) -> Reply:
        known = files.pop(request.session, None) is not None
        return Reply() if known else Reply(fault=Fault.INVALID_SESSION)

    def _reset(self, request: Request, files: dict[int, bytes]) -> Reply:
        files.clear()
        return Reply()

    def _list(self, request: Request, files: dict[int, bytes]) -> Reply:
        entries = self._entries(request.path)
        if entries is None:
            return Reply(fault=Fault.FILE_NOT_FOUND)
        data = b""
        for entry in entries[request.offset :]:
            if len(data) + len(entry) > DATA_BYTES:
                break
            data += entry
        return Reply(data) if data else Reply(fault=Fault.END_OF_FILE)

    def _entries(self, folder: str) -> list[bytes] | None:
        """The entries of a folder; None if there is none."""
        inside = f"{folder}/" if folder else ""
        names = [path.removeprefix(inside) for path in self._tree if path.startswith(inside)]
        if folder and not names:
            return None
        folders = {name.split("/")[0] for name in names if "/" in name}
        sizes = {name: len(self._tree[inside + name]()) for name in names if "/" not in name}
        return [f"D{name}\0".encode() for name in sorted(folders)] + [
            f"F{name}\t{size}\0".encode() for name, size in sorted(sizes.items())
        ]

    def _open_file(self, request: Request, files: dict[int, bytes]) -> Reply:
        content = self._tree.get(request.path)
        if content is None:
            return Reply(fault=Fault.FILE_NOT_FOUND)
        number = next((each for each in range(SESSIONS) if each not in files), None)
        if number is None:
            return Reply(fault=Fault.NO_SESSIONS_AVAILABLE)
        files[number] = content()
        return Reply(len(files[number]).to_bytes(4, "little"), number)

    def _read(self, request: Request, files: dict[int, bytes]) -> Reply:
        content = files.get(request.session)
        if content is None:
            return Reply(fault=Fault.INVALID_SESSION)
        if request.offset >= len(content):
            return Reply(fault=Fault.END_OF_FILE)
        data = content[request.offset :][: min(request.size, DATA_BYTES)]
        return Reply(data, offset=request.offset)

    def _checksum(self, request: Request, files: dict[int, bytes]) -> Reply:
        content = self._tree.get(request.path)
        return Reply(fault=Fault.FILE_NOT_FOUND) if content is None else Reply(crc32(content()))


def _burst(request: Request, content: bytes, asker: Asker) -> Iterator[Payload]:
    """Pieces of an open file from an offset on."""
    step = min(request.size, DATA_BYTES) or DATA_BYTES
    starts = range(request.offset, len(content), step)[:BURST_CHUNKS]
    for start in starts:
        data, last = content[start : start + step], start == starts[-1]
        yield _packed(request, Reply(data, burst_complete=last, offset=start), asker)
        request = request._replace(sequence=request.sequence + 1)
    if not starts:
        yield _packed(request, Reply(fault=Fault.END_OF_FILE), asker)


def _packed(request: Request, reply: Reply, asker: Asker) -> Payload:
    failed = reply.fault is not None
    data = bytes((reply.fault,)) if reply.fault is not None else reply.data
    header = _header.pack(
        request.sequence + 1 & 0xFFFF,
        request.session if reply.session is None else reply.session,
        Opcode.NAK if failed else Opcode.ACK,
        len(data),
        request.opcode,
        reply.burst_complete,
        reply.offset,
    )
    whole = bytes((0, asker[1], asker[2])) + header + data
    return dialect.MAVLink_file_transfer_protocol_message, whole.ljust(254, b"\0")
