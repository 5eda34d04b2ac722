"""The simulated vehicle for programs: `reset`, then `step` by step, without sockets or clocks.

It is the vehicle of `vehicle-sim`, flown in OFFBOARD by the same messages; only the states that are handed out are the
true ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.arrays import Array
from protocol.messages import Encoder, dialect
from protocol.toml_files import find
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.physics.rigid_body import ATTITUDE, POSITION, RATES, VELOCITY
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

_LONGEST_CLIMB = 15_000
"""Ticks: a minute."""
_AT_REST_M_S = 0.05
_RATES_ONLY = dialect.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What the vehicle is to do until the next one."""

    rates_frd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad/s"""
    thrust: float = 0.0
    """0 to 1, of all there is."""


@dataclass(frozen=True, slots=True)
class State:
    """How the vehicle truly moves."""

    time_s: float
    """Since its start."""
    position_ned: Array
    """(3,) m"""
    velocity_ned: Array
    """(3,) m/s"""
    attitude_ned_frd: Array
    """(4,) quaternion w, x, y, z."""
    rates_frd: Array
    """(3,) rad/s"""
    clearance_m: float
    """From the hull to the nearest obstacle; inf without obstacles."""
    crash: str | None
    """What the vehicle hit."""
    armed: bool
    """False once its motors are off, as they are soon after a landing."""
    obeys: bool
    """It follows setpoints. False once it has left OFFBOARD, as for a low battery, or is not armed any more."""


class Simulation:
    """A vehicle in a world, by the names or paths of their files, with overrides as "body.mass_kg=0.9". Raises
    TomlFileError."""

    def __init__(
        self,
        vehicle: str = "paper_quad",
        world: str = "empty",
        *,
        vehicle_overrides: Sequence[str] = (),
        world_overrides: Sequence[str] = (),
    ) -> None:
        self.airframe = Airframe.load(find("vehicles", vehicle), vehicle_overrides)
        """The vehicle's file."""
        self.world = World.load(find("worlds", world), world_overrides)
        """The obstacles and the air."""
        self._encoder = Encoder(1, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
        self._vehicle: Vehicle | None = None

    @property
    def hover_thrust(self) -> float:
        """The thrust at which the loaded vehicle hovers."""
        return self.airframe.body.hover_thrust * self.airframe.takeoff_mass_kg / self.airframe.body.mass_kg

    def reset(self, seed: int = 0, height: float = 3.0) -> State:
        """Begin anew: the vehicle takes off by itself, hovers at a height (m), and obeys setpoints from then on.

        `seed`: of all noise. Raises RuntimeError if it does not get there.
        """
        self._vehicle = vehicle = Vehicle(self.airframe, self.world, seed=seed)
        flight = vehicle.flight
        for _ in range(_LONGEST_CLIMB):
            if not vehicle.estimator.position_lost:  # until the first fix
                break
            vehicle.step()
        flight.take_off(height)
        flight.arm(force=True)
        for _ in range(_LONGEST_CLIMB):
            vehicle.step()
            at_rest = float(np.linalg.norm(vehicle.state[VELOCITY])) < _AT_REST_M_S
            if (flight.mode is Mode.HOLD and at_rest) or flight.crash is not None:
                break
        if flight.mode is Mode.HOLD and not flight.landed:
            self._send(vehicle, Setpoint(thrust=self.hover_thrust))
            flight.set_mode(Mode.OFFBOARD)
        if flight.mode is not Mode.OFFBOARD:
            raise RuntimeError(f"the vehicle did not get up to {height:g} m: it is in {flight.mode.name}")
        return self.state

    def step(self, setpoint: Setpoint, ticks: int = 1) -> State:
        """Fly so many ticks of 4 ms on a setpoint, if the vehicle still obeys it. Raises RuntimeError before
        `reset`."""
        vehicle = self._flying
        for _ in range(ticks):
            self._send(vehicle, setpoint)
            vehicle.step()
        return self.state

    @property
    def state(self) -> State:
        """At present. Raises RuntimeError before `reset`."""
        vehicle = self._flying
        state = vehicle.state.copy()
        clearance = vehicle.world.clearance(state[POSITION]) - self.airframe.hull.radius_m
        motion = state[POSITION], state[VELOCITY], state[ATTITUDE], state[RATES]
        armed, offboard = vehicle.flight.armed, vehicle.flight.mode is Mode.OFFBOARD
        return State(vehicle.tick * TICK_NS * 1e-9, *motion, clearance, vehicle.flight.crash, armed, armed and offboard)

    @property
    def _flying(self) -> Vehicle:
        if self._vehicle is None:
            raise RuntimeError("reset comes first")
        return self._vehicle

    def _send(self, vehicle: Vehicle, setpoint: Setpoint) -> None:
        level = np.array([1.0, 0.0, 0.0, 0.0])
        fields = (0, 1, 1, _RATES_ONLY, level, *setpoint.rates_frd, setpoint.thrust)
        vehicle.receive(self._encoder.encode_fields(dialect.MAVLink_set_attitude_target_message, *fields))
