"""What a world does to the vehicle, how late the vehicle tells it, and the truth beside: closed forms and bytes."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from protocol.toml_files import TomlFileError, find
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, LAND, ForeignPilot, tilted
from tests.vehicle_sim.test_vehicle_runner import UdpCompanion, hop
from vehicle_sim import truth
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.cli import app
from vehicle_sim.integrate import TICK_NS, scratch, step
from vehicle_sim.rigid_body import POSITION, RATES, ROTORS, STATES, VELOCITY
from vehicle_sim.truth import TRUTH, Truth
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World, WorldTable

VEHICLES = sorted(find("vehicles", "paper_quad").parent.glob("*.toml"))
POSES = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: "ATTITUDE_QUATERNION",
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: "LOCAL_POSITION_NED",
    mavlink.MAVLINK_MSG_ID_ODOMETRY: "ODOMETRY",
    mavlink.MAVLINK_MSG_ID_ATTITUDE: "ATTITUDE",
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: "GLOBAL_POSITION_INT",
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: "GPS_RAW_INT",
}
PRESENT = {
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: "HIL_STATE_QUATERNION",
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: "SERVO_OUTPUT_RAW",
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: "ATTITUDE_TARGET",
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: "OBSTACLE_DISTANCE",
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: "BATTERY_STATUS",
}


def world_with(*overrides: str) -> World:
    return World.load(find("worlds", "empty"), overrides)


def airframe_with(*overrides: str) -> Airframe:
    return Airframe.load(find("vehicles", "paper_quad"), overrides)


# --- wind and force ---------------------------------------------------------------------------------------------------


def test_a_hovering_body_is_carried_off_until_it_drifts_with_the_wind() -> None:
    """Level, at the thrust that hovers: velocity goes to the wind's as 1 - exp(-k t / m) on each axis."""
    p = parameters(AIRFRAME)
    wind = np.array([6.0, -4.0, 1.0])
    p["wind_ned"] = wind
    state, room = np.zeros(STATES), scratch()
    state[2], state[6] = -5000.0, 1.0
    state[ROTORS] = math.sqrt(AIRFRAME.takeoff_mass_kg * GRAVITY / 4.0 / AIRFRAME.rotors.thrust_constant_ns2)
    told = state[ROTORS].copy()
    k = np.array(AIRFRAME.body.drag_kg_s) / AIRFRAME.takeoff_mass_kg
    for seconds in (1.0, 99.0):
        before = state[VELOCITY].copy()
        for _ in range(round(seconds * 1000.0)):
            step(state, told, p, 1e-3, room)
        assert state[VELOCITY] == pytest.approx(wind + (before - wind) * np.exp(-k * seconds), abs=1e-9)
    assert state[VELOCITY] == pytest.approx(wind, abs=1e-9)


def test_a_constant_force_accelerates_a_falling_body_exactly() -> None:
    p = parameters(AIRFRAME)
    p["drag_kg_s"] = 0.0
    force = np.array([5.0, -2.0, 1.0])
    p["force_ned"] = force
    state, room = np.zeros(STATES), scratch()
    state[2], state[6], state[RATES] = -100.0, 1.0, (2.0, 1.0, -0.5)  # whatever way it turns
    for _ in range(1500):
        step(state, np.zeros(4), p, 1e-3, room)
    acceleration = force / AIRFRAME.takeoff_mass_kg + (0.0, 0.0, GRAVITY)
    assert state[VELOCITY] == pytest.approx(acceleration * 1.5, abs=1e-9)
    assert state[POSITION] - (0.0, 0.0, -100.0) == pytest.approx(0.5 * acceleration * 1.5**2, abs=1e-9)


def test_force_of_a_world_pushes_from_take_off_to_landing() -> None:
    """In hold the vehicle leans against it, held off by what its two gains give; on the ground it stands still."""
    push = 3.0
    pilot = ForeignPilot(world_with(f"disturbance.force_ned=[0.0, {push}, 0.0]"))
    pilot.fly(1.0)
    assert pilot.vehicle.motion.speed < 1e-9
    pilot.take_off()
    pilot.fly(8.0)
    auto, mass = AIRFRAME.auto, AIRFRAME.takeoff_mass_kg
    pushed_m = push / mass / (auto.position_gain_1_s * auto.velocity_gain_1_s)
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((0.0, pushed_m), abs=0.01)
    assert pilot.vehicle.motion.tilt == pytest.approx(math.atan(push / (mass * GRAVITY)), abs=1e-3)
    pilot.set_mode(LAND)
    assert pilot.fly(20.0, until=lambda: pilot.vehicle.flight.landed)
    pilot.fly(1.0)
    assert pilot.vehicle.motion.speed < 1e-3


def test_mean_wind_of_a_world_leans_the_vehicle_against_its_drag() -> None:
    pilot = ForeignPilot(world_with("wind.mean_ned=[-5.0, 0.0, 0.0]"))
    pilot.take_off()
    pilot.fly(8.0)
    drag, mass = 5.0 * AIRFRAME.body.drag_kg_s[0], AIRFRAME.takeoff_mass_kg
    assert pilot.vehicle.motion.tilt == pytest.approx(math.atan(drag / (mass * GRAVITY)), rel=0.03)
    _, _, pitch, _ = pilot.vehicle.motion.attitude_ned_frd
    assert pitch < 0.0  # nose down, into the wind from the north


def test_turbulence_of_a_world_repeats_and_leaves_the_lidars_noise_alone() -> None:
    ring = mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
    calm, gusty, again = (
        ForeignPilot(world_with(f"wind.turbulence_m_s={w20}"), seed=4, all_streams=True) for w20 in (0.0, 6.0, 6.0)
    )
    for pilot in (calm, gusty, again):
        pilot.fly(1.2)
        assert pilot.interval(ring, 0) == mavlink.MAV_RESULT_ACCEPTED
        pilot.take_off()
        pilot.fly(2.0)
    assert gusty.datagrams == again.datagrams
    at = [pilot.all("OBSTACLE_DISTANCE")[0].distances for pilot in (calm, gusty)]
    assert at[0] == at[1]
    assert gusty.vehicle.motion.position_ned != calm.vehicle.motion.position_ned


# --- delay ------------------------------------------------------------------------------------------------------------


def flown_late(delay_s: float) -> dict[str, list[bytes]]:
    """A flight told late: the payloads of each message in turn."""
    pilot = ForeignPilot(airframe=airframe_with(f"telemetry.delay_s={delay_s}"), seed=2)
    for message_id in (*POSES, *PRESENT):
        pilot.interval(message_id, 4000)
    pilot.take_off()

    def lean() -> None:
        pilot.attitude(tilted(0.2, (0.3, 1.0, 0.2)))

    pilot.go_offboard(lean)
    pilot.fly(1.0, lean)
    names = (*POSES.values(), *PRESENT.values())
    return {name: [bytes(message.get_payload()) for message in pilot.all(name)] for name in names}


@pytest.mark.parametrize(("delay_s", "ticks"), [(0.004, 1), (0.025, 7), (0.028, 7), (0.03, 8)])
def test_poses_are_those_of_a_while_ago_and_everything_else_is_of_now(delay_s: float, ticks: int) -> None:
    """Byte for byte, times included, what an undelayed vehicle on the same flight said so many ticks before."""
    prompt, late = flown_late(0.0), flown_late(delay_s)
    for name in POSES.values():
        assert len(late[name]) > 1500
        assert late[name][ticks:] == prompt[name][:-ticks]
        assert late[name][-1] != prompt[name][-1]
    for name in PRESENT.values():
        assert len(late[name]) > 100
        assert late[name] == prompt[name]


def test_the_vehicles_clock_is_not_delayed() -> None:
    pilot = ForeignPilot(airframe=airframe_with("telemetry.delay_s=0.1"))
    pilot.fly(2.0)
    pilot.send(mavlink.MAVLink_timesync_message(0, 77))
    pilot.fly(0.004)
    assert pilot.last("TIMESYNC").tc1 == 2_000_000_000


# --- the truth --------------------------------------------------------------------------------------------------------


def test_truth_is_the_state_and_the_wind_of_every_tick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(truth, "_BLOCK", 64)
    file = tmp_path / "truth.npy"
    world = world_with("wind.mean_ned=[4.0, 0.0, 0.0]", "wind.turbulence_m_s=5.0")
    recorder = Truth(file)
    vehicle = Vehicle(AIRFRAME, world, truth=recorder)
    states = []
    for _ in range(200):
        vehicle.advance()
        states.append(vehicle.state.copy())
    recorder.write()
    rows = np.load(file)
    assert rows.dtype == TRUTH
    assert (rows["time_ns"] == TICK_NS * np.arange(1, 201)).all()
    assert (rows["state"] == np.array(states)).all()
    assert len(np.unique(rows["wind_ned"], axis=0)) == 200
    assert rows["wind_ned"].mean(axis=0) == pytest.approx((4.0, 0.0, 0.0), abs=4.0)


def test_a_delayed_position_is_found_in_the_truth_at_its_time(tmp_path: Path) -> None:
    file = tmp_path / "truth.npy"
    recorder = Truth(file)
    vehicle = Vehicle(airframe_with("telemetry.delay_s=0.02"), EMPTY, truth=recorder)
    vehicle.telemetry.set_interval(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 4000)
    reader = mavlink.MAVLink(None)
    said: list[Any] = []
    vehicle.state[VELOCITY] = (1.0, 2.0, -8.0)  # thrown up
    for _ in range(300):
        for datagram in vehicle.advance():
            said += [m for m in reader.parse_buffer(datagram) or [] if m.get_type() == "LOCAL_POSITION_NED"]
    recorder.write()
    rows = np.load(file)
    told = said[10:]
    at = np.searchsorted(rows["time_ns"], [message.time_boot_ms * 1_000_000 for message in told])
    assert rows["time_ns"][at].tolist() == [message.time_boot_ms * 1_000_000 for message in told]
    position = np.array([(m.x, m.y, m.z, m.vx, m.vy, m.vz) for m in told])
    assert (rows["state"][at, 0:6].astype(np.float32) == position).all()
    assert len(np.unique(position[:, 2])) == len(told)


def test_a_truth_that_can_not_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(TomlFileError, match=r"gone/truth\.npy"):
        Truth(tmp_path / "gone" / "truth.npy")
    full = Truth(Path("/dev/full"))
    for tick in range(1000):
        full.record(tick, np.zeros(STATES), np.zeros(3))
    with pytest.raises(TomlFileError, match="/dev/full"):
        full.write()


# --- command line -----------------------------------------------------------------------------------------------------


def test_overrides_and_truth_of_a_whole_process(tmp_path: Path) -> None:
    file = tmp_path / "truth.npy"
    with UdpCompanion(hop) as companion:
        url = f"udpout:127.0.0.1:{companion.port}"
        arguments = ["--bind", url, "--pace", "lockstep", "--once", "--world", "empty", "--truth", str(file)]
        changes = ["--set", "vehicle.body.mass_kg=2.0", "--set", "world.wind.mean_ned=[0, 3, 0]"]
        done = subprocess.run(
            [sys.executable, "-m", "vehicle_sim", *arguments, *changes], capture_output=True, text=True, check=True
        )
    assert json.loads(done.stdout)["outcome"] == "landed"
    rows = np.load(file)
    assert len(rows) == len(set(companion.heard))
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
def test_an_override_that_can_not_be_is_one_line(override: str, names: list[str]) -> None:
    result = CliRunner().invoke(app, ["--set", override])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert all(name in result.stderr for name in names)


# --- the files --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
def test_what_a_companion_may_know_agrees_with_what_flies(path: Path) -> None:
    """`[body]` says again, for the companion, what other tables tell the simulator."""
    airframe = Airframe.load(path)
    rotors, inner = airframe.rotors, airframe.inner_loop
    mean = 0.5 * (rotors.time_constant_up_s + rotors.time_constant_down_s)
    assert airframe.body.rotor_time_constant_s == pytest.approx(mean)
    assert airframe.body.rate_loop_gain_1_s == inner.rate_gain_1_s
    assert inner.attitude_gain_1_s[:2] == (airframe.body.attitude_loop_gain_1_s,) * 2


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
@pytest.mark.parametrize("axis", range(3))
def test_rate_loop_of_every_vehicle_follows_its_model(path: Path, axis: int) -> None:
    """A step of the rate overshoots as k / (tau s^2 + s + k) does, no more, and it hovers on with it."""
    airframe = Airframe.load(path)
    k, tau = airframe.inner_loop.rate_gain_1_s[axis], airframe.body.rotor_time_constant_s
    damping = 1.0 / (2.0 * math.sqrt(k * tau))
    assert damping >= 0.5
    pilot = ForeignPilot(airframe=airframe)
    pilot.take_off()
    pilot.go_offboard()
    asked = (0.3 * (axis == 0), 0.3 * (axis == 1), 0.3 * (axis == 2))
    peak = 0.0

    def turn() -> None:
        nonlocal peak
        peak = max(peak, pilot.vehicle.motion.rates_frd[axis])
        pilot.rates(asked)

    pilot.fly(0.5, turn)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)) if damping < 1.0 else 0.0
    assert peak / 0.3 - 1.0 == pytest.approx(overshoot, abs=0.04)


def test_worlds_without_the_tables_are_calm() -> None:
    table = msgspec.convert(
        {"name": "calm", "origin": {"latitude_deg": 0.0, "longitude_deg": 0.0, "altitude_m": 0.0}}, WorldTable
    )
    world = World.build(table)
    assert world.wind.mean_ned == (0.0, 0.0, 0.0) == world.force_ned
    assert world.wind.turbulence_m_s == 0.0
