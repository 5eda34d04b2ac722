"""The command line: errors in one line, signals, and whole processes."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from protocol.compiling import TAKES
from protocol.toml_files import ROOT
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME
from tests.vehicle_sim.scripted_companion import UdpCompanion, hop, started
from vehicle_sim.cli import Options, app, load_files
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Summary


def test_the_command_line_loads_without_compiled_code() -> None:
    """So that --help is quick."""
    probe = (
        "import sys, vehicle_sim.cli; sys.exit(any(name in sys.modules for name in ('numba', 'numpy', 'pymavlink')))"
    )
    assert subprocess.run([sys.executable, "-c", probe], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--world", "atlantis"], ["atlantis", "neighbourhood"]),
        (["--vehicle", "zeppelin"], ["zeppelin", "paper_quad"]),
        (["--pace", "slowly"], ["slowly", "lockstep"]),
        (["--pace", "0"], ["--pace 0"]),
        (["--pace", "1e-300"], ["--pace 1e-300", "from 0.001 to 1000"]),
        (["--bind", "pigeon:1:2"], ["pigeon"]),
        (["--bind", "udpin:127.0.0.1"], ["udpin:127.0.0.1"]),
        (["--bind", "udpin:0.0.0.0:0"], ["udpin:0.0.0.0:0", "--signing-key", "--insecure"]),
        (["--bind", "tcpin:192.0.2.1:5760"], ["tcpin:192.0.2.1:5760", "--signing-key"]),
        (["--signing-key", "no/such/key"], ["no/such/key"]),
        (["--gcs", "udpin:0.0.0.0:0"], ["udpin:0.0.0.0:0", "--insecure"]),
        (["--firmware", "new"], ["--firmware new"]),
        (["--firmware", "1.256"], ["--firmware 1.256"]),
        (["--firmware", "999.9"], ["--firmware 999.9"]),
        (["--sensors", "eyes"], ["eyes", "gnss", "vio"]),
        (["--bind", "udpout:127.0.0.1:9", "--param", "NAV_DLL_ACT=9"], ["NAV_DLL_ACT", "out of range"]),
    ],
)
def test_a_wrong_option_is_one_line_and_exit_code_2(arguments: list[str], names: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert all(name in result.stderr for name in names)
    assert result.stdout == ""


def test_the_sensors_are_those_asked_for_or_of_the_file_or_gnss(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        (ROOT / "vehicles" / "paper_quad.toml").read_text(encoding="utf-8") + '\n[estimator]\nsensors = "rtk"\n',
        encoding="utf-8",
    )
    chosen = ['vehicle.estimator.sensors="perfect"']
    for options, sensors in (
        (Options(), "gnss"),
        (Options(sensors="vio"), "vio"),
        (Options(overrides=chosen), "perfect"),
        (Options(sensors="vio", overrides=chosen), "perfect"),
        (Options(vehicle=str(own)), "rtk"),
        (Options(vehicle=str(own), sensors="vio"), "vio"),
    ):
        assert load_files(options)[0].estimator.sensors == sensors


def test_to_warm_up_opens_nothing_and_flies_nothing() -> None:
    result = CliRunner().invoke(app, ["--warm-up", "--bind", "pigeon:1:2"])
    assert (result.exit_code, result.output) == (0, "")


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
    text = (ROOT / "vehicles" / "paper_quad.toml").read_text()
    assert "mass_kg = 1.3 " in text
    file = tmp_path / "odd.toml"
    file.write_text(text.replace("mass_kg = 1.3 ", f"{line} ", 1))
    result = CliRunner().invoke(app, ["--vehicle", str(file)])
    assert result.exit_code == 2
    assert "odd.toml" in result.stderr
    assert key in result.stderr


def test_on_a_cold_cache_it_says_that_it_compiles(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    arguments = [sys.executable, "-m", "vehicle_sim", "--warm-up", "--world", "empty"]
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, env=environment) as process:
        assert process.stderr is not None
        assert process.stderr.readline().decode().strip() == TAKES
        process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_its_summary(number: signal.Signals) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(60.0)
        url = f"udpout:127.0.0.1:{ear.getsockname()[1]}"
        arguments = [sys.executable, "-m", "vehicle_sim", "--bind", url, "--pace", "lockstep", "--world", "empty"]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            ear.recv(65535)
            process.send_signal(number)
            out, errors = process.communicate(timeout=30.0)
    assert process.returncode == 0
    assert set(errors.decode().splitlines()) <= {TAKES}, "which is said where nothing has been compiled yet"
    summary = json.loads(out)
    assert summary["outcome"] == "stopped"
    assert set(summary) == set(Summary.__dataclass_fields__)


def test_overrides_and_truth_of_a_whole_process(tmp_path: Path) -> None:
    file = tmp_path / "truth.npy"
    with started(UdpCompanion(hop)) as companion:
        url = f"udpout:127.0.0.1:{companion.port}"
        arguments = ["--bind", url, "--pace", "lockstep", "--once", "--world", "empty", "--truth", str(file)]
        changes = ["--set", "vehicle.body.mass_kg=2.0", "--set", "world.wind.mean_ned=[0, 3, 0]"]
        done = subprocess.run(
            [sys.executable, "-m", "vehicle_sim", *arguments, *changes], capture_output=True, text=True, check=True
        )
    summary = json.loads(done.stdout)
    assert summary["outcome"] == "landed"
    rows = np.load(file)
    assert (rows["time_ns"] == TICK_NS * np.arange(1, len(rows) + 1)).all()
    assert rows["time_ns"][-1] * 1e-9 == pytest.approx(summary["simulated_s"])
    assert (rows["wind_ned"] == (0.0, 3.0, 0.0)).all()
    # at rest on its feet it has sunk in by its weight
    ground = AIRFRAME.ground
    sunk_m = (2.0 + AIRFRAME.body.parcel_mass_kg) * GRAVITY / (4.0 * ground.stiffness_n_m)
    assert -rows["state"][10, 2] == pytest.approx(ground.foot_height_m - sunk_m, abs=1e-6)


@pytest.mark.parametrize(
    ("override", "names"),
    [
        ("body.mass_kg=2", ["body.mass_kg=2", "vehicle.KEY", "world.KEY"]),
        ("vehicle.body.mass_kg=heavy", ["paper_quad.toml", "body.mass_kg"]),
        ("vehicle.body.mass_kg=9", ["paper_quad.toml", "body.rotor_max_thrust_n"]),
        ("vehicle.body.mas_kg=2", ["paper_quad.toml", "mas_kg"]),
        ("vehicle.telemetry.delay_s=-0.1", ["paper_quad.toml", "telemetry.delay_s"]),
        ("world.wind.mean_ned=[1, 2]", ["neighbourhood.toml", "wind.mean_ned"]),
        ("world.wind.mean_ned=[1, 2, inf]", ["neighbourhood.toml", "wind.mean_ned[2]"]),
        ("world.wind.turbulence_m_s=-1", ["neighbourhood.toml", "wind.turbulence_m_s"]),
        ("world.disturbance.force=[1, 0, 0]", ["neighbourhood.toml", "disturbance"]),
        ("world.=3", ["world.=3"]),
        ("vehicle", ["--set vehicle"]),
    ],
)
def test_a_wrong_override_is_one_line(override: str, names: list[str]) -> None:
    result = CliRunner().invoke(app, ["--set", override])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert all(name in result.stderr for name in names)
