"""The recorded truth: the state and the wind of every tick."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.toml_files import TomlFileError
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, airframe_with, world_with
from vehicle_sim import truth
from vehicle_sim.physics.rigid_body import STATES, VELOCITY
from vehicle_sim.timing import TICK_NS
from vehicle_sim.truth import TRUTH, TruthRecorder
from vehicle_sim.vehicle import Vehicle


def test_truth_is_the_state_and_the_wind_of_every_tick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(truth, "_BLOCK_TICKS", 64)
    file = tmp_path / "truth.npy"
    world = world_with("wind.mean_ned=[4.0, 0.0, 0.0]", "wind.turbulence_m_s=5.0")
    recorder = TruthRecorder(file)
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
    recorder = TruthRecorder(file)
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


def test_a_truth_file_that_can_not_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(TomlFileError, match=r"gone/truth\.npy"):
        TruthRecorder(tmp_path / "gone" / "truth.npy")
    full = TruthRecorder(Path("/dev/full"))
    for tick in range(1000):
        full.record(tick, np.zeros(STATES), np.zeros(3))
    with pytest.raises(TomlFileError, match="/dev/full"):
        full.write()
