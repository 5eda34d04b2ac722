"""The laws of this folder one after the other, in two compiled steps:

`acceleration_step`: disturbance observer -> prediction -> position law -> acceleration
`attitude_step`: acceleration -> thrust -> attitude -> rates or torque

Between the two steps the guard may change the acceleration.
"""

import math

import msgspec
import numpy as np

from companion.config import Settings
from companion.control import disturbance_observer, prediction
from companion.control.acceleration_step import LONGEST_STEP_S, acceleration_command
from companion.control.attitude_step import attitude_command, turn_otherwise
from companion.control.foreign import foreign_laws
from companion.control.lift_off import LiftOff
from companion.control.margin import Pace, pace_for, paced
from companion.control.parameters import PARAMETERS, SLOW_YAW_GAIN, controller_parameters, design_of, kept_tilt
from companion.control.torque_observer import TORQUE_OBSERVER
from companion.outputs import OUTPUTS
from companion.records import CONTROL_FIELDS
from companion.reports import LinkDelay, Motors
from companion.state import UNSAID, Certainty, Output, Reference, Setpoint, VehicleState
from protocol.arrays import Array
from protocol.frames import yaw_of
from protocol.vehicle_parameters import GRAVITY, VehicleParameters

MEMORY = np.dtype(
    [
        ("observer", disturbance_observer.OBSERVER),
        ("observer_before", disturbance_observer.OBSERVER),
        ("torque", TORQUE_OBSERVER),
        ("commands", prediction.COMMAND, prediction.HISTORY),
        ("count", "i8"),
        ("poses", prediction.POSE, prediction.HISTORY),
        ("poses_count", "i8"),
        ("time_ns", "i8"),
        ("adaptive_term", "f8", 3),
        ("integral", "f8", 3),
        ("reference_rates", "f8", 3),
        ("reference_turning", "f8", 3),
        ("rate_jump", "f8", 3),
        ("rate_jump_change", "f8", 3),
        ("flatness_guess", "f8", (3, 3)),
        ("limited", "b1"),
        # of the present step, from `acceleration_command` to `attitude_command`
        ("dt", "f8"),
        ("reference", "f8", (6, 3)),
        ("acceleration", "f8", 3),
        ("position", "f8", 3),
        ("velocity", "f8", 3),
        ("attitude", "f8", 4),
        ("rates", "f8", 3),
        ("turning", "f8", 3),
        ("e1", "f8", 3),
        ("e2", "f8", 3),
        ("velocity_error", "f8", 3),
        ("wanted", "f8", 3),
        ("attitude_error", "f8", 3),
        ("offset", "f8", 3),
        ("turning_reference", "f8", (3, 3)),
        ("disturbance", "f8", 3),
        ("thrust_scale", "f8"),
        ("drag_scale", "f8"),
    ],
    align=True,
)
"""What the controller remembers from step to step. `observer_before` is the observer as it was when the vehicle last
said how certain its estimate is; `turning` is an angular acceleration (rad/s2, FRD); `count` the number of commands
that were ever sent, `poses_count` that of poses; `rate_jump` and its `rate_jump_change` see `fade_jumps`;
`velocity_error` (m/s) and `wanted` (the reference's acceleration, m/s2) are what the position law takes, in the time
that it runs in; `offset` (rad/s2, FRD) is what is made up for at present; `attitude_error` (rad, FRD) and
`turning_reference` (a `_Turning`) what the attitude law takes."""

CONTROLLER = np.dtype([("parameters", PARAMETERS), ("memory", MEMORY)], align=True)

SIZE = sum(size for _, size in CONTROL_FIELDS)
ATTITUDE, RATES, TORQUE, THRUST = slice(15, 19), slice(19, 22), slice(22, 25), 25
"""Places in CONTROL_FIELDS."""


class Controller:
    """The controller of one flight."""

    def __init__(self, settings: Settings, body: VehicleParameters, output: Output) -> None:
        self._record = np.zeros(1, CONTROLLER)
        self._parameters, self._memory = self._record["parameters"], self._record["memory"]
        self._parameters[:] = controller_parameters(settings, body, output)
        self._acceleration = self._memory["acceleration"][0]
        disturbance_observer.reset(self._memory["observer"][0], self._parameters["initial_deviation"][0])
        self._memory["observer_before"] = self._memory["observer"]
        self._memory_bytes = self._memory.view(np.uint8)
        self._at_first = self._memory_bytes.copy()
        self._predicts = settings.control.prediction.enabled
        self._kept_tilt = kept_tilt(settings.limits)
        self._configured = self._parameters.copy()
        self.output = output
        self.delay = LinkDelay()
        """The link's delay, as it is flown with."""
        self.pace = Pace()
        """How fast the loops are with it."""
        self._acts_after_ns = self._counted_ns()
        self._lift_off, self._motors = LiftOff(settings.limits, body), Motors()
        self._foreign_position, self._foreign_attitude = foreign_laws(settings.control, self._parameters, self._memory)
        self._certainty = UNSAID
        self._lag_ns = round(body.rotor_time_constant_s * 1e9) if self._predicts else 0

    def use(self, output: Output) -> None:
        """Command this output from now on."""
        self.output = output
        self._configured["turning_input"] = self._parameters["turning_input"] = OUTPUTS[output].turning_input
        self._slow_down()

    def _counted_ns(self) -> int:
        return int(self._parameters["half_period_ns"][0] + self._parameters["command_delay_ns"][0])

    def follow(self, delay: LinkDelay) -> None:
        """Fly with this delay from now on: commands act so much later, and the loops are as fast as it allows."""
        self.delay = delay
        if self._predicts:
            self._parameters["command_delay_ns"] = self._configured["command_delay_ns"] + round(delay.command * 1e9)
        self._acts_after_ns = self._counted_ns()
        self._slow_down()

    def present(self, state: VehicleState, now_ns: int) -> VehicleState:
        """Where the vehicle will be when a command of now takes effect, if the link is late: as it was predicted at the
        last step, and moved on since. Without a delay the measured state itself."""
        if self.delay.total <= 0.0:
            return state
        m = self._memory[0]
        since = (now_ns - int(m["time_ns"])) * 1e-9
        if since > LONGEST_STEP_S:
            return state
        velocity = m["velocity"].copy()
        return msgspec.structs.replace(state, position_ned=m["position"] + since * velocity, velocity_ned=velocity)

    def _slow_down(self) -> None:
        """Slow the design down to the pace that the delay allows."""
        delay, left = self.delay.total, self.delay.unsteady
        if not self._predicts:
            delay, left = 0.0, delay + left
        law = None if self._foreign_position is None else self._foreign_position.small
        pace = pace_for(design_of(self._configured[0], law), delay, left)
        self._memory["integral"] *= (self._parameters["pace"] / pace.share) ** 2  # which gives what it has given
        self._parameters["pace"] = pace.share
        self._parameters["rates_gain"] = paced(self._configured["rates_gain"], pace.share, torque=False)
        self._parameters["torque_gain"] = paced(self._configured["torque_gain"], pace.share, torque=True)
        self.pace = pace

    def reset(self) -> None:
        """Forget the flight so far: nothing is flown."""
        self._memory_bytes[:] = self._at_first
        for law in (self._foreign_position, self._foreign_attitude):
            if law is not None:
                law.reset()

    def take_off(self) -> None:
        """The vehicle was armed on the ground."""
        self._lift_off.begin()

    def given_back(self, state: VehicleState, *, airborne: bool) -> None:
        """Others had the vehicle; see `LiftOff.given_back`."""
        self._lift_off.given_back(state, airborne=airborne)

    def flies(self, state: VehicleState, now_ns: int, mass: float, rises: bool, motors: Motors) -> bool:
        """Whether the vehicle is in the air; see `LiftOff.update`. Until then, `setpoint` gives the thrust to lift off
        with."""
        if motors is not self._motors:
            self._motors = motors
            self._parameters["angle_boost"] = motors.angle_boost
            if motors.own_loops:
                self._parameters["max_tilt"] = self._kept_tilt
            if motors.own_loops and self._configured["rates_gain"][0, 2, 0] > SLOW_YAW_GAIN:
                self._configured["rates_gain"][0, 2, 0] = SLOW_YAW_GAIN
                self._slow_down()
        if self._lift_off.thrust is None:
            return True
        scale = self._lift_off.update(state, now_ns, mass, rises, motors.spooling)
        if scale is not None and self._parameters["initial_deviation"][0, disturbance_observer.THRUST_SCALE] > 0.0:
            disturbance_observer.presume(self._memory["observer"][0], scale)
            self._memory["observer_before"] = self._memory["observer"]
        return scale is not None

    def reference_times(self, now_ns: int) -> tuple[int, int]:
        """The times of the two references of a step: when the command takes effect, and when the rotors will have
        followed it."""
        return now_ns + self._acts_after_ns, now_ns + self._acts_after_ns + self._lag_ns

    def acceleration_command(
        self, state: VehicleState, now_ns: int, measured_ns: int, reference: Reference, mass: float, airborne: bool
    ) -> Array:
        """The acceleration (3,) in m/s2, NED, that the position law commands.

        The state was measured at `measured_ns`; the reference is for the first of `reference_times`; `mass` in kg. The
        observer and the integrals run while `airborne`; where the reference is tied, those of north and east wait.
        """
        if state.certainty is not self._certainty:
            self._hear(state.certainty)
        measured = state.position_ned, state.velocity_ned, state.attitude_ned_frd, state.rates_frd
        rows = np.ascontiguousarray(reference.rows)
        times = now_ns, measured_ns, measured_ns - max(state.position_age_ns, 0)
        acceleration_command(measured, times, rows, mass, airborne, reference.tied, self._record)
        if self._foreign_position is not None:
            self._foreign_position.command(airborne)
        acceleration: Array = self._acceleration.copy()
        return acceleration

    def _hear(self, certainty: Certainty) -> None:
        """The vehicle has said how certain its estimate is. What was learned since it said so before is forgotten if it
        was reset meanwhile: a step of the estimate is no motion."""
        memory, resets = self._memory, certainty.resets != self._certainty.resets
        if resets:
            memory["observer"] = memory["observer_before"]
            disturbance_observer.reset_by_vehicle(memory["observer"])
        else:
            memory["observer_before"] = memory["observer"]
        self._parameters["velocity_variance"] = certainty.velocity_variance
        self._certainty = certainty

    def attitude_command(
        self, acceleration_ned: Array, now_ns: int, ahead: Reference, mass: float, changed: bool = False
    ) -> tuple[Array, bool]:
        """CONTROL_FIELDS (SIZE,) for an acceleration (3,) in m/s2, NED, and whether a limit on thrust or tilt was
        reached.

        State and reference are those of the last `acceleration_command`; `ahead` is the reference for the second of
        `reference_times`. `changed`: the acceleration is not the commanded one, so the integrals wait.
        """
        rows, out = np.ascontiguousarray(ahead.rows), np.empty(SIZE)
        limited = attitude_command(acceleration_ned, now_ns, rows, mass, changed, self._record, out)
        if self._foreign_attitude is not None:
            turn_otherwise(*self._foreign_attitude.command(limited or changed), self._record, out)
        return out, limited

    def setpoint(self, control: Array, *, idle: bool = False) -> Setpoint:
        """The part of CONTROL_FIELDS (SIZE,) that goes to the vehicle.

        `idle`: nothing is flown, and `control` is changed to one that moves nothing. With armed motors on the ground
        its thrust is that of the lift-off.
        """
        if idle:
            control[RATES] = control[TORQUE] = control[THRUST] = 0.0
        elif self._lift_off.thrust is not None:
            control[THRUST] = self._lift_off.thrust
            self._memory["commands"]["thrust_n"] = self._lift_off.thrust * self._parameters["full_thrust_n"][0]
        values = control.tolist()
        return Setpoint(values[ATTITUDE], values[RATES], values[TORQUE], values[THRUST])

    def level(self, mass: float) -> Setpoint:
        """Level on the latest heading, with the thrust that hovers; `mass` in kg."""
        half = 0.5 * yaw_of(self._memory["attitude"][0])
        scale = float(self._memory["observer"]["mean"][0, disturbance_observer.THRUST_SCALE])
        thrust = mass * GRAVITY / (scale * float(self._parameters["full_thrust_n"][0]))
        return Setpoint((math.cos(half), 0.0, 0.0, math.sin(half)), (0.0,) * 3, (0.0,) * 3, thrust)
