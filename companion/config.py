"""The companion's settings as frozen, checked records. Every default stands here and nowhere else."""

import math
from typing import Annotated

import msgspec

from companion.avoidance_methods import METHODS
from companion.config_limits import Battery, Geofence
from companion.config_types import Fraction, NotNegative, Positive, Table

Vector = tuple[Positive, Positive, Positive]
RRT_PLANNERS = ("bit*", "informed-rrt*")
NonNegativeVector = tuple[NotNegative, NotNegative, NotNegative]

POSITION_LAWS = ("backstepping", "se3", "sliding_mode", "pid")
"""The names in `control.laws.LAWS`."""


def _one_of(key: str, value: str, *known: str) -> None:
    if value not in known:
        raise ValueError(f"{key} {value!r}: there are " + ", ".join(f'"{each}"' for each in known))


class PositionControl(Table, frozen=True):
    """Position law. Vectors are north, east, down. The paper's c7, c9, c11 are `c1`, its c8, c10, c12 (all 1 there) are
    `c2`."""

    law: str = "backstepping"
    """"backstepping", or for comparison "se3", "sliding_mode" or "pid"."""
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
        _one_of("law", self.law, *POSITION_LAWS)
        _one_of("feedforward", self.feedforward, "none", "velocity", "acceleration")


class AttitudeControl(Table, frozen=True):
    """LQR of the attitude: roll, pitch, yaw."""

    angle_weight: Vector = (400.0, 400.0, 50.0)
    """Weights of the angles on the diagonal of Q (8)."""
    rate_weight: Vector = (1.0, 1.0, 1.0)
    """Weights of the rates on the diagonal of Q (8)."""
    input_weight: Vector = (1.0, 1.0, 1.0)
    """Weights of the inputs on the diagonal of R."""
    bandwidth: Vector | None = None
    """rad/s; replaces angle and rate weights by the rule of `control.lqr.weights_for`."""
    damping: Annotated[float, msgspec.Meta(ge=0.7072, le=2)] = 0.8
    """Damping ratio for that rule."""
    design: str = "continuous"
    """"continuous": the paper's; "sampled": in discrete time, with the rotors' lag in the plant."""
    feedforward: bool = True
    """Feed forward the reference's rates and angular acceleration, from its jerk and snap."""

    def __post_init__(self) -> None:
        _one_of("design", self.design, "continuous", "sampled")


class Prediction(Table, frozen=True):
    """Prediction of the state from its measurement to the time when the command takes effect."""

    enabled: bool = True
    command_delay: NotNegative = 0.0
    """s from sending a command to its effect, in addition to half of the period for which it is held."""
    longest: Positive = 0.15
    """s; older telemetry is treated as being of this age."""


class Estimation(Table, frozen=True):
    """Disturbance observer (`control.disturbance_observer`): estimates of what the model lacks, from the velocity.
    Walks are standard deviations of random walks, per square root of a second."""

    thrust_scale: bool = True
    """Estimate the scale of the thrust, which changes with mass, battery and propellers."""
    drag_scale: bool = True
    """Estimate the scale of the drag."""
    disturbance: bool = True
    """Estimate a disturbing acceleration."""
    velocity_noise: Positive = 0.02
    """m/s; the least standard deviation of a measured velocity. What the innovations show beyond it is added."""
    acceleration_noise: Positive = 0.1
    """m/s2; walk of the velocity."""
    thrust_scale_walk: NotNegative = 0.005
    """Walk of the thrust's scale."""
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


class Limits(Table, frozen=True):
    """Limits of the commands to the vehicle."""

    tilt_deg: Annotated[float, msgspec.Meta(gt=0, le=85)] = 45.0
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
    yaw_rate_deg: Positive = 60.0
    """deg/s"""
    yaw_acceleration_deg: Positive = 180.0
    """deg/s2"""
    acceptance_radius: Positive = 1.5
    """m; a waypoint that is passed through is reached within this distance."""
    settled_distance: Positive = 0.1
    """m; a waypoint that is stopped at is reached within this distance and below `settled_speed`. Both grow, up to five
    times, where the vehicle wanders more about its reference."""
    settled_speed: Positive = 0.2
    """m/s"""


class AvoidanceMap(Table, frozen=True):
    """The occupancy grid of "astar", "vfh" and the guard (`perception.rolling_map`)."""

    cell: Annotated[float, msgspec.Meta(ge=0.025)] = 0.125
    """m, from 0.025 on: size of a cell."""
    cells: int = 384
    """Along each side of the window around the vehicle; an even number."""
    layer: Positive = 3.0
    """m above and below the height of flight that the map stands for."""
    memory_s: Positive = 120.0
    """How long a return at close range is remembered; weaker evidence fades in proportion."""

    def __post_init__(self) -> None:
        if self.cells < 16 or self.cells % 2:
            raise ValueError(f"cells {self.cells}: not an even number from 16 on")


class AvoidancePlan(Table, frozen=True):
    """The method "astar" (`avoidance.astar_planner`). Distances are m from the centre of an occupied cell, costs are
    added to 1 for each metre of path."""

    inflation: Positive = 0.6
    """m; cells nearer than this are forbidden."""
    tight_inflation: Positive = 0.38
    """m; the inflation of tight paths, which are planned where the path that keeps `inflation` is a long way round."""
    max_detour: Positive = 12.0
    """m; a path that keeps `inflation` is a long way round if it costs this much more than the least expected."""
    unconfirmed_cost: Positive = 150.0
    """Cost of a cell at an obstacle that may not be there; falls to 0 at `tight_inflation`. The vehicle flies up to
    such obstacles to see whether there is a gap."""
    tight_cost: NotNegative = 80.0
    """Cost of a cell at the obstacle, for tight paths; falls to 0 at `inflation`, so that they keep to the middle."""
    switch_cost: NotNegative = 5.0
    """m by which another path must be cheaper than the tight one that is being flown."""
    proximity_radius: Positive = 2.0
    """m; beyond this, obstacles cost nothing."""
    proximity_cost: NotNegative = 3.0
    """Cost of a cell at the edge of the inflation; falls with the square to 0 at `proximity_radius`."""
    unknown_cost: NotNegative = 0.5
    """Cost of an unknown cell."""

    def __post_init__(self) -> None:
        if not self.tight_inflation <= self.inflation < self.proximity_radius:
            raise ValueError("inflation must be between tight_inflation and proximity_radius")


class AvoidanceRrt(Table, frozen=True):
    """The method "rrt" (`avoidance.rrt`), with the inflation of [avoidance.plan]."""

    planner: str = "bit*"
    """Or "informed-rrt*"."""
    iterations: Annotated[int, msgspec.Meta(ge=1)] = 2000
    """Of each plan; what they count depends on the planner."""
    seed: Annotated[int, msgspec.Meta(ge=1)] = 1
    """Of each plan."""

    def __post_init__(self) -> None:
        _one_of("planner", self.planner, *RRT_PLANNERS)


class AvoidanceVfh(Table, frozen=True):
    """The method "vfh", and the direction where the other mapped methods find no path (`avoidance.vfh`)."""

    window: Positive = 10.0
    """m; obstacles within this distance count."""
    enlargement_radius: Positive = 0.85
    """m by which obstacles are enlarged: the vehicle's radius and a margin."""
    low_threshold: Positive = 0.05
    """m2: density of obstacles below which a sector becomes free."""
    high_threshold: Positive = 0.1
    """m2: density of obstacles above which a sector becomes blocked."""
    turning_acceleration: Positive = 5.0
    """m/s2, lateral, for the radius of the turning circles."""


class AvoidanceAltitudeSearch(Table, frozen=True):
    """Flight at other heights than the route's, with the mapped methods (`mission.altitude_search`). No sensor looks
    up, or down beyond the range finder: allow only heights that are known to be free."""

    max_climb: NotNegative = 0.0
    """m above the route's height that the vehicle may climb, `margin` included; 0: not at all."""
    max_descent: NotNegative = 0.0
    """m below the route's height that the vehicle may descend, `margin` included; 0: not at all."""
    margin: NotNegative = 1.0
    """m beyond the height from which a path was seen: the scan is flat, and does not show an edge just below it."""
    min_height: Positive = 1.5
    """m above the take-off point; the search goes no lower."""
    step: Positive = 2.0
    """m between two heights that are tried. A change by half of `map.layer` clears the map."""
    height_cost: Positive = 10.0
    """Cost of a metre of height, as a length of path (m). A path whose detour exceeds `height_cost` times `step` is
    left for another height; unconfirmed and tight cells count in the detour."""
    speed: Positive = 2.0
    """m/s, at most, at another height than the route's: a scan that is tilted far passes over or under edges there."""
    dwell_time: NotNegative = 1.0
    """s that a detour must be too long for before a height is left, and that the vehicle looks around at the next."""


class AvoidanceCourse(Table, frozen=True):
    """The motion along a path (`avoidance.steering`)."""

    acceleration: Positive = 6.0
    """m/s2"""
    jerk: Positive = 50.0
    """m/s3"""
    braking: Positive = 4.5
    """m/s2, before vertices and the goal."""
    velocity_gain: Positive = 3.0
    """1/s: acceleration by the difference between desired and reference velocity."""
    max_lead: Positive = 0.3
    """m between the reference and the vehicle, at most."""
    yield_threshold: Positive = 0.3
    """m/s2; the reference yields to the vehicle's motion if the guard changes the command by more."""


class AvoidanceTracks(Table, frozen=True):
    """Tracking of moving obstacles (`perception.tracks`)."""

    gap: Positive = 1.0
    """m; neighbouring returns farther apart than this belong to two segments."""
    max_extent: Positive = 1.2
    """m; wider segments are not tracked."""
    acceleration_noise: Positive = 1.5
    """m/s2, standard deviation of a tracked obstacle's acceleration; 1.5 suits a walking person."""
    confirm_hits: Annotated[int, msgspec.Meta(ge=1)] = 4
    """Scans that must see a track before it is confirmed."""
    delete_misses: Annotated[int, msgspec.Meta(ge=1)] = 4
    """Scans in a row that miss a confirmed track before it is deleted."""
    min_speed: Positive = 0.5
    """m/s; slower tracks stand."""
    min_speed_sigmas: Positive = 3.0
    """Standard deviations by which the velocity of a moving track differs from 0, at least."""
    moving_scans: Annotated[int, msgspec.Meta(ge=1)] = 5
    """Scans in a row with such a velocity after which a track is moving."""
    stopped_scans: Annotated[int, msgspec.Meta(ge=1)] = 15
    """Scans in a row without it after which a moving track stands. A walker who turns back is slow for a moment."""


class AvoidanceGuard(Table, frozen=True):
    """The guard that filters each acceleration command (`avoidance.guard`). Keep-outs are m from the centre of the
    vehicle."""

    enabled: bool | None = None
    """Not set: on with the mapped methods. Method "none", which needs no scan, has no guard."""
    keep_out: Positive = 0.55
    """m to the centre of an occupied cell."""
    keep_out_unseen: Positive = 0.45
    """m to the centre of a cell that was not seen free."""
    keep_out_tight: Positive = 0.38
    """m, in place of `keep_out` on a tight path."""
    keep_out_unseen_tight: Positive = 0.2
    """m, in place of `keep_out_unseen` on a tight path."""
    tight_speed: Positive = 1.0
    """m/s, at most, within `keep_out` on a tight path."""
    keep_out_moving: Positive = 0.5
    """m to the edge of a moving obstacle."""
    braking: Positive = 5.5
    """m/s2 that the vehicle can brake with."""
    reaction_time: Positive = 0.25
    """s from the appearance of an obstacle to the first braking, for the speed limit: scan period, age, lag."""
    barrier_gain: Positive = 4.0
    """1/s: rate at which a barrier function may fall by its value, and rises where it is violated."""
    closing_gain: Positive = 4.0
    """1/s: closing speed by distance, close to the keep-out."""
    lag_s: NotNegative = 0.15
    """From a command to the acceleration."""
    horizon_s: Positive = 0.1
    """The state that the command leads to within this time must allow a stop."""
    obstacle_range: Positive = 9.0
    """m; obstacles within this distance have barriers."""
    stale_s: Positive = 0.3
    """With a view older than this the vehicle brakes."""


class Avoidance(Table, frozen=True):
    """The method, and what all methods share. The mapped methods plan over the map of [avoidance.map]."""

    method: str = "astar"
    """One of those listed at the end of docs/settings.md, from `companion/avoidance_methods.py`."""
    vehicle_radius: Positive = 0.36
    ground_height: Positive = 0.5
    """m above the take-off point; returns from below are the ground."""
    answer_delay: NotNegative = 0.02
    """s from a scan to its map and path, in lockstep; in real time it is what the planner takes."""
    give_up_s: Positive = 40.0
    """With the mapped methods: the goal is given up after so long without a metre of progress."""
    lateral_margin: Positive = 3.0
    """m outside the nearer edge of an obstacle: the paper's 3. This key and those below are of "paper"."""
    safe_distance: Positive = 1.2
    """m between hull and obstacle; a course that comes nearer is blocked."""
    switch_margin: Positive = 3.0
    """m of path that another setpoint must save to take the place of the present one."""
    memory_s: Positive = 3.0
    """How long a return counts: a tilted scan looks over and under what it saw before."""
    merge_distance: Positive = 0.3
    """m; returns nearer to each other than this are remembered as one."""
    braking_acceleration: Positive = 2.5
    braking_delay: Positive = 0.3
    """s from the appearance of an obstacle to the first braking: scan period, age, lag."""
    least_speed: Positive = 0.3
    """m/s that is always allowed, so that the vehicle can move away from an obstacle."""
    map: AvoidanceMap = AvoidanceMap()
    plan: AvoidancePlan = AvoidancePlan()
    rrt: AvoidanceRrt = AvoidanceRrt()
    vfh: AvoidanceVfh = AvoidanceVfh()
    altitude_search: AvoidanceAltitudeSearch = AvoidanceAltitudeSearch()
    course: AvoidanceCourse = AvoidanceCourse()
    tracks: AvoidanceTracks = AvoidanceTracks()
    guard: AvoidanceGuard = AvoidanceGuard()

    def __post_init__(self) -> None:
        _one_of("method", self.method, *METHODS)
        if self.guard.enabled and not self.needs_scan:
            raise ValueError(f'guard.enabled: there is no guard with method "{self.method}", which needs no scan')

    @property
    def mapped(self) -> bool:
        """The method plans paths over the map."""
        return METHODS[self.method].mapped

    @property
    def needs_scan(self) -> bool:
        """The method can't fly without a LiDAR."""
        return METHODS[self.method].needs_scan

    @property
    def looks_around(self) -> bool:
        """There is a map, for the method or for the guard."""
        return self.mapped or self.guarded

    @property
    def guarded(self) -> bool:
        """The guard is on."""
        return self.mapped if self.guard.enabled is None else self.guard.enabled


class Supervision(Table, frozen=True):
    """Times (s) of the failsafes and of the way to the start."""

    telemetry_timeout: Positive = 0.5
    heartbeat_timeout: Positive = 3.0
    scan_timeout: Positive = 0.5
    least_hold: Positive = 1.0
    """A hold lasts at least so long."""
    land_after: Positive = 5.0
    """A fault that lasts so long turns a hold into a landing."""
    silence_timeout: Positive = 4.0
    """Nothing heard at all for so long: there is no vehicle any more."""
    find_timeout: Positive = 10.0
    ready_timeout: Positive = 90.0
    """ArduPilot's estimator has a position some 42 s after power-on."""
    stream_before_engaging: Positive = 1.2
    command_interval: Positive = 0.5
    command_tries: Annotated[int, msgspec.Meta(ge=1)] = 6
    overrun: Positive = 0.25
    """A tick later than this is an overrun."""
    gap: Positive = 0.8
    """After a longer one the vehicle may have left external control: no setpoint before it says what it does."""
    failsafe_still: Positive = 15.0
    """A vehicle that its own failsafe does not bring nearer to the ground or home for so long is asked to land."""
    disarm_after: Positive = 10.0
    """A vehicle that stands so long on the ground after its landing is disarmed."""
    disarm_watch: Positive = 2.0
    """So long an arming that was given up may still take effect, to be answered by disarming."""
    landing_timeout: Positive = 120.0
    resume_within: Positive = 300.0
    """So long may others fly before they give control back by putting the vehicle into external control again."""
    step_timeout: Positive = 60.0
    """What a step of the mission may take on top of its hold and three times its way at the mission's speed."""


class Rates(Table, frozen=True):
    """Message rates (Hz) asked of the vehicle, and the share of each that must arrive."""

    attitude: Positive = 250.0
    position: Positive = 250.0
    scan: Positive = 15.0
    heartbeat: Positive = 5.0
    """With the mode; one that is late is asked for."""
    least_share: Fraction = 0.4


class Identity(Table, frozen=True):
    """MAVLink ids; the system is the vehicle's unless set."""

    system: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 191


class Log(Table, frozen=True):
    """Of the flight log."""

    trace_rate: Annotated[float, msgspec.Meta(ge=1, le=1000)] = 50.0
    """Hz of the control steps' trace, each with the worst of those in between; `companion replay --trace` makes all of
    it again."""


class Control(Table, frozen=True):
    position: PositionControl = PositionControl()
    attitude: AttitudeControl = AttitudeControl()
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
