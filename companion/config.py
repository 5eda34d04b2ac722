"""The companion's settings as frozen, checked records. Every default stands here or in the files `config_*.py` beside
this one, and nowhere else."""

import math
from typing import Annotated

import msgspec

from companion.config_avoidance import Avoidance
from companion.config_limits import Battery, Geofence
from companion.config_types import LEAST, Count, Fraction, NotNegative, Positive, Table, one_of
from companion.plugins import Kind, Options, Plugin, options_for, plugin

Vector = tuple[Positive, Positive, Positive]
Turning = Annotated[float, msgspec.Meta(ge=LEAST, le=1e12)]
"""deg/s or deg/s2; the paper's vehicle turns at once."""
Weight = Annotated[float, msgspec.Meta(ge=1e-6, le=1e6)]
"""Between these there is a solution of the Riccati equation, however they are mixed."""
Weights = tuple[Weight, Weight, Weight]
Bandwidth = Annotated[float, msgspec.Meta(ge=0.01, le=1000)]
NonNegativeVector = tuple[NotNegative, NotNegative, NotNegative]

POSITION_LAWS = ("backstepping", "se3", "sliding_mode", "pid")
"""The names in `control.laws.LAWS`."""


class PositionControl(Table, frozen=True):
    """Position law. Vectors are north, east, down. The paper's c7, c9, c11 are `c1`, its c8, c10, c12 (all 1 there) are
    `c2`."""

    law: str = "backstepping"
    """"backstepping", for comparison "se3", "sliding_mode" or "pid", or a law of another package (docs/extend.md)."""
    options: Options = msgspec.field(default_factory=dict)
    """Settings of the law, if it is one of another package."""
    c1: Vector = (2.5, 2.5, 2.5)
    """1/s; gain on the position error of backstepping."""
    c2: Vector = (2.5, 2.5, 2.5)
    """1/s; gain on the error of the virtual rate of backstepping."""
    feedforward: str = "acceleration"
    """What of the reference is fed forward: "none", "velocity", or "acceleration" (and velocity)."""
    adaptation: NonNegativeVector = (0.3, 0.3, 0.3)
    """1/s2; gain (gamma) of the adaptive (integral) term of backstepping; 0: the paper's law."""
    adaptation_bound: Positive = 3.0
    """m/s2; bound of the adaptive term on each axis."""
    drag_compensation: bool = True
    """Compensate the drag of the `[body]` table, which the paper's model lacks."""

    def __post_init__(self) -> None:
        options_for(self.plugin, self.options)
        one_of("feedforward", self.feedforward, "none", "velocity", "acceleration")

    @property
    def plugin(self) -> Plugin | None:
        """The law, if it is one of another package."""
        return plugin(Kind.POSITION_LAW, "law", self.law, POSITION_LAWS)


ATTITUDE_LAWS = ("lqr",)


class AttitudeControl(Table, frozen=True):
    """LQR of the attitude: roll, pitch, yaw."""

    law: str = "lqr"
    """Or a law of another package (docs/extend.md)."""
    options: Options = msgspec.field(default_factory=dict)
    """Settings of the law, if it is one of another package."""
    angle_weight: Weights = (400.0, 400.0, 50.0)
    """Weights of the angles on the diagonal of Q (8)."""
    rate_weight: Weights = (1.0, 1.0, 1.0)
    """Weights of the rates on the diagonal of Q (8)."""
    input_weight: Weights = (1.0, 1.0, 1.0)
    """Weights of the inputs on the diagonal of R."""
    bandwidth: tuple[Bandwidth, Bandwidth, Bandwidth] | None = None
    """rad/s; replaces angle and rate weights by the rule of `control.lqr.weights_for`."""
    damping: Annotated[float, msgspec.Meta(ge=0.7072, le=2)] = 0.8
    """Damping ratio for that rule."""
    design: str = "continuous"
    """"continuous": the paper's; "sampled": in discrete time, with the rotors' lag in the plant."""
    feedforward: bool = True
    """Feed forward the reference's rates and angular acceleration, from its jerk and snap."""

    def __post_init__(self) -> None:
        options_for(self.plugin, self.options)
        one_of("design", self.design, "continuous", "sampled")

    @property
    def plugin(self) -> Plugin | None:
        """The law, if it is one of another package."""
        return plugin(Kind.ATTITUDE_LAW, "law", self.law, ATTITUDE_LAWS)


OUTPUT_MESSAGES = ("standard",)


class OutputControl(Table, frozen=True):
    """The message that carries what is commanded; which layer that is, `--output` says."""

    message: str = "standard"
    """"standard": SET_ATTITUDE_TARGET, of actuators SET_ACTUATOR_CONTROL_TARGET; or what a package's output makes
    (docs/extend.md)."""
    options: Options = msgspec.field(default_factory=dict)
    """Settings of the output, if it is one of another package."""

    def __post_init__(self) -> None:
        options_for(self.plugin, self.options)

    @property
    def plugin(self) -> Plugin | None:
        """The output, if it is one of another package."""
        return plugin(Kind.OUTPUT, "message", self.message, OUTPUT_MESSAGES)


class Prediction(Table, frozen=True):
    """Prediction of the state from its measurement to the time when the command takes effect."""

    enabled: bool = True
    command_delay: NotNegative = 0.0
    """s from sending a command to its effect, in addition to half of the period for which it is held."""
    longest: Positive = 0.5
    """s; older telemetry is treated as being of this age."""
    overdue: NotNegative = 0.04
    """s; where the latest attitude is older than usual by so much more, commands may be as much later. Attitudes are
    commanded then, whatever the output is, until the link's delay is known again: the vehicle keeps an attitude by
    itself, while rates turn it on and on. 0: never."""
    attitudes_beyond: Positive = 0.15
    """s; with a longer delay, there and back, attitudes are commanded, whatever the output is."""
    told_every: NotNegative = 5.0
    """s; how late the link is said to be, and has become, at most so often: on a busy computer it changes many times a
    second."""


class Estimation(Table, frozen=True):
    """Disturbance observer (`control.disturbance_observer`): estimates of what the model lacks, from the velocity.
    Walks are standard deviations of random walks, per square root of a second."""

    thrust_scale: bool = True
    """Estimate the scale of the thrust, which changes with mass, battery and propellers."""
    drag_scale: bool = True
    """Estimate the scale of the drag."""
    disturbance: bool = True
    """Estimate a disturbing acceleration."""
    torque_bandwidth: NotNegative = 2.0
    """1/s; so fast a disturbing torque is estimated (`control.torque_observer`), as of a weak rotor or a centre of mass
    aside, and made up for; 0: not at all."""
    velocity_noise: Positive = 0.02
    """m/s; the least standard deviation of a measured velocity. What the innovations show beyond it is added."""
    velocity_correlation: NotNegative = 0.2
    """s; for so long an error of the vehicle's velocity lasts, whose variance it says (`rates.odometry`)."""
    velocity_settling: NotNegative = 0.5
    """s; so slowly the difference between the vehicle's velocity and the rate of its position is learned and made up
    for (`companion.velocity_match`); 0: not at all."""
    acceleration_noise: Positive = 0.1
    """m/s2; walk of the velocity."""
    thrust_scale_walk: NotNegative = 0.005
    """Walk of the thrust's scale."""
    climb_uncertainty: NotNegative = 0.1
    """s/m; the share of the thrust's scale that is in doubt when a climb or descent has become slower by 1 m/s: rotors
    that climb give less thrust, and drag along their axis is little known."""
    drag_scale_walk: NotNegative = 0.1
    """Walk of the drag's scale, at speed; it rests where the vehicle hovers."""
    disturbance_walk: NotNegative = 1.0
    """m/s2; walk of the disturbance."""
    disturbance_fading: NotNegative = 2.0
    """1/s; rate at which a vertical disturbance falls back to 0. What lasts is put down to the thrust's scale: at hover
    the two can't be told apart."""


class GeometricControl(Table, frozen=True):
    """Gains of `law = "se3"`, divided by the mass; north, east, down."""

    position_gain: Vector = (7.25, 7.25, 7.25)
    """1/s2"""
    velocity_gain: Vector = (5.0, 5.0, 5.0)
    """1/s"""


class SlidingModeControl(Table, frozen=True):
    """Gains of `law = "sliding_mode"`; north, east, down."""

    slope: Vector = (2.5, 2.5, 2.5)
    """1/s; of the sliding surface."""
    gain: Vector = (4.0, 4.0, 4.0)
    """m/s2; acceleration of the reaching law."""
    boundary: Positive = 1.0
    """m/s; boundary layer around the sliding surface."""


class PidControl(Table, frozen=True):
    """Gains of `law = "pid"`; north, east, down."""

    proportional: Vector = (7.25, 7.25, 7.25)
    """1/s2"""
    integral: NonNegativeVector = (2.0, 2.0, 2.0)
    """1/s3"""
    derivative: Vector = (5.0, 5.0, 5.0)
    """1/s"""


STEEPEST_DEG = 85.0
"""Steeper limits are none: the vertical part of the thrust, which has priority, would be too small a part of it."""


class Limits(Table, frozen=True):
    """Limits of the commands to the vehicle."""

    tilt_deg: Annotated[float, msgspec.Meta(ge=LEAST, le=180)] = 45.0
    """The vehicle's. A vehicle whose file lacks `rate_loop_gain_1_s`, and ArduPilot, is commanded 92 %: they swing. At
    most 85, or 180: no limit, as a loop needs; on outputs rates and actuators."""
    tilt_braking_deg: Positive = 900.0
    """deg/s2; the angular acceleration that the vehicle surely has to stop at the tilt limit. ArduPilot limits its own
    to ATC_ACCEL_R_MAX and ATC_ACCEL_P_MAX, 1100."""
    lowest_thrust: Fraction = 0.1
    """Fraction of the full thrust."""
    highest_thrust: Fraction = 0.9
    """Fraction of the full thrust."""
    roll_pitch_rate_deg: Positive = 220.0
    yaw_rate_deg: Positive = 90.0

    def __post_init__(self) -> None:
        if STEEPEST_DEG < self.tilt_deg < 180.0:
            raise ValueError(f"limits.tilt_deg {self.tilt_deg:g}: at most {STEEPEST_DEG:g}, or 180")
        if self.lowest_thrust >= self.highest_thrust:
            raise ValueError("lowest_thrust must be below highest_thrust")

    @property
    def tilt(self) -> float:
        """rad"""
        return math.radians(self.tilt_deg)


class Trajectory(Table, frozen=True):
    """Limits of the reference, and when a waypoint counts as reached."""

    acceleration: Positive = 3.0
    """m/s2"""
    jerk: Positive = 15.0
    """m/s3"""
    climb_speed: Positive = 1.5
    """m/s"""
    descent_speed: Positive = 1.0
    """m/s"""
    yaw_rate_deg: Turning = 60.0
    """deg/s"""
    yaw_acceleration_deg: Turning = 180.0
    """deg/s2"""
    max_lead: Positive = 2.0
    """m between the reference and the vehicle, at most: from half of it on the reference goes on the slower the farther
    away the vehicle is, and at this distance it waits. Steps, stops and the way over the map do not."""
    height_drift: NotNegative = 1.5
    """m; where heights do not follow the ground (`avoidance.ground_slope`), it may come to be nearer by so much than
    the vehicle's height says, as a range finder that looks down shows it: then the vehicle flies higher, and returns
    from there are the ground's. What is nearer by more is something that stands there. 0: it is not looked at."""
    blind_way: Positive = 0.5
    """m; with a link that is late the vehicle is no faster than so far within the delay. Curves keep their speed."""
    acceptance_radius: Positive = 1.5
    """m; a waypoint that is passed through is reached within this distance."""
    settled_distance: Positive = 0.1
    """m; a waypoint that is stopped at is reached within this distance and below `settled_speed`. Both grow, up to five
    times, where the vehicle wanders more about its reference."""
    settled_speed: Positive = 0.2
    """m/s"""


class Supervision(Table, frozen=True):
    """Times (s) and limits of the failsafes and of the way to the start."""

    telemetry_timeout: Positive = 0.5
    longest_delay: Positive = 0.45
    """From a measurement to the effect of what is commanded upon it: with more no flight begins, and a vehicle in
    flight is asked to hold."""
    heartbeat_timeout: Positive = 3.0
    """An older heartbeat does not say any more that the vehicle is disarmed; after a gap one is awaited for so long."""
    mode_timeout: Positive = 10.0
    """So long a vehicle is flown on by its telemetry alone, without a heartbeat that says its mode."""
    scan_timeout: Positive = 0.5
    least_hold: Positive = 1.0
    """A hold lasts at least so long; less than `land_after`."""
    land_after: Positive = 5.0
    """A fault that lasts so long turns a hold into a landing."""
    silence_timeout: Positive = 4.0
    """Nothing heard at all for so long: there is no vehicle any more."""
    find_timeout: Positive = 10.0
    ready_timeout: Positive = 90.0
    """ArduPilot's estimator has a position some 42 s after power-on."""
    stream_before_engaging: Positive = 1.2
    listen_before_adopting: NotNegative = 1.5
    """A vehicle in external control may have a companion that flies it, whose heartbeat comes once a second: before
    such a vehicle is taken over, one is listened for so long."""
    command_interval: Positive = 0.5
    command_tries: Count = 6
    overrun: Positive = 0.25
    """A tick later than this is an overrun."""
    gap: Positive = 0.8
    """After a longer one the vehicle may have left external control: no setpoint before it says what it does."""
    failsafe_still: Positive = 15.0
    """A vehicle that its own failsafe does not bring nearer to the ground or home for so long is asked to land; one
    that lands counts as coming no lower."""
    disarm_after: Positive = 10.0
    """A vehicle that stands so long on the ground after its landing is disarmed."""
    disarm_watch: Positive = 2.0
    """So long an arming that was given up may still take effect, to be answered by disarming."""
    landing_timeout: Positive = 120.0
    """A landing that is not confirmed after so long is given up, once the vehicle comes no lower."""
    resume_within: Positive = 300.0
    """So long may others fly before they give control back by putting the vehicle into external control again."""
    step_timeout: Positive = 60.0
    """What a step of the mission may take on top of its hold and three times its way at the mission's speed, or its
    figure. All that the vehicle explores counts as way, where obstacles lead it farther around."""
    stray_distance: Positive = 3.0
    """m. A vehicle that is farther than this from its reference, and goes on away from it by as much again, is asked to
    hold."""
    level_before: NotNegative = 0.1
    """So long before a mode of the vehicle's own is asked for in the air a last setpoint is sent, level and with the
    thrust that hovers: such a mode may begin with the vertical acceleration that it finds. 0: none."""

    def __post_init__(self) -> None:
        if self.least_hold >= self.land_after:
            raise ValueError("least_hold must be below land_after")


class Rates(Table, frozen=True):
    """Message rates (Hz) asked of the vehicle, and the share of each that must arrive."""

    attitude: Positive = 250.0
    position: Positive = 250.0
    scan: Positive = 15.0
    """The rate of rings and, where the ground is followed, of the range finder that looks down."""
    odometry: NotNegative = 30.0
    """ODOMETRY: how certain the vehicle is of its velocity, and resets of its estimate. No flight needs it; 0: neither
    asked for nor listened to."""
    heartbeat: Positive = 5.0
    """With the mode; one that is late is asked for."""
    least_share: Fraction = 0.3
    """Share of each rate that must arrive before a flight begins: of PX4's positions in simulation 0.4 do, less where a
    link loses some."""


class Identity(Table, frozen=True):
    """MAVLink ids; the companion's own system is the vehicle's unless set."""

    system: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 191
    vehicle: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None
    """The vehicle's system, of which alone one is flown; any unless set."""


class Log(Table, frozen=True):
    """The flight log: what it holds."""

    trace_rate: Annotated[float, msgspec.Meta(ge=1, le=1000)] = 50.0
    """Hz of the control steps' trace, each with the worst of those in between; `companion replay --trace` makes all of
    it again."""


class Control(Table, frozen=True):
    position: PositionControl = PositionControl()
    attitude: AttitudeControl = AttitudeControl()
    output: OutputControl = OutputControl()
    prediction: Prediction = Prediction()
    estimation: Estimation = Estimation()
    se3: GeometricControl = GeometricControl()
    sliding_mode: SlidingModeControl = SlidingModeControl()
    pid: PidControl = PidControl()


class Settings(Table, frozen=True):
    """All of it: the file of `--settings`, changed by `--set table.key=value`."""

    control: Control = Control()
    limits: Limits = Limits()
    trajectory: Trajectory = Trajectory()
    avoidance: Avoidance = Avoidance()
    supervision: Supervision = Supervision()
    battery: Battery = Battery()
    geofence: Geofence = Geofence()
    rates: Rates = Rates()
    identity: Identity = Identity()
    log: Log = Log()

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """What of other packages flies."""
        control = self.control
        chosen = control.position.plugin, control.attitude.plugin, control.output.plugin, self.avoidance.plugin
        return tuple(each for each in chosen if each is not None)
