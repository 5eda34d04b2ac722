"""Flights with real flight controllers' simulations, where builds of them are named:

COURIER_PX4: the folder of a build of PX4 for SITL (it holds bin/px4 and etc), flown with its built-in simulation;
COURIER_ARDUCOPTER: the program arducopter of a build of ArduPilot for SITL, in its source tree.

They use PX4's ports of instance 7 and one free port. A machine that is busy with other things disturbs them.
"""

import math
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from protocol.framing import Framer
from protocol.messages import decode, dialect
from protocol.transport import Udp
from tests.flights.processes import Process, run
from tests.flights.shared import alone

_INSTANCE = 7
_PARAMETERS = {"GUID_OPTIONS": 8, "GUID_TIMEOUT": 1, "FS_GCS_ENABLE": 5, "MAV_GCS_SYSID": 1}
"""Parameters of ArduPilot: what the audit asks for."""
_ON_GROUND_S = 60.0


def px4(folder: Path, build: Path) -> list[str]:
    """The command; it sends to 14540 + instance."""
    return [
        str(build / "bin/px4"),
        "-d",
        "-i",
        str(_INSTANCE),
        "-w",
        str(folder),
        "-s",
        "etc/init.d-posix/rcS",
        str(build / "etc"),
    ]


def arducopter(folder: Path, build: Path) -> list[str]:
    """The command; it sends to the same port."""
    own = folder / "own.parm"
    own.write_text("".join(f"{name} {value}\n" for name, value in _PARAMETERS.items()))
    tree = build.resolve().parents[3]
    defaults = f"{tree / 'Tools/autotest/default_params/copter.parm'},{own}"
    link = f"--serial0=udpclient:127.0.0.1:{14540 + _INSTANCE}"
    return [str(build), "--model", "+", "--speedup", "1", "--defaults", defaults, link]


PEERS: dict[str, tuple[str, Callable[[Path, Path], list[str]]]] = {
    "PX4": ("COURIER_PX4", px4),
    "ArduCopter": ("COURIER_ARDUCOPTER", arducopter),
}
"""The environment variable of each, and its command."""


@pytest.fixture(params=PEERS)
def vehicle(request: pytest.FixtureRequest, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A vehicle that was just switched on; its name."""
    variable, command = PEERS[request.param]
    build = os.environ.get(variable)
    if build is None:
        pytest.skip(f"{variable} names no build of {request.param}")
    folder = tmp_path / "vehicle"
    folder.mkdir()
    environment = {**os.environ, "PX4_SIM_MODEL": "sihsim_quadx"}
    with (
        alone(tmp_path_factory, "firmware"),  # all have the same ports
        subprocess.Popen(
            command(folder, Path(build)),
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process,
    ):
        yield request.param
        process.terminate()


@contextmanager
def companion(logs: Path, mission: str, *more: str) -> Iterator[Process]:
    """A companion that flies it."""
    connect = f"udpin:127.0.0.1:{14540 + _INSTANCE}"
    options = ("--connect", connect, "--avoid", "none", "--log", str(logs), "--json", "--no-report", *more)
    with Process("companion", ("fly", mission, *options)) as process:
        yield process


@pytest.mark.parametrize("output", ["attitude", "rates"])
@pytest.mark.parametrize("mission", ["hover", "circle"])
def test_it_is_flown_landed_and_replayed(vehicle: str, mission: str, output: str, tmp_path: Path) -> None:
    with companion(tmp_path / "logs", mission, "--output", output) as flight:
        assert flight.end() == 0, flight.lines[-10:]
        report = flight.report()
    assert report["outcome"] == "flown" and report["landed"]
    assert max(report["tracking_rmse_m"]) < 0.3
    (log,) = (tmp_path / "logs").glob("*/flight.mcap")
    replayed = run("companion", "replay", str(log))
    assert replayed.returncode == 0 and "the same to the bit" in replayed.stdout


def test_a_vehicle_whose_companion_dies_comes_down_by_itself(vehicle: str, tmp_path: Path) -> None:
    """On its way at a steady height, with the output that is chosen for it: level enough, gently, and disarmed. The
    fall counts above the last metre: what is estimated at the touchdown may be anything.

    In a climb that is just ending it falls faster: the last thrust is held, and that was less than hovers.
    """
    with companion(tmp_path / "logs", "courier") as flight:
        flight.wait_for("route, step")
        flight.wait_for("courier: route, step")  # the status line, seconds later
        flight.kill()
    tilt, fall, armed = 0.0, 0.0, True
    framer, link = Framer(), Udp("127.0.0.1", 14540 + _INSTANCE, bind=True)
    end = time.monotonic() + _ON_GROUND_S
    while armed and time.monotonic() < end:
        for frame in framer.datagram(link.receive(1.0) or b""):
            message: Any = decode(frame)
            if frame.message_id == dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
                tilt = max(tilt, math.acos(1.0 - 2.0 * (message.q2**2 + message.q3**2)))
            elif frame.message_id == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED and message.z < -1.0:
                fall = message.vz
            elif frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT and frame.component == 1:
                armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    link.close()
    assert not armed, f"{vehicle} is armed {_ON_GROUND_S:g} s later"
    assert math.degrees(tilt) < 45.0 and fall < 1.0
