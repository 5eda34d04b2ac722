"""The vehicle for programs, and as an environment."""

import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vehicle_sim.gym
from protocol.toml_files import TomlFileError
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.gym import TargetEnv
from vehicle_sim.library import Setpoint, Simulation, State


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation()


def test_it_hovers_after_a_reset_and_falls_without_thrust(simulation: Simulation) -> None:
    state = simulation.reset(height=3.0)
    assert state.position_ned == pytest.approx([0.0, 0.0, -3.0], abs=0.3) and state.crash is None
    assert np.linalg.norm(state.velocity_ned) < 0.05 and state.clearance_m == np.inf
    hovers = simulation.step(Setpoint(thrust=simulation.hover_thrust), ticks=100)
    assert hovers.time_s == pytest.approx(state.time_s + 0.4)
    assert hovers.velocity_ned[2] == pytest.approx(state.velocity_ned[2], abs=0.1)
    falls = simulation.step(Setpoint(), ticks=75)
    assert falls.velocity_ned[2] - hovers.velocity_ned[2] == pytest.approx(9.81 * 0.3, rel=0.15)


def test_it_turns_as_it_is_told(simulation: Simulation) -> None:
    for axis, rate in ((0, 0.3), (1, -0.3), (2, 0.5)):
        simulation.reset()
        rates = [0.0, 0.0, 0.0]
        rates[axis] = rate
        state = simulation.step(Setpoint((rates[0], rates[1], rates[2]), simulation.hover_thrust), ticks=150)
        assert state.rates_frd == pytest.approx(rates, abs=0.05)
        assert 2.0 * state.attitude_ned_frd[1 + axis] == pytest.approx(rate * 0.6, rel=0.25)


def test_it_takes_off_with_its_first_fix() -> None:
    sensing = Simulation(vehicle_overrides=['estimator.sensors="gnss"'])
    state = sensing.reset(seed=3)
    assert state.position_ned == pytest.approx([0.0, 0.0, -3.0], abs=0.5)
    assert sensing.step(Setpoint(thrust=sensing.hover_thrust), ticks=50).position_ned[2] < -2.0


def test_the_seed_repeats_a_flight_and_nothing_is_left_of_the_one_before() -> None:
    noisy = Simulation(vehicle_overrides=['estimator.sensors="gnss"'])

    def flown(seed: int) -> State:
        noisy.reset(seed)
        return noisy.step(Setpoint((0.1, 0.0, 0.0), 0.5), ticks=50)

    first, other, again = flown(3), flown(4), flown(3)
    assert np.array_equal(first.position_ned, again.position_ned)
    assert not np.array_equal(first.position_ned, other.position_ned)


@pytest.mark.parametrize(("height", "mode"), [(0.0, "HOLD"), (-1.0, "HOLD"), (np.nan, "HOLD"), (500.0, "TAKEOFF")])
def test_a_height_that_is_not_reached_is_said(simulation: Simulation, height: float, mode: str) -> None:
    with pytest.raises(RuntimeError, match=f"did not get up to {height:g} m: it is in {mode}"):
        simulation.reset(height=height)


def test_it_says_when_setpoints_are_obeyed_no_more(simulation: Simulation) -> None:
    state = simulation.reset()
    assert state.armed and state.obeys
    simulation._flying.flight.set_mode(Mode.HOLD)
    state = simulation.step(Setpoint(thrust=simulation.hover_thrust))
    assert state.armed and not state.obeys


@pytest.mark.parametrize("vehicle", ["iris", "px4_sih", "x500"])
def test_a_file_for_the_companion_alone_is_no_vehicle_to_simulate(vehicle: str) -> None:
    with pytest.raises(TomlFileError, match=rf"{vehicle}\.toml: for the companion alone"):
        Simulation(vehicle)


def test_without_a_reset_there_is_nothing_to_step() -> None:
    with pytest.raises(RuntimeError, match="reset"):
        Simulation().step(Setpoint())


def test_the_environment_is_one_of_gymnasiums() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(TargetEnv(), skip_render_check=True)
    env: gymnasium.Env[Any, Any] = gymnasium.make("Courier-v0", world="neighbourhood")
    assert vehicle_sim.gym.HEIGHT == 3.0 and env.reset(seed=1)[0].shape == (14,)


def test_the_way_is_the_reward_and_a_crash_ends_it() -> None:
    env = TargetEnv()
    observation, _ = env.reset(seed=1, options={"target": (0.0, 0.0, 1.0)})
    assert observation[2] == pytest.approx(2.0, abs=0.3), "below: down"
    way, total, ended = float(np.linalg.norm(observation[:3])), 0.0, False
    for _ in range(500):
        observation, reward, ended, _, info = env.step(np.array([0.0, 0.0, 0.0, -1.0], np.float32))
        total += reward
        if ended:
            break
    assert ended and info["crash"] == "ground"
    assert total == pytest.approx(way - float(np.linalg.norm(observation[:3])) - 10.0, abs=1e-3)


def test_a_vehicle_that_obeys_no_more_cuts_the_episode_short() -> None:
    """Its battery called it home, say: that is none of the task."""
    env = TargetEnv()
    env.reset(seed=1)
    hover = np.array([0.0, 0.0, 0.0, 2.0 * env.simulation.hover_thrust - 1.0], np.float32)
    assert env.step(hover)[2:4] == (False, False)
    env.simulation._flying.flight.set_mode(Mode.HOLD)
    assert env.step(hover)[2:4] == (False, True)


def test_a_landing_ends_the_episode() -> None:
    env = TargetEnv()
    observation, _ = env.reset(seed=1, options={"target": (6.0, 0.0, 3.0)})
    hover, ended, info = 2.0 * env.simulation.hover_thrust - 1.0, False, dict[str, Any]()
    for _ in range(1500):
        down = env.simulation.state.position_ned[2] > -0.25
        thrust = -1.0 if down else float(np.clip(hover + 0.8 * (observation[5] - 0.3), -1.0, 1.0))
        observation, reward, ended, cut, info = env.step(np.array([0.0, 0.0, 0.0, thrust], np.float32))
        assert abs(reward) < 1.0 and not cut
        if ended:
            break
    assert ended and info["crash"] is None and not env.simulation.state.armed


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_action_that_is_not_finite_is_refused(bad: float) -> None:
    """The vehicle would take it for no setpoint, and leave OFFBOARD."""
    env = TargetEnv()
    env.reset(seed=1)
    with pytest.raises(ValueError, match="finite"):
        env.step(np.array([0.0, 0.0, 0.0, bad], np.float32))
    assert env.simulation.state.obeys


def test_the_programs_of_the_page_without_a_link_run(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "vehicle-sim.md").read_text()
    programs = re.findall(
        r"^```python\n((?:from|import) (?:vehicle_sim|gymnasium).*?)^```$", page, re.MULTILINE | re.DOTALL
    )
    assert len(programs) == 2
    for program in programs:
        exec(program, {})
    assert "None" in capsys.readouterr().out, "it hit nothing"
