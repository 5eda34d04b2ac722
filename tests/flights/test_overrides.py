"""`--set` and `--truth` of the demo: what goes to the simulator alone, what to the companion, what is left behind."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.runtime.files import load_mission
from protocol.compiling import TAKES
from protocol.flightlog import LogReader
from protocol.toml_files import find
from protocol.vehicle_parameters import GRAVITY
from tests.flights.processes import run
from vehicle_sim.airframe import Airframe

AIRFRAME = Airframe.load(find("vehicles", "paper_quad"))


def test_a_vehicle_other_than_the_companion_thinks(tmp_path: Path) -> None:
    """It is heavier and sees itself late; the log says so, and the truth beside it has the rotors of that weight."""
    given = [
        'vehicle.estimator.sensors="perfect"',
        "vehicle.body.mass_kg=1.35",
        "vehicle.telemetry.delay_s=0.012",
        "mission.takeoff_height=3",
        "rates.scan=10",
    ]
    given += ["mission.waypoints=[{north=0.0, east=0.0, height=3.0, hold_s=3.0}]"]
    options = [part for override in given for part in ("--set", override)]
    done = run("companion", "demo", "hover", "--truth", "--json", "--log", str(tmp_path), "--avoid", "paper", *options)
    assert done.returncode == 0, done.stderr
    path = Path(json.loads(done.stdout)["log"])
    log = LogReader(path)
    assert json.loads(log.metadata["flight"]["overrides"]) == [*given, 'avoidance.method="paper"']
    flown_with = json.loads(log.attachments["settings.json"])
    assert flown_with["rates"]["scan"] == 10 and flown_with["avoidance"]["method"] == "paper"
    rows = np.load(path.parent / "truth.npy")
    height = -rows["state"][:, 2]
    assert height.max() == pytest.approx(3.0, abs=0.5)
    hovering = (height > 2.7) & (np.abs(rows["state"][:, 3:6]).max(axis=1) < 0.02)
    thrust = AIRFRAME.rotors.thrust_constant_ns2 * (rows["state"][hovering, 13:17] ** 2).sum(axis=1)
    assert len(thrust) > 100
    parcel = AIRFRAME.body.parcel_mass_kg
    assert np.median(thrust) == pytest.approx((1.35 + parcel) * GRAVITY, rel=0.005)
    attitude = log.array("/mavlink/1/1/ATTITUDE_QUATERNION")
    in_flight = attitude[len(attitude) // 2 :]
    assert set(in_flight["time_ns"] // 1_000_000 - in_flight["time_boot_ms"]) == {12}


def test_a_mission_is_changed_before_it_is_checked() -> None:
    flown, path = load_mission("hover", ["speed=7", "vehicle=sun_quad"])
    assert (flown.speed, flown.vehicle, path.name) == (7.0, "sun_quad", "hover.toml")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["fly", "hover", "--set", "vehicle.body.mass_kg=2"], ["vehicle", "vehicle-sim --set"]),
        (["fly", "hover", "--set", "world.wind.turbulence_m_s=2"], ["world", "vehicle-sim --set"]),
        (["demo", "hover", "--set", "mission.sped=8"], ["hover.toml", "sped"]),
        (["demo", "hover", "--set", "mission.speed=-8"], ["hover.toml", "speed"]),
        (["demo", "hover", "--set", "sped=8"], ["settings", "sped"]),
    ],
)
def test_what_can_not_be_is_one_line_and_exit_code_2(tmp_path: Path, arguments: list[str], names: list[str]) -> None:
    done = run("companion", *arguments, "--log", str(tmp_path))
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.count("\n") == 1
    assert all(name in done.stderr for name in names)
    assert not list(tmp_path.iterdir())


def test_what_the_simulator_refuses_is_said_and_nothing_is_flown(tmp_path: Path) -> None:
    done = run("companion", "demo", "hover", "--log", str(tmp_path), "--set", "world.wind.mean=[1, 0, 0]")
    assert done.returncode == 2
    assert "empty.toml with --set" in done.stderr and "did you mean wind.mean_ned?" in done.stderr
    assert "the simulator did not start" in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_on_a_machine_that_must_compile_first_it_is_said_before(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "companion", "demo", "hover", "--log", str(tmp_path / "logs")]
    command += ["--set", "world.wind.mean=[1, 0, 0]"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cold")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "did you mean wind.mean_ned?" in done.stderr.splitlines()[-1]
    assert TAKES not in done.stderr
