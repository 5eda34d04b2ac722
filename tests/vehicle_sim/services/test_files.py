"""MAVLink FTP and logs, as pymavlink's own client reads them."""

import struct
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, ForeignPilot
from vehicle_sim.services import files
from vehicle_sim.services.files import Fault, FileService, Opcode
from vehicle_sim.services.parameter_store import text_of
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle

PATH = "parameters.params"


class Master:
    """What pymavlink's client needs of a connection; it loses what comes at the places in `lost`."""

    def __init__(self, vehicle: Vehicle, lost: Iterable[int] = ()) -> None:
        self.vehicle = vehicle
        self.source_system, self.source_component = 255, 190
        self.mav = mavlink.MAVLink(self, self.source_system, self.source_component)
        self.heard = 0
        self.ticks = 0
        self._lost = frozenset(lost)
        self._queue: list[Any] = []
        self._reader = mavlink.MAVLink(None)

    def write(self, data: bytes) -> None:
        self.vehicle.receive(bytes(data))

    def recv_match(self, type: list[str], timeout: float = 0.1, blocking: bool = True) -> Any:  # noqa: A002
        for _ in range(round(timeout * 1e9 / TICK_NS)):
            if self._queue:
                break
            self.ticks += 1
            for datagram in self.vehicle.advance():
                for message in self._reader.parse_buffer(datagram) or []:
                    if message.get_type() in type:
                        self.heard += 1
                        if self.heard not in self._lost:
                            self._queue.append(message)
        return self._queue.pop(0) if self._queue else None


def client(master: Master, monkeypatch: pytest.MonkeyPatch) -> mavftp.MAVFTP:
    """On the vehicle's clock."""
    clock = SimpleNamespace(time=lambda: master.ticks * TICK_NS * 1e-9, sleep=lambda seconds: None)
    monkeypatch.setattr(mavftp, "time", clock)
    return mavftp.MAVFTP(master, target_system=1, target_component=1)


def test_pymavlinks_client_lists_and_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    master = Master(Vehicle(AIRFRAME, EMPTY))
    ftp = client(master, monkeypatch)
    listed = ftp.cmd_list(["/"]) and ftp.list_result
    content = text_of(master.vehicle.parameters).encode()
    assert [each.name for each in listed] == ["general.json", "parameters.json", PATH]
    assert (listed[2].is_dir, listed[2].size_b) == (False, len(content))
    got: list[bytes] = []
    assert ftp.cmd_get([PATH], callback=lambda file: got.append(file.read())).error_code == 0
    assert ftp.process_ftp_reply("OpenFileRO", timeout=5).error_code == 0
    assert got == [content] and len(content) > 3000


def test_lost_pieces_are_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    master = Master(Vehicle(AIRFRAME, EMPTY), lost={4, 9, 10})
    ftp = client(master, monkeypatch)
    got: list[bytes] = []
    ftp.cmd_get([PATH], callback=lambda file: got.append(file.read()))
    ftp.process_ftp_reply("OpenFileRO", timeout=8)
    assert got == [text_of(master.vehicle.parameters).encode()]


class Asker:
    """Single requests, byte by byte."""

    def __init__(self, pilot: ForeignPilot) -> None:
        self.pilot = pilot
        self.sequence = 0

    def ask(self, opcode: int, data: bytes = b"", *, session: int = 0, size: int | None = None, offset: int = 0) -> Any:
        """Opcode, session, and data or the fault's number; the answer must come within 20 ms."""
        self.sequence += 2
        header = struct.pack(
            "<HBBBBBBI", self.sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset
        )
        return self.send((header + data).ljust(251, b"\0"))

    def send(self, payload: bytes) -> Any:
        before = self.pilot.time_s
        self.pilot.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload)))
        self.last = payload
        self.pilot.fly(0.02)
        answer = bytes(self.pilot.all("FILE_TRANSFER_PROTOCOL", before)[0].payload)
        sequence, number, code, length, asked, *_ = struct.unpack_from("<HBBBBBBI", answer)
        assert (sequence, asked) == (int.from_bytes(payload[:2], "little") + 1, payload[3])
        data = answer[12 : 12 + length]
        return Opcode(code), number, Fault(data[0]) if code == Opcode.NAK else data


@pytest.fixture
def asker() -> Asker:
    return Asker(ForeignPilot())


def test_what_is_not_there_or_would_write_is_refused(asker: Asker) -> None:
    refused: dict[Fault, list[tuple[int, bytes]]] = {
        Fault.FILE_NOT_FOUND: [
            (Opcode.OPEN_FILE_RO, b"@PARAM/param.pck"),
            (Opcode.LIST_DIRECTORY, b"/fs/microsd/log"),
            (Opcode.CALC_FILE_CRC32, b"x"),
        ],
        Fault.FILE_PROTECTED: [(code, b"a\0b") for code in range(6, 14)],
        Fault.UNKNOWN_COMMAND: [(77, b"")],
        Fault.INVALID_SESSION: [
            (Opcode.READ_FILE, b""),
            (Opcode.BURST_READ_FILE, b""),
            (Opcode.TERMINATE_SESSION, b""),
        ],
    }
    for fault, questions in refused.items():
        for opcode, data in questions:
            assert asker.ask(opcode, data) == (Opcode.NAK, 0, fault), opcode
    assert asker.ask(Opcode.LIST_DIRECTORY, b"/", offset=3) == (Opcode.NAK, 0, Fault.END_OF_FILE)
    assert asker.ask(Opcode.NONE) == (Opcode.ACK, 0, b"")


def test_sessions_are_few_and_an_answer_that_was_lost_opens_no_second_one(asker: Asker) -> None:
    assert asker.ask(Opcode.OPEN_FILE_RO, PATH.encode())[:2] == (Opcode.ACK, 0)
    assert asker.send(asker.last)[:2] == (Opcode.ACK, 0)
    numbers = [asker.ask(Opcode.OPEN_FILE_RO, PATH.encode())[1] for _ in range(files.SESSIONS - 1)]
    assert numbers == [1, 2, 3]
    assert asker.ask(Opcode.OPEN_FILE_RO, PATH.encode()) == (Opcode.NAK, 0, Fault.NO_SESSIONS_AVAILABLE)
    assert asker.ask(Opcode.TERMINATE_SESSION, session=2) == (Opcode.ACK, 2, b"")
    assert asker.ask(Opcode.OPEN_FILE_RO, PATH.encode())[1] == 2
    assert asker.ask(Opcode.RESET_SESSIONS)[0] is Opcode.ACK
    assert asker.ask(Opcode.READ_FILE, session=1, size=10) == (Opcode.NAK, 1, Fault.INVALID_SESSION)


def test_an_open_file_stays_as_it_was_and_has_px4s_checksum(asker: Asker) -> None:
    parameters = asker.pilot.vehicle.parameters
    before = text_of(parameters).encode()
    asker.ask(Opcode.OPEN_FILE_RO, PATH.encode())
    parameters.set("COM_DISARM_LAND", 7.0)
    assert asker.ask(Opcode.READ_FILE, size=100, offset=1000) == (Opcode.ACK, 0, before[1000:1100])
    assert asker.ask(Opcode.READ_FILE, size=100, offset=len(before) - 1)[2] == before[-1:]
    assert asker.ask(Opcode.READ_FILE, size=100, offset=len(before))[2] is Fault.END_OF_FILE
    crc = 0
    for byte in text_of(parameters).encode():
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    assert asker.ask(Opcode.CALC_FILE_CRC32, PATH.encode())[2] == crc.to_bytes(4, "little")


def test_folders_are_listed_in_pieces_that_fit() -> None:
    paths = [*(f"logs/flight_{number:03}.txt" for number in range(40)), "readme"]
    pilot = ForeignPilot()
    service = FileService({path: lambda: b"abc" for path in paths}, pilot.vehicle._services.outbox)
    pilot.vehicle._services._handlers |= service.handlers
    asker = Asker(pilot)
    found: list[bytes] = []
    assert asker.ask(Opcode.LIST_DIRECTORY, b"")[2] == b"Dlogs\0Freadme\t3\0"
    while (answer := asker.ask(Opcode.LIST_DIRECTORY, b"logs/", offset=len(found)))[0] is Opcode.ACK:
        assert len(answer[2]) <= files.DATA_BYTES
        found += answer[2].split(b"\0")[:-1]
    assert found == [f"Fflight_{number:03}.txt\t3".encode() for number in range(40)]
