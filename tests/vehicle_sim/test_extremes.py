"""Values that no world, vehicle or sensor has: a clear error that names file and key, or a flight."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.toml_files import ROOT, TomlFileError, find
from tests.vehicle_sim.foreign_pilot import EMPTY, ForeignPilot, airframe_with, world_with
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import MotionError, Vehicle


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("wind.mean_ned=[1e6, 0, 0]", r"wind\.mean_ned\[0\]"),
        ("wind.mean_ned=[0, 0, -101]", r"wind\.mean_ned\[2\]"),
        ("wind.turbulence_m_s=1e6", r"wind\.turbulence_m_s"),
        ("disturbance.force_ned=[0, 1e6, 0]", r"disturbance\.force_ned\[1\]"),
    ],
)
def test_a_wind_or_force_without_measure_is_refused_with_file_and_key(override: str, key: str) -> None:
    with pytest.raises(TomlFileError, match=rf"empty\.toml.*{key}"):
        world_with(override)


@pytest.mark.parametrize(
    "override",
    ["wind.mean_ned=[100, -100, -100]", "wind.turbulence_m_s=100", "disturbance.force_ned=[-1000, 0, -1000]"],
)
def test_the_strongest_wind_and_force_are_flown_in(override: str) -> None:
    """Nowhere in particular."""
    airframe = Airframe.load(find("vehicles", "paper_quad"), sensors="gnss")
    pilot = ForeignPilot(world_with(override), airframe=airframe, all_streams=True)
    pilot.fly(1.2)
    pilot.vehicle.flight.arm(force=True)
    pilot.vehicle.flight.take_off(2.0)
    pilot.fly(20.0)
    assert pilot.vehicle.time_ns > 21e9 and math.isfinite(pilot.height)


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("ground.foot_height_m=1e12", "ground.foot_height_m"),
        ("inner_loop.attitude_gain_1_s=[1.0, 1e300, 1.0]", "inner_loop.attitude_gain_1_s"),
        ("fence.radius_m=1e300", "fence.radius_m"),
        ("lidar.latency_s=1e300", "lidar.latency_s"),
        ("rotors.thrust_constant_ns2=1e-300", "rotors.thrust_constant_ns2"),
    ],
)
def test_a_vehicle_beyond_all_measures_is_refused_with_file_and_key(override: str, key: str) -> None:
    with pytest.raises(TomlFileError, match=rf"paper_quad\.toml: {key}"):
        airframe_with(override)


@pytest.mark.parametrize(
    "override",
    [
        "unmodelled.quadratic_drag_kg_m=[1e6, 1e6, 1e6]",
        "rotors.thrust_share=[1e6, 1e6, 1e6, 1e6]",
        "body.inertia_kgm2=[1e-9, 1e-9, 1e-9]",
    ],
)
def test_a_motion_that_runs_away_ends_with_its_time_and_reason(override: str) -> None:
    """Steps of 1 ms are too long for it. Its last state that was a number is the last one that is told."""
    vehicle = Vehicle(Airframe.load(find("vehicles", "paper_quad"), [override], "gnss"), EMPTY)
    vehicle.flight.take_off(2.0)
    vehicle.flight.arm(force=True)
    with pytest.raises(MotionError, match=r"at \d+\.\d+ s .*vehicle's or its world's file"):
        for _ in range(2500):
            vehicle.advance()
    assert all(map(math.isfinite, vehicle.summary().final_position_ned))


def test_what_a_battery_has_given_is_told_up_to_what_its_message_has_room_for() -> None:
    pilot = ForeignPilot(airframe=airframe_with("battery.idle_w=1e9"))
    pilot.interval(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 20_000)
    pilot.vehicle.tick = 100_000
    pilot.fly(0.1)
    told = pilot.last("BATTERY_STATUS")
    assert told.energy_consumed == told.current_consumed == 2**31 - 1


def test_no_pressure_is_left_above_the_air() -> None:
    airframe = Airframe.load(find("vehicles", "paper_quad"), sensors="gnss")
    pilot = ForeignPilot(world_with("origin.altitude_m=19999.0"), airframe=airframe)
    pilot.interval(mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE, 20_000)
    pilot.interval(mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, 20_000)
    pilot.vehicle.state[2] = -40_000.0
    pilot.fly(0.2)
    told = pilot.last("SCALED_PRESSURE")
    assert told.press_abs == pilot.last("HIGHRES_IMU").abs_pressure == 0.0
    assert told.temperature == -32768


@pytest.mark.parametrize(
    ("name", "wrong", "key"),
    [("noise", "1e6", r"\.noise"), ("position_noise", "[1e6, 1e6]", "position_noise"), ("strength", "1e6", "strength")],
)
def test_a_sensor_that_measures_nothing_is_refused_with_file_and_key(
    name: str, wrong: str, key: str, tmp_path: Path
) -> None:
    text = find("vehicles/sensors", "gnss").read_text()
    changed = re.sub(rf"^{name} = [^#\n]*", f"{name} = {wrong} ", text, count=1, flags=re.MULTILINE)
    assert changed != text
    (tmp_path / "odd.toml").write_text(changed)
    with pytest.raises(TomlFileError, match=rf"odd\.toml.*{key}"):
        Airframe.load(find("vehicles", "paper_quad"), sensors=str(tmp_path / "odd.toml"))


def test_the_program_says_it_in_a_line_after_its_summary() -> None:
    options = [
        "--set",
        "vehicle.unmodelled.quadratic_drag_kg_m=[1e6, 1e6, 1e6]",
        "--set",
        "world.wind.mean_ned=[99,0,0]",
    ]
    run = subprocess.run(
        [sys.executable, "-m", "vehicle_sim", *options, "--world", "empty", "--bind", "udpin:127.0.0.1:0"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 2
    assert re.fullmatch(r"vehicle-sim: at \S+ s the motion is beyond all bounds: .*", run.stderr.splitlines()[-1])
    assert json.loads(run.stdout)["outcome"] == "stopped"
