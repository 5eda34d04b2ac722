"""Several links of one vehicle: streams, routing, peers that come and go. Unmodified pymavlink at the other ends."""

import math
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.listeners import Listener, TcpListener, UdpListener
from protocol.transport import Memory, TransportError
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY
from vehicle_sim import links as links_module
from vehicle_sim.links import Links
from vehicle_sim.opening import Request, open_instance, open_links
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.parameter_table import TABLE
from vehicle_sim.services.profiles import Profile
from vehicle_sim.vehicle import Vehicle

HOST = "127.0.0.1"
LOCAL_POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED


class Station:
    """One end, in memory."""

    def __init__(self, network: "Network", system: int, component: int, profile: Profile) -> None:
        self.channel = network.vehicle.open_channel(profile)
        self.vehicle = network.vehicle
        self.heard: list[tuple[int, Any]] = []
        """Tick and message."""
        self._out, self._in = mavlink.MAVLink(None, system, component), mavlink.MAVLink(None)

    def send(self, message: Any) -> None:
        self.vehicle.receive(message.pack(self._out), self.channel)

    def beat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def listen(self) -> None:
        for datagram in self.vehicle.collect(self.channel):
            self.heard += [(self.vehicle.tick, message) for message in self._in.parse_buffer(datagram) or []]

    def all(self, name: str, sender: int | None = None) -> list[Any]:
        return [m for _, m in self.heard if m.get_type() == name and sender in (None, m.get_srcSystem())]


class Network:
    """A vehicle with several ends beside its first link."""

    def __init__(self, *profiles: Profile, identity: Identity = Identity()) -> None:  # noqa: B008
        self.vehicle = Vehicle(AIRFRAME, EMPTY, identity=identity)
        self.ends = [Station(self, 250 - k, 190, profile) for k, profile in enumerate(profiles)]

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.004)):
            self.vehicle.advance()
            for end in self.ends:
                end.listen()


def interval(message_id: int, interval_us: float) -> Any:
    return mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, interval_us, *(0.0,) * 5
    )


# --- streams ---


def test_what_one_asks_for_changes_no_other_links_rates() -> None:
    asked, alone = Network(Profile.ONBOARD, Profile.ONBOARD, Profile.GROUND), Network(*[Profile.ONBOARD] * 3)
    asked.ends[0].send(interval(LOCAL_POSITION, 4000))
    asked.ends[0].send(interval(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, -1))
    for network in (asked, alone):
        network.fly(2.0)
    first, second, ground = asked.ends
    assert len(first.all("LOCAL_POSITION_NED")) == 500 and not first.all("ATTITUDE_QUATERNION")
    usual = [(tick, m.get_type()) for tick, m in alone.ends[1].heard]
    assert [(tick, m.get_type()) for tick, m in second.heard] == usual
    assert len(ground.all("LOCAL_POSITION_NED")) == 2 and len(ground.all("GLOBAL_POSITION_INT")) == 10
    assert not ground.all("ODOMETRY") and not second.all("COMMAND_ACK") and len(first.all("COMMAND_ACK")) == 2


def system_of(message: Any) -> int:
    """The sender's, also of a message that pymavlink's dialect does not have."""
    return int(message.get_msgbuf()[5])


def test_each_link_has_its_own_sequence_numbers() -> None:
    network = Network(Profile.ONBOARD, Profile.GROUND)
    network.fly(3.0)
    for end in network.ends:
        gaps = np.diff([m.get_msgbuf()[4] for _, m in end.heard]) % 256
        assert len(gaps) > 50 and set(gaps.tolist()) == {1}


def test_the_first_links_bytes_are_the_same_with_others_beside_it() -> None:
    alone, accompanied = Vehicle(AIRFRAME, EMPTY, lockstep=True), Vehicle(AIRFRAME, EMPTY, lockstep=True)
    ground = accompanied.open_channel(Profile.GROUND)
    for _ in range(500):
        assert alone.advance() == accompanied.advance()
        assert accompanied.collect(ground) is not None


def test_a_link_that_comes_later_is_in_step() -> None:
    network = Network(Profile.ONBOARD)
    network.fly(0.1)
    network.ends.append(Station(network, 77, 190, Profile.ONBOARD))
    network.fly(1.0)
    early, late = ({t for t, m in end.heard if m.get_type() == "ODOMETRY" and t > 26} for end in network.ends)
    assert early == late and len(late) > 20


def test_a_list_goes_to_who_asked_and_a_change_to_all() -> None:
    network = Network(Profile.GROUND, Profile.GROUND)
    asker, other = network.ends
    asker.send(mavlink.MAVLink_param_request_list_message(1, 1))
    network.fly(1.0)
    assert len(asker.all("PARAM_VALUE")) == len(TABLE) + 1 and not other.all("PARAM_VALUE")
    asker.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_DISARM_LAND", 4.0, mavlink.MAV_PARAM_TYPE_REAL32))
    network.fly(0.004)
    assert [m.param_value for m in other.all("PARAM_VALUE")] == [4.0]


def test_what_the_shell_and_a_reset_change_is_told_to_all() -> None:
    network = Network(Profile.GROUND, Profile.GROUND)
    line = b"param set COM_DISARM_LAND 4\n"
    shell = mavlink.SERIAL_CONTROL_DEV_SHELL
    network.ends[0].send(mavlink.MAVLink_serial_control_message(shell, 0, 0, 0, len(line), [*line.ljust(70, b"\0")]))
    network.fly(0.01)
    for end in network.ends:
        assert [(m.param_id, m.param_value) for m in end.all("PARAM_VALUE")] == [("COM_DISARM_LAND", 4.0)]
        end.heard.clear()
    changed = ["CAL_MAG0_ROT", "COM_DISARM_LAND", "SYS_AUTOSTART"]
    for name in (changed[0], changed[2]):
        assert network.vehicle.parameters.set(name, 7) is None
    reset = mavlink.MAV_CMD_PREFLIGHT_STORAGE
    network.ends[0].send(mavlink.MAVLink_command_long_message(1, 1, reset, 0, 2, *(0.0,) * 6))
    network.fly(0.1)
    for end in network.ends:
        assert sorted(m.param_id for m in end.all("PARAM_VALUE")) == changed
        (told,) = [m.param_value for m in end.all("PARAM_VALUE") if m.param_id == "COM_DISARM_LAND"]
        assert told == 2.0


def test_two_lists_at_once_are_both_whole() -> None:
    network = Network(Profile.GROUND, Profile.GROUND)
    network.ends[0].send(mavlink.MAVLink_param_request_list_message(1, 1))
    network.fly(0.1)
    network.ends[1].send(mavlink.MAVLink_param_request_list_message(1, 1))
    network.fly(1.0)
    for end in network.ends:
        assert [m.param_id for m in end.all("PARAM_VALUE")] == ["_HASH_CHECK", *TABLE]


def test_texts_go_to_all() -> None:
    network = Network(Profile.ONBOARD, Profile.GROUND)
    network.fly(1.2)
    network.ends[0].send(
        mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, *(0.0,) * 6)
    )
    network.fly(0.1)
    assert [[m.text for m in end.all("STATUSTEXT")] for end in network.ends] == [["Armed"], ["Armed"]]


# --- routing ---


def test_heartbeats_go_to_all_others_and_a_command_to_whom_it_names() -> None:
    network = Network(Profile.ONBOARD, Profile.GROUND, Profile.GROUND)
    one, two, three = network.ends
    for end in network.ends:
        end.beat()
    network.fly(0.004)
    for end, own in zip(network.ends, (250, 249, 248), strict=True):
        assert {m.get_srcSystem() for m in end.all("HEARTBEAT")} == {1, 250, 249, 248} - {own}
    one.send(mavlink.MAVLink_command_long_message(249, 190, 31010, 0, *(0.0,) * 7))
    one.send(mavlink.MAVLink_command_long_message(99, 1, 31010, 0, *(0.0,) * 7))
    network.fly(0.1)
    assert [m.target_system for m in two.all("COMMAND_LONG")] == [249]
    assert not three.all("COMMAND_LONG") and not one.all("COMMAND_LONG") and not one.all("COMMAND_ACK")


def test_clocks_keys_and_what_is_for_the_vehicle_stay_on_their_link() -> None:
    network = Network(Profile.ONBOARD, Profile.GROUND)
    one, two = network.ends
    network.fly(0.004)
    two.beat()
    one.send(mavlink.MAVLink_timesync_message(0, 5))
    one.send(mavlink.MAVLink_setup_signing_message(0, 0, [1] * 32, 0))
    one.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0, 0, 0], 0, 0, 0, 0.5))
    network.fly(0.1)
    assert {system_of(m) for _, m in two.heard} == {1}
    assert [message.ts1 for message in one.all("TIMESYNC") if message.tc1] == [5], "one answer"


def test_nobody_speaks_as_the_vehicle() -> None:
    network = Network(Profile.ONBOARD, Profile.GROUND)
    forged = mavlink.MAVLink(None, 1, 1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 128, 77, 4, 3)
    network.vehicle.receive(beat.pack(forged), network.ends[0].channel)
    network.fly(0.1)
    assert {m.custom_mode for m in network.ends[1].all("HEARTBEAT")} == {network.vehicle.flight.mode.custom_mode}


def test_another_instance_is_another_system() -> None:
    network = Network(Profile.GROUND, identity=Identity(system=4))
    (end,) = network.ends
    for target in (1, 4):
        end.send(mavlink.MAVLink_command_long_message(target, 1, 31010, 0, *(0.0,) * 7))
    end.send(mavlink.MAVLink_param_request_read_message(4, 1, b"MAV_SYS_ID", -1))
    network.fly(0.1)
    assert {system_of(m) for _, m in end.heard} == {4}
    assert len(end.all("COMMAND_ACK")) == 1
    assert end.all("PARAM_VALUE")[0].get_msgbuf()[10:14] == b"\4\0\0\0"


# --- peers that come and go, over loopback ---


class Peers:
    """Links of a vehicle to real sockets."""

    def __init__(self, *listeners: Listener) -> None:
        self.vehicle = Vehicle(AIRFRAME, EMPTY)
        self.vehicle.close_channel(self.vehicle.channel)
        self.links = Links(self.vehicle, (), [(each, Profile.ONBOARD) for each in listeners], None, 0.0)
        self.now_s = 0.0

    def tick(self) -> None:
        self.now_s += 0.004
        self.links.receive(self.now_s)
        self.vehicle.step()
        self.links.send()

    def until_heard(self, end: socket.socket, name: str) -> Any:
        """The next message of a kind that comes to a socket."""
        reader = mavlink.MAVLink(None)
        end.settimeout(0.002)
        for _ in range(20_000):
            self.tick()
            try:
                data = end.recv(65535)
            except TimeoutError:
                continue
            for message in reader.parse_buffer(data) or []:
                if message.get_type() == name:
                    return message
        raise AssertionError(f"no {name}")


@contextmanager
def udp() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind((HOST, 0))
        yield end


PING = mavlink.MAVLink_ping_message(7, 3, 0, 0).pack(mavlink.MAVLink(None, 250, 190))


def test_any_number_speak_at_a_port_and_one_that_returns_from_another_is_answered_there() -> None:
    with ExitStack() as stack:
        known, one, two, again = (stack.enter_context(udp()) for _ in range(4))
        listener = UdpListener(HOST, 0, known.getsockname())
        peers = Peers(listener)
        assert peers.until_heard(known, "HEARTBEAT").get_srcSystem() == 1, "it is told before it has spoken"
        for end in (one, two, again):
            end.sendto(PING, (HOST, listener.port))
            assert peers.until_heard(end, "PING").seq == 3
        assert len(peers.links.links) == 4
        known.sendto(PING, (HOST, listener.port))
        assert peers.until_heard(known, "PING").seq == 3
        assert len(peers.links.links) == 4
        peers.now_s += links_module.SILENCE_S + 1.0
        peers.tick()
        assert [link.transport.peer for link in peers.links.links] == [f"{HOST}:{known.getsockname()[1]}"]
        one.sendto(PING, (HOST, listener.port))
        assert peers.until_heard(one, "PING").seq == 3
        peers.links.close()


def test_a_flood_of_new_addresses_takes_no_named_ones_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links_module, "_MOST_LINKS", 4)
    with ExitStack() as stack:
        known, *others = (stack.enter_context(udp()) for _ in range(12))
        listener = UdpListener(HOST, 0, known.getsockname())
        peers = Peers(listener)
        for end in others:
            end.sendto(PING, (HOST, listener.port))
            assert peers.until_heard(end, "PING").seq == 3
        assert len(peers.links.links) == 4
        assert peers.links.links[0].transport.peer == f"{HOST}:{known.getsockname()[1]}"
        peers.links.close()


def test_a_caller_that_hangs_up_ends_nothing(caplog: pytest.LogCaptureFixture) -> None:
    listener = TcpListener(HOST, 0)
    peers = Peers(listener)
    with socket.create_connection((HOST, listener.port)) as stays:
        with socket.create_connection((HOST, listener.port)) as leaves:
            peers.until_heard(leaves, "HEARTBEAT")
            assert len(peers.links.links) == 2
        while len(peers.links.links) > 1:
            peers.tick()
        stays.sendall(PING)
        assert peers.until_heard(stays, "PING").seq == 3
        assert "closed by the other end" in caplog.text
        with socket.create_connection((HOST, listener.port)) as back:
            back.sendall(PING)
            assert peers.until_heard(back, "PING").seq == 3
    peers.links.close()


def test_a_port_in_use_says_which_instance_to_take() -> None:
    first = open_instance(231, None, lockstep=False)
    try:
        with pytest.raises(TransportError, match="--instance 232"):
            open_instance(231, None, lockstep=False)
        ports = [listener.port for listener, _ in first.listeners if isinstance(listener, UdpListener)]
        assert ports == [14580 + 231, 18570 + 231]
    finally:
        first.close()


class Instance:
    """A vehicle at PX4's ports, and a companion at its own."""

    def __init__(self, number: int, stack: ExitStack) -> None:
        self.number = number
        self.vehicle = Vehicle(AIRFRAME, EMPTY, identity=Identity(number + 1))
        self.vehicle.close_channel(self.vehicle.channel)
        opened = open_instance(number, None, lockstep=False)
        stack.callback(opened.close)
        links = opened.links(self.vehicle)
        assert links is not None
        self.links = links
        self.end = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self.end.bind((HOST, 14540 + number))
        self.end.setblocking(False)
        self.heard: list[Any] = []
        self.sources: set[tuple[int, int]] = set()
        """System and port."""
        self._out, self._in = mavlink.MAVLink(None, number + 1, 191), mavlink.MAVLink(None)

    def tick(self) -> None:
        self.links.receive(0.0)
        self.vehicle.step()
        self.links.send()
        with suppress(BlockingIOError):
            while True:
                data, (_, port) = self.end.recvfrom(65535)
                messages = self._in.parse_buffer(data) or []
                self.heard += messages
                self.sources |= {(system_of(message), port) for message in messages}

    def send(self, message: Any) -> None:
        self.end.sendto(message.pack(self._out), (HOST, 14580 + self.number))

    def command(self, number: int, *params: float) -> None:
        rest = (0.0,) * (7 - len(params))
        self.send(mavlink.MAVLink_command_long_message(self.number + 1, 1, number, 0, *params, *rest))

    def all(self, name: str) -> list[Any]:
        return [message for message in self.heard if message.get_type() == name]


def test_two_instances_have_ids_ports_and_logs_of_their_own() -> None:
    with ExitStack() as stack:
        flies, rests = both = [Instance(number, stack) for number in (236, 237)]

        def fly(until: Callable[[], bool]) -> None:
            for _ in range(5000):
                for each in both:
                    each.tick()
                if until():
                    return
            raise AssertionError("not flown")

        for each in both:
            each.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION, 10_000)
        fly(lambda: flies.vehicle.tick > 300)
        flies.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(math.nan,) * 7)
        flies.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        fly(lambda: flies.vehicle.motion.position_ned[2] < -1.0)
        assert not rests.vehicle.flight.armed
        flies.command(mavlink.MAV_CMD_NAV_LAND)
        fly(lambda: not flies.vehicle.flight.armed)
        for each in both:
            each.send(mavlink.MAVLink_log_request_list_message(each.number + 1, 1, 0, 0xFFFF))
        fly(lambda: all(each.all("LOG_ENTRY") for each in both))
        assert [each.all("LOG_ENTRY")[0].num_logs for each in both] == [1, 0]
        for each in both:
            assert each.sources == {(each.number + 1, 14580 + each.number)}
            stamps = [message.time_boot_ms for message in each.all("LOCAL_POSITION_NED")][1:]
            assert len(stamps) > 500 and max(np.diff(stamps)) <= 12


def test_an_exposed_port_is_refused_and_nothing_stays_open() -> None:
    requests = [Request("udpin:127.0.0.1:0", Profile.ONBOARD), Request("udpin:0.0.0.0:0", Profile.GROUND)]
    with pytest.raises(TransportError, match="--insecure"):
        open_links(requests, None, insecure=False, lockstep=False)


def test_memory_links_are_named_from_the_start() -> None:
    near, far = Memory.pair()
    vehicle = Vehicle(AIRFRAME, EMPTY)
    links = Links(vehicle, [(near, Profile.GROUND)], (), None, 0.0)
    far.send(PING)
    assert links.receive(1e6) and not links.receive(2e6)
    vehicle.step()
    links.send()
    assert b"".join(iter(lambda: far.receive(0.0) or b"", b"")) and len(links.links) == 1


@contextmanager
def ended(process: "subprocess.Popen[bytes]") -> Iterator[None]:
    """A failure does not wait for the process."""
    try:
        yield
    except BaseException:
        process.kill()
        raise


def test_a_whole_process_is_px4s_instance() -> None:
    """System 234 to 14540 + 233, which it tells before it has heard anybody."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind((HOST, 14540 + 233))
        ear.settimeout(60.0)
        arguments = [sys.executable, "-m", "vehicle_sim", "--instance", "233", "--world", "empty"]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process, ended(process):
            data, address = ear.recvfrom(65535)
            assert address == (HOST, 14580 + 233)
            reader = mavlink.MAVLink(None)
            assert {system_of(m) for m in reader.parse_buffer(data)} == {234}
            with udp() as station:
                station.settimeout(60.0)
                station.sendto(PING, (HOST, 18570 + 233))
                while not any(m.get_type() == "PING" for m in reader.parse_buffer(station.recv(65535)) or []):
                    pass
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 0 and errors == b""
