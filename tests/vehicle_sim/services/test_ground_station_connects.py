"""What QGroundControl asks for when it connects, in the order of its InitialConnectStateMachine and of its machine for
component metadata. Each step must end within half a second of real time."""

import json
import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from tests.vehicle_sim.foreign_pilot import ForeignPilot
from tests.vehicle_sim.mission_uploader import at, upload
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.services.checksum import crc32
from vehicle_sim.services.files import Opcode
from vehicle_sim.services.parameter_store import OBEYED
from vehicle_sim.services.parameter_table import TABLE

HALF_A_SECOND = 0.5
KINDS = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY


class Station:
    """Its requests, each with the answer that it waits for."""

    def __init__(self, pilot: ForeignPilot) -> None:
        self.pilot = pilot
        self._heard = 0
        self._reader = development.MAVLink(None)  # it has the messages that pilot's dialect lacks
        self._sequence = 0

    def ask(self, question: Any, is_last: Callable[[Any], bool]) -> list[Any]:
        """What the vehicle says until the last part of its answer."""
        self._heard = len(self.pilot.datagrams)
        self.pilot.send(question)
        told: list[Any] = []

        def answered() -> bool:
            new, self._heard = self.pilot.datagrams[self._heard :], len(self.pilot.datagrams)
            messages = [message for datagram in new for message in self._reader.parse_buffer(datagram) or []]
            told.extend(messages)
            return any(is_last(message) for message in messages)

        assert self.pilot.fly(HALF_A_SECOND, until=answered), f"no answer to {question}"
        return told

    def message(self, number: int, which: float = 0.0) -> Any:
        """REQUEST_MESSAGE; the message, which must come with its COMMAND_ACK."""
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        question = mavlink.MAVLink_command_long_message(1, 1, request, 0, number, which, 0, 0, 0, 0, 0)
        told = self.ask(question, lambda m: m.get_type() == "COMMAND_ACK" and m.command == request)
        assert told[-1].result == mavlink.MAV_RESULT_ACCEPTED
        return next(each for each in told if int.from_bytes(each.get_msgbuf()[7:10], "little") == number)

    def file(self, uri: str) -> bytes:
        """Opened, read in bursts and closed."""
        scheme, path = uri[:7], uri[7:]
        assert scheme == "mftp://"
        ((session, size),) = [
            (s, int.from_bytes(d, "little")) for s, d, _ in self._file(Opcode.OPEN_FILE_RO, path.encode())
        ]
        content = b""
        while len(content) < size:
            pieces = self._file(Opcode.BURST_READ_FILE, session=session, size=239, offset=len(content))
            content += b"".join(data for _, data, _ in pieces)
        self._file(Opcode.TERMINATE_SESSION, session=session)
        return content

    def _file(
        self, opcode: int, data: bytes = b"", *, session: int = 0, size: int | None = None, offset: int = 0
    ) -> list[tuple[int, bytes, bool]]:
        """Session, data, and whether a burst is complete, of each answer."""
        self._sequence += 1
        size = len(data) if size is None else size
        header = struct.pack("<HBBBBBBI", self._sequence, session, opcode, size, 0, 0, 0, offset)
        payload = list((header + data).ljust(251, b"\0"))
        burst = opcode == Opcode.BURST_READ_FILE

        def is_last(message: Any) -> bool:
            return bool(message.get_type() == "FILE_TRANSFER_PROTOCOL" and (message.payload[6] or not burst))

        told = self.ask(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload), is_last)
        answers = [bytes(each.payload) for each in told if each.get_type() == "FILE_TRANSFER_PROTOCOL"]
        assert all(each[3] == Opcode.ACK for each in answers)
        return [(each[2], each[12 : 12 + each[4]], bool(each[6])) for each in answers]

    def plan(self, kind: int) -> list[Any]:
        """A mission, a fence or rally points."""
        told = self.ask(
            mavlink.MAVLink_mission_request_list_message(1, 1, kind), lambda m: m.get_type() == "MISSION_COUNT"
        )
        assert told[-1].mission_type == kind
        items = []
        for number in range(told[-1].count):
            request = mavlink.MAVLink_mission_request_int_message(1, 1, number, kind)
            items.append(self.ask(request, lambda m: m.get_type() == "MISSION_ITEM_INT")[-1])
        self.pilot.send(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_ACCEPTED, kind))
        return items


def test_it_connects() -> None:
    pilot = ForeignPilot()
    assert upload(pilot, [at(mavlink.MAV_CMD_NAV_WAYPOINT, n, 0.0, 5.0) for n in (1.0, 2.0)]) == 0
    assert upload(pilot, [at(mavlink.MAV_CMD_NAV_RALLY_POINT, 5.0, 0.0, 5.0)], KINDS[2]) == 0
    station = Station(pilot)

    version = station.message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert version.flight_sw_version >> 16 == 1 << 8 | 16

    modes = [station.message(435, 1)]
    modes += [station.message(435, number) for number in range(2, modes[0].number_modes + 1)]
    assert [mode.custom_mode for mode in modes] == list(dict.fromkeys(mode.custom_mode for mode in Mode))

    _, crc, uri = struct.unpack("<I4s100s", station.message(397).get_msgbuf()[10:-2].ljust(108, b"\0"))
    general = station.file(uri.rstrip(b"\0").decode())
    assert crc == crc32(general)
    (described,) = json.loads(general)["metadataTypes"]
    text = station.file(described["uri"])
    assert (described["type"], described["fileCrc"]) == (1, int.from_bytes(crc32(text), "little"))
    parameters = {each["name"]: each for each in json.loads(text)["parameters"]}

    told = station.ask(
        mavlink.MAVLink_param_request_list_message(1, 1),
        lambda m: m.get_type() == "PARAM_VALUE" and m.param_index == m.param_count - 1,
    )
    values = {each.param_id for each in told if each.get_type() == "PARAM_VALUE"}
    assert values == {"_HASH_CHECK", *parameters} == {"_HASH_CHECK", *TABLE}

    mission, fence, rally = (station.plan(kind) for kind in KINDS)
    assert ([each.seq for each in mission], fence, len(rally)) == ([0, 1], [], 1)
    assert not pilot.texts


def test_the_description_of_a_parameter_says_what_can_be_done_with_it() -> None:
    station = Station(ForeignPilot())
    parameters = {each["name"]: each for each in json.loads(station.file("mftp:///parameters.json"))["parameters"]}
    loss = {"name": "COM_OF_LOSS_T", "type": "Float", "group": "COM", "default": 1.0, "min": 0.0, "max": 60.0}
    assert parameters["COM_OF_LOSS_T"] == loss | {"shortDesc": "Obeyed"}
    assert "max" not in parameters["RTL_RETURN_ALT"] and parameters["SYS_AUTOSTART"]["type"] == "Int32"
    said = {name: each["shortDesc"] for name, each in parameters.items()}
    assert {name for name, text in said.items() if text == "Obeyed"} == set(OBEYED)
    assert said["MAV_SYS_ID"] == "A fact about this vehicle" and said["SYS_AUTOSTART"] == "Kept, and does nothing"
