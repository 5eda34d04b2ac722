"""An unmodified MAVProxy flies the simulated vehicle, in real time and at five times its speed.

It is installed without vtk and opencv, which its maps need alone."""

import os
import queue
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Self

import pytest
from pyulog import ULog

from protocol.toml_files import ROOT
from tests.vehicle_sim.mission_uploader import Row, at
from tests.vehicle_sim.served import HOST, PATIENCE_S, served
from vehicle_sim.services.parameter_table import TABLE
from vehicle_sim.services.profiles import Profile

PROGRAM = Path(sys.executable).with_name("mavproxy.py")
PAGE = (ROOT / "docs" / "vehicle-sim.md").read_text(encoding="utf-8")
TAKEOFF, WAYPOINT, LAND, CORNER, RALLY = 22, 16, 21, 5001, 5100
MODULES = "link,log,wp,rally,fence,param,arm,cmdlong"


class Console:
    """Its prompt: what is typed, and what it has said."""

    def __init__(self, port: int, folder: Path) -> None:
        if not PROGRAM.is_file():
            pytest.skip(f"{PROGRAM} is not there")
        command = [
            sys.executable,
            "-u",  # it is read as it speaks
            str(PROGRAM),
            f"--master=udpout:{HOST}:{port}",
            f"--default-modules={MODULES}",
            "--state-basedir=.",
        ]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, cwd=folder)
        self._said: queue.Queue[str] = queue.Queue()
        self._text = ""
        threading.Thread(target=self._read, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def _read(self) -> None:
        assert self.process.stdout is not None
        while data := os.read(self.process.stdout.fileno(), 4096):
            self._said.put(data.decode("ascii", "replace"))

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Until it has said this since the last time."""
        while (found := re.search(pattern, self._text)) is None:
            try:
                self._text += self._said.get(timeout=PATIENCE_S)
            except queue.Empty:
                raise AssertionError(f"not said: {pattern}: {self._text[-500:]}") from None
        self._text = self._text[found.end() :]
        return found

    def shown(self, name: str) -> float:
        """A parameter. It is told of a change a moment after it has asked for it."""
        return float(self.type(f"param show {name}", rf"{name}\s+([-.\d]+)\s")[1])

    def type(self, line: str, answer: str) -> re.Match[str]:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())
        self.process.stdin.flush()
        return self.wait_for(answer)


@pytest.fixture(params=[1.0, 5.0])
def console(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Console]:
    with (
        served(request.param, profile=Profile.GROUND) as vehicle,
        Console(vehicle.port, tmp_path) as console,
    ):
        console.wait_for(f"Received {len(TABLE)} parameters")
        yield console


def save(path: Path, *rows: Row) -> str:
    """A file of its form."""
    lines = ["QGC WPL 110"]
    for number, (command, _, params, x, y, z) in enumerate(rows):
        numbers = [0.0 if each != each else each for each in params]
        lines.append("\t".join(map(str, (number, 0, 3, command, *numbers, x * 1e-7, y * 1e-7, z, 1))))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def test_it_sets_parameters_and_flies_a_mission_within_a_fence(console: Console, tmp_path: Path) -> None:
    assert console.shown("MPC_XY_CRUISE") == 5.0
    for name, value in (("MPC_XY_CRUISE", 4.0), ("COM_OBL_RC_ACT", 3.0)):
        console.type(f"param set {name} {value:g}", "")
        assert any(console.shown(name) == value for _ in range(1000)), name
    corners = [at(CORNER, n, e, 0.0, 4.0) for n, e in ((90.0, 90.0), (-90.0, 90.0), (-90.0, -90.0), (90.0, -90.0))]
    items = (
        at(TAKEOFF, 0.0, 0.0, 5.0),
        at(WAYPOINT, 9.0, 0.0, 5.0),
        at(WAYPOINT, 9.0, 7.0, 5.0),
        at(LAND, 0.0, 0.0, 0.0),
    )
    console.type(f"wp load {save(tmp_path / 'items', *items)}", "TYPE_MISSION: ACCEPTED")
    console.type("wp list", "Saved 4 waypoints")
    console.type(f"fence load {save(tmp_path / 'corners', *corners)}", "TYPE_FENCE: ACCEPTED")
    console.type("fence list", "Saved 4 fence")
    console.type(f"rally load {save(tmp_path / 'rally', at(RALLY, 5.0, 0.0, 9.0))}", "TYPE_RALLY: ACCEPTED")
    console.type("rally list", "Saved 1 rally")
    console.type("log list", "No logs")
    console.type("long MAV_CMD_DO_SET_MODE 1 4 4", "DO_SET_MODE: ACCEPTED")
    console.type("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED")
    console.wait_for("Landing detected")
    console.wait_for("Disarmed by landing")
    size = int(console.type("log list", r"Log 0  numLogs 1 lastLog 0 size (\d+)")[1])
    console.type(f"log download 0 {tmp_path / 'flight.ulg'}", f"Finished downloading .*{size} bytes")
    assert "Landing detected" in [each.message for each in ULog(str(tmp_path / "flight.ulg")).logged_messages]


def test_the_commands_of_the_page_fly(console: Console) -> None:
    match = re.search(r"```text\n(.*?)```", PAGE, re.DOTALL)
    assert match is not None
    take_off, arm, land = match[1].splitlines()
    console.type(take_off, "DO_SET_MODE: ACCEPTED")
    console.type(arm, "COMPONENT_ARM_DISARM: ACCEPTED")
    console.wait_for("Takeoff height reached")
    console.type("long MAV_CMD_DO_SET_MODE 1 4 5", "DO_SET_MODE: ACCEPTED")
    console.type("long MAV_CMD_DO_SET_MODE 1 4 3", "DO_SET_MODE: ACCEPTED")
    console.type(land, "DO_SET_MODE: ACCEPTED")
    console.wait_for("Disarmed by landing")
