"""The runner and the command line, over real UDP on loopback, with a companion in a thread or a process beside."""

import collections
import contextlib
import itertools
import json
import math
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from protocol.transport import Udp
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, OFFBOARD
from vehicle_sim import runner
from vehicle_sim.cli import app
from vehicle_sim.runner import Runner
from vehicle_sim.vehicle import Summary, Vehicle, warm_up

TICK_NS = 4_000_000
UNSET = math.nan


Script = Callable[[int], list[object] | None]


class Companion:
    """Answers each tick with what `script(tick)` says; None from it means silence."""

    def __init__(self, script: Script, *, deaf_to: int = 0) -> None:
        self._script = script
        self._deaf_to = deaf_to
        self._reader, self._writer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 191)
        self.heard: list[bytes] = []
        self.texts: list[str] = []

    def hear(self, datagram: bytes) -> bytes | None:
        """The answer to a datagram."""
        self.heard.append(datagram)
        if len(self.heard) <= self._deaf_to:
            return None
        out = None
        for message in self._reader.parse_buffer(datagram) or []:
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            if message.get_type() != "TIMESYNC" or message.tc1 != 0:
                continue
            answers = self._script(message.ts1 // TICK_NS)
            if answers is not None:
                answers.append(mavlink.MAVLink_timesync_message(message.ts1 + 1, message.ts1))
                out = b"".join(answer.pack(self._writer) for answer in answers)  # type: ignore[attr-defined]
        return out


class UdpCompanion(threading.Thread):
    """A companion on a socket of its own."""

    def __init__(self, script: Script) -> None:
        super().__init__(daemon=True)
        self._companion = Companion(script)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]

    @property
    def texts(self) -> list[str]:
        return self._companion.texts

    @property
    def heard(self) -> list[bytes]:
        """Without what was sent again because an answer took long: that is as busy as the machine is."""
        return [datagram for datagram, _ in itertools.groupby(self._companion.heard)]

    def run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                datagram, address = self._socket.recvfrom(65535)
                if (answer := self._companion.hear(datagram)) is not None:
                    self._socket.sendto(answer, address)

    def __enter__(self) -> "UdpCompanion":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes its thread
        self._socket.close()


class Patient:
    """A transport to a companion in this thread, and the clock: time passes only in waiting for what does not come."""

    preserves_datagrams = True
    peer = "memory:companion"

    def __init__(self, companion: Companion) -> None:
        self._companion = companion
        self._answers: collections.deque[bytes] = collections.deque()
        self._now_s = 0.0

    def monotonic(self) -> float:
        return self._now_s

    def send(self, data: bytes) -> None:
        if (answer := self._companion.hear(data)) is not None:
            self._answers.append(answer)

    def receive(self, timeout_s: float) -> bytes | None:
        if self._answers:
            return self._answers.popleft()
        self._now_s += timeout_s
        return None

    def lock(self) -> None:
        """There is nobody else."""

    def close(self) -> None:
        """Nothing to give back."""


def command(number: int, *params: float) -> object:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *(0.0,) * (7 - len(params)))


def hop(tick: int) -> list[object]:
    """Up, and as soon as that is high enough to be a flight, down again."""
    if tick == 300:
        return [command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7), command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)]
    return [command(mavlink.MAV_CMD_NAV_LAND)] if tick == 500 else []


def offboard_until(last: int) -> Script:
    """Up, then hover in OFFBOARD; after some tick, silence."""

    def script(tick: int) -> list[object] | None:
        if tick > last:
            return None
        out = hop(tick) if tick < 500 else []
        if tick > 400:
            thrust = AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n
            out.append(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0, 0, 0], 0, 0, 0, thrust))
        if tick == 1000:
            out.append(command(mavlink.MAV_CMD_DO_SET_MODE, 1, OFFBOARD >> 16))
        return out

    return script


def fly_lockstep(companion: UdpCompanion) -> Summary:
    """Over UDP."""
    vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=True)
    transport = Udp("127.0.0.1", companion.port, bind=False)
    try:
        Runner(vehicle, transport, once=True).run_lockstep()
    finally:
        transport.close()
    return vehicle.summary()


@pytest.fixture
def fly(monkeypatch: pytest.MonkeyPatch) -> Callable[[Companion], Summary]:
    """Flies in lockstep with a companion in this thread, by its clock."""

    def flight(companion: Companion) -> Summary:
        vehicle, transport = Vehicle(AIRFRAME, EMPTY, lockstep=True), Patient(companion)
        monkeypatch.setattr(runner, "time", transport)
        Runner(vehicle, transport, once=True).run_lockstep()
        return vehicle.summary()

    return flight


@pytest.fixture(scope="module", autouse=True)
def warm() -> None:
    warm_up(AIRFRAME, EMPTY)


def test_a_flight_in_lockstep_ends_with_its_last_words_heard() -> None:
    with UdpCompanion(hop) as companion:
        summary = fly_lockstep(companion)
        assert (summary.outcome, summary.contacts) == ("landed", 0)
        assert summary.flight_time_s > 1.0
        assert "Disarmed by landing" in companion.texts
        ticks = round(summary.simulated_s * 1e9) // TICK_NS
        assert len(companion.heard) >= ticks


def test_lockstep_repeats_over_udp_and_in_memory(fly: Callable[[Companion], Summary]) -> None:
    heard = []
    for _ in range(2):
        with UdpCompanion(hop) as companion:
            fly_lockstep(companion)
            heard.append(companion.heard)
    in_memory = Companion(hop)
    fly(in_memory)
    assert heard[0] == heard[1] == in_memory.heard


def test_the_first_tick_is_sent_again_until_somebody_answers(fly: Callable[[Companion], Summary]) -> None:
    companion = Companion(hop, deaf_to=2)
    summary = fly(companion)
    assert companion.heard[0] == companion.heard[1] == companion.heard[2] != companion.heard[3]
    assert summary.outcome == "landed"


def test_without_its_companion_the_vehicle_holds_and_lands_alone(fly: Callable[[Companion], Summary]) -> None:
    companion = Companion(offboard_until(1200))
    summary = fly(companion)
    assert summary.outcome == "landed"
    assert summary.simulated_s > 1200 * 0.004 + 6.0
    assert companion.heard[1199] != companion.heard[1200]
    again = [datagram == companion.heard[1200] for datagram in companion.heard[1200:]]
    assert sum(again) == runner.LOST_S / runner.RESEND_S  # sent again before it was given up
    assert all(again[: sum(again)])
    assert {"Failsafe: offboard stream lost, holding", "Failsafe: offboard stream lost, landing"} <= set(
        companion.texts
    )


def test_a_companion_that_comes_back_is_waited_for_again(fly: Callable[[Companion], Summary]) -> None:
    silent = offboard_until(1200)
    answered: list[int] = []

    def script(tick: int) -> list[object] | None:
        if 1200 < tick < 1300:
            return silent(tick)
        answered.append(tick)
        return silent(tick) if tick <= 1200 else []

    summary = fly(Companion(script))
    assert summary.outcome == "landed"
    after = [tick for tick in answered if tick >= 1300]
    assert after == list(range(1300, after[-1] + 1))
    assert len(after) > 1000  # it flew on for seconds, each tick of them answered


def test_a_late_companion_still_flies_with_a_factor() -> None:
    """No lockstep: time passes by itself, 25 times as fast; commands come when they come."""
    vehicle = Vehicle(AIRFRAME, EMPTY)
    port_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    port_socket.bind(("127.0.0.1", 0))
    port_socket.settimeout(10.0)
    writer, reader = mavlink.MAVLink(None, 1, 191), mavlink.MAVLink(None)
    results: dict[int, int] = {}

    def companion() -> None:
        with contextlib.suppress(OSError):
            while True:
                datagram, address = port_socket.recvfrom(65535)
                for message in reader.parse_buffer(datagram) or []:
                    if message.get_type() == "COMMAND_ACK":
                        results[message.command] = message.result
                    if message.get_type() != "ATTITUDE_QUATERNION" or message.time_boot_ms < 1100:
                        continue
                    for number, params in ((22, (UNSET,) * 7), (400, (1.0,)), (21, ())):
                        if number not in results and (number != 21 or message.time_boot_ms > 3000):
                            port_socket.sendto(command(number, *params).pack(writer), address)  # type: ignore[attr-defined]

    thread = threading.Thread(target=companion, daemon=True)
    thread.start()
    transport = Udp("127.0.0.1", port_socket.getsockname()[1], bind=False)
    Runner(vehicle, transport, once=True).run_timed(25.0)
    transport.close()
    port_socket.close()
    assert vehicle.summary().outcome == "landed"
    assert results == {22: 0, 400: 0, 21: 0}


def test_nobody_there_is_no_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "UNHEARD_S", 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        for lockstep in (True, False):
            vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=lockstep)
            transport = Udp("127.0.0.1", silent.getsockname()[1], bind=False)
            flight = Runner(vehicle, transport, once=True)
            flight.run_lockstep() if lockstep else flight.run_timed(1.0)
            transport.close()
            assert vehicle.summary().outcome == "stopped"


def test_who_was_heard_and_left_before_the_start_is_not_waited_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "UNHEARD_AGAIN_S", 0.3)
    monkeypatch.setattr(runner, "UNHEARD_S", 1000.0)
    for lockstep in (True, False):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as brief:
            brief.bind(("127.0.0.1", 0))
            vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=lockstep)
            transport = Udp("127.0.0.1", brief.getsockname()[1], bind=False)
            transport.send(b"here")
            brief.sendto(b"here, too", brief.recvfrom(64)[1])
            flight = Runner(vehicle, transport, once=True)
            flight.run_lockstep() if lockstep else flight.run_timed(1.0)
            transport.close()
        assert vehicle.summary().outcome == "stopped"


def test_compiling_before_the_start_is_no_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    with UdpCompanion(hop) as companion:
        vehicle = Vehicle(AIRFRAME, EMPTY, lockstep=True)
        transport = Udp("127.0.0.1", companion.port, bind=False)
        long_ago = time.monotonic() - 10.0 * runner.UNHEARD_S
        with monkeypatch.context() as then:
            then.setattr(time, "monotonic", lambda: long_ago)
            flight = Runner(vehicle, transport, once=True)
        flight.run_lockstep()
        transport.close()
    assert vehicle.summary().outcome == "landed"


# --- command line ---


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--world", "atlantis"], ["atlantis", "neighbourhood"]),
        (["--vehicle", "zeppelin"], ["zeppelin", "paper_quad"]),
        (["--pace", "slowly"], ["slowly", "lockstep"]),
        (["--pace", "0"], ["--pace 0"]),
        (["--bind", "pigeon:1:2"], ["pigeon"]),
        (["--bind", "udpin:127.0.0.1"], ["udpin:127.0.0.1"]),
    ],
)
def test_what_can_not_be_is_one_line_and_exit_code_2(arguments: list[str], names: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert all(name in result.stderr for name in names)
    assert result.stdout == ""


def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        result = CliRunner().invoke(app, ["--bind", url])
    assert result.exit_code == 2
    assert url in result.stderr


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("mass_kg = -1.0", "body.mass_kg"),
        ("mass_kg = 9.0", "body.rotor_max_thrust_n"),
        ("mass_kg = 1.3\nwings = 2", "wings"),
    ],
)
def test_an_impossible_vehicle_names_file_and_key(tmp_path: Path, line: str, key: str) -> None:
    text = (Path(__file__).parents[2] / "vehicles" / "paper_quad.toml").read_text()
    assert "mass_kg = 1.3 " in text
    file = tmp_path / "odd.toml"
    file.write_text(text.replace("mass_kg = 1.3 ", f"{line} ", 1))
    result = CliRunner().invoke(app, ["--vehicle", str(file)])
    assert result.exit_code == 2
    assert "odd.toml" in result.stderr
    assert key in result.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_its_summary(number: signal.Signals) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(120.0)
        url = f"udpout:127.0.0.1:{ear.getsockname()[1]}"
        arguments = [sys.executable, "-m", "vehicle_sim", "--bind", url, "--pace", "lockstep", "--world", "empty"]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            ear.recv(65535)
            process.send_signal(number)
            out, errors = process.communicate(timeout=120.0)
    assert process.returncode == 0
    assert errors == b""
    summary = json.loads(out)
    assert summary["outcome"] == "stopped"
    assert set(summary) == set(Summary.__dataclass_fields__)
