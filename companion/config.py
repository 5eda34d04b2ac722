"""The companion's settings: TOML -> frozen, checked records. Every default stands here and nowhere else."""

import dataclasses
import math
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from protocol import toml_files as toml_files
from protocol.vehicle_parameters import VehicleParameters

T = TypeVar("T")
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(gt=0, le=1)]
Vector = tuple[Positive, Positive, Positive]
NonNegativeVector = tuple[NotNegative, NotNegative, NotNegative]


def _one_of(key: str, value: str, *known: str) -> None:
    if value not in known:
        raise ValueError(f"{key} {value!r}: there are " + ", ".join(f'"{each}"' for each in known))


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all tables: an unknown key is an error."""


class PositionControl(Table, frozen=True):
    """Backstepping constants; the paper's c7, c9, c11 are `c1`, its c8, c10, c12 (all 1 there) are `c2`. North, east,
    down."""

    law: str = "backstepping"
    """Or, to compare with, "se3", "sliding_mode", "pid"."""
    c1: Vector = (2.5, 2.5, 2.5)
    c2: Vector = (2.5, 2.5, 2.5)
    feedforward: str = "acceleration"
    """What of the reference is fed forward: "none", "velocity" or "acceleration" (with the velocity)."""
    adaptation: NonNegativeVector = (0.3, 0.3, 0.3)
    """gamma of the adaptive (integral) law; 0: the paper's."""
    adaptation_bound: Positive = 3.0
    """m/s2 at the most on each axis."""
    drag_compensation: bool = True
    """Make up for the drag of the `[body]` table, which the paper's model lacks."""

    def __post_init__(self) -> None:
        _one_of("law", self.law, "backstepping", "se3", "sliding_mode", "pid")
        _one_of("feedforward", self.feedforward, "none", "velocity", "acceleration")


class AttitudeControl(Table, frozen=True):
    """LQR weights: the diagonals of Q (8), angle and rate of roll, pitch, yaw, and of R."""

    angle_weight: Vector = (400.0, 400.0, 50.0)
    rate_weight: Vector = (1.0, 1.0, 1.0)
    input_weight: Vector = (1.0, 1.0, 1.0)
    bandwidth: Vector | None = None
    """rad/s; takes the place of angle and rate weights by the rule of `control.lqr.weights_for`."""
    damping: Annotated[float, msgspec.Meta(ge=0.7072, le=2)] = 0.8
    """Of that rule."""
    design: str = "continuous"
    """"continuous": the paper's; "sampled": in discrete time, with the rotors' lag in the plant."""
    feedforward: bool = True
    """Rates and angular acceleration of the reference, from its jerk and snap."""

    def __post_init__(self) -> None:
        _one_of("design", self.design, "continuous", "sampled")


class Prediction(Table, frozen=True):
    """Of the state, from the measurement to when the command takes effect."""

    enabled: bool = True
    command_delay: NotNegative = 0.0
    """s from sending a command to its effect, beyond the half of a period that it is held."""
    longest: Positive = 0.15
    """s; telemetry that is older is taken to be so old."""


class Estimation(Table, frozen=True):
    """Of what the model lacks, from the velocity (`control.disturbance_observer`); walks are per square root of a
    second."""

    thrust_scale: bool = True
    """The hover thrust: mass, battery, propellers."""
    drag_scale: bool = True
    disturbance: bool = True
    velocity_noise: Positive = 0.02
    """m/s"""
    acceleration_noise: Positive = 0.1
    """m/s2"""
    thrust_scale_walk: NotNegative = 0.05
    drag_scale_walk: NotNegative = 0.1
    disturbance_walk: NotNegative = 1.0
    """m/s2"""


class GeometricControl(Table, frozen=True):
    """Gains by mass of `law = "se3"` (1/s2, 1/s); north, east, down."""

    position_gain: Vector = (7.25, 7.25, 7.25)
    velocity_gain: Vector = (5.0, 5.0, 5.0)


class SlidingModeControl(Table, frozen=True):
    """Of `law = "sliding_mode"`."""

    slope: Vector = (2.5, 2.5, 2.5)
    """1/s"""
    gain: Vector = (4.0, 4.0, 4.0)
    """m/s2"""
    boundary: Positive = 1.0
    """m/s"""


class PidControl(Table, frozen=True):
    """Of `law = "pid"` (1/s2, 1/s3, 1/s)."""

    proportional: Vector = (7.25, 7.25, 7.25)
    integral: NonNegativeVector = (2.0, 2.0, 2.0)
    derivative: Vector = (5.0, 5.0, 5.0)


class Limits(Table, frozen=True):
    """What may be asked of the vehicle; thrust as fractions of the whole."""

    tilt_deg: Annotated[float, msgspec.Meta(gt=0, le=85)] = 45.0
    lowest_thrust: Fraction = 0.1
    highest_thrust: Fraction = 0.9
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
    """Limits of the references (m, s)."""

    acceleration: Positive = 3.0
    jerk: Positive = 15.0
    climb_speed: Positive = 1.5
    descent_speed: Positive = 1.0
    yaw_rate_deg: Positive = 60.0
    yaw_acceleration_deg: Positive = 180.0
    acceptance_radius: Positive = 1.5
    """A waypoint that is passed through counts as reached within this distance."""
    settled_distance: Positive = 0.1
    settled_speed: Positive = 0.2
    """A waypoint that is stopped at, within this distance and below this speed."""


class AvoidanceMap(Table, frozen=True):
    """The occupancy grid of "astar", "vfh" and the guard (`perception.rolling_map`)."""

    cell: Annotated[float, msgspec.Meta(ge=0.025)] = 0.125
    """m, from 0.025 on."""
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
    """The search of "astar" (`avoidance.astar`); m from an occupied cell's centre."""

    inflation: Positive = 0.6
    """Nearer is forbidden."""
    tight: Positive = 0.38
    """Nearer is forbidden on the way that is looked for where the one with room is a long way round."""
    detour: Positive = 12.0
    """What the way with room may cost beyond the least that was to be expected."""
    doubt: Positive = 150.0
    """What a metre costs on top, at the most, that leads through what was not seen from near enough to be sure: where
    that is the cheapest, the vehicle goes and looks."""
    squeeze: NotNegative = 80.0
    """What a metre of a tight way costs on top, at the most, nearer than the inflation: it leads through the middle."""
    habit: NotNegative = 5.0
    """What another way must cost less than the tight one that is being flown, for that to be left."""
    comfort: Positive = 2.0
    """From here on nearness costs nothing."""
    closeness: NotNegative = 3.0
    """What a metre at the inflation's edge costs on top of 1."""
    unknown: NotNegative = 0.5
    """What a metre of unknown costs on top."""

    def __post_init__(self) -> None:
        if not self.tight <= self.inflation < self.comfort:
            raise ValueError("inflation must be between tight and comfort")


class AvoidanceRrt(Table, frozen=True):
    """The search of "rrt" (`avoidance.rrt`), with the inflation of "astar"."""

    planner: str = "bit*"
    """Or "informed-rrt*"."""
    iterations: Annotated[int, msgspec.Meta(ge=1)] = 2000
    """A scan; what they count depends on the planner."""
    seed: Annotated[int, msgspec.Meta(ge=1)] = 1

    def __post_init__(self) -> None:
        _one_of("planner", self.planner, "bit*", "informed-rrt*")


class AvoidanceVfh(Table, frozen=True):
    """The histogram of "vfh", and of "astar" where it has no answer (`avoidance.vfh`)."""

    window: Positive = 10.0
    """m around the vehicle that count."""
    radius: Positive = 0.85
    """m by which obstacles are enlarged."""
    low: Positive = 0.05
    """m2: a density below which a sector becomes free."""
    high: Positive = 0.1
    """m2: a density above which it becomes blocked."""
    turning_acceleration: Positive = 5.0
    """m/s2 sideways, for the turning circles."""


class AvoidanceAltitudeSearch(Table, frozen=True):
    """Other heights than the route's, with "astar", "rrt" and "vfh" (`mission.altitude_search`). No sensor sees what is
    over the vehicle or, beyond the range finder, under it: allow what the place is known to leave free."""

    above: NotNegative = 0.0
    """m over the route's height that it may climb to get over what stands in the way, `margin` included; 0: not at
    all."""
    below: NotNegative = 0.0
    """m under the route's height that it may descend to get under what hangs in the way, `margin` included; 0: not at
    all."""
    margin: NotNegative = 1.0
    """m beyond the height from which a way was seen: the ring is flat, and what ends just below it is not seen."""
    lowest: Positive = 1.5
    """m above the take-off point that it never goes below for that."""
    step: Positive = 2.0
    """m between two heights that are tried. A change by half of `map.layer` begins a new map."""
    price: Positive = 10.0
    """What a metre of height is worth, as `plan` counts: a way that costs more than that times `step` beyond what was
    to be expected, for tightness and doubt as well as for its length, is left for another height."""
    speed: Positive = 2.0
    """m/s, at most, at another height than the route's: a ring that is tilted far looks past edges that are near to the
    height of flight, and nobody chose this one for having none."""
    patience: NotNegative = 1.0
    """s that the way must be too dear before a height is left, and that are looked around at another."""


class AvoidanceCourse(Table, frozen=True):
    """The motion along a way (`avoidance.steering`)."""

    acceleration: Positive = 6.0
    """m/s2"""
    jerk: Positive = 50.0
    """m/s3"""
    braking: Positive = 4.5
    """m/s2, before corners and the goal."""
    follow: Positive = 3.0
    """1/s: how fast the wished velocity is taken up."""
    leash: Positive = 0.3
    """m that the reference may be away from the vehicle."""
    give_in: Positive = 0.3
    """m/s2 by which the guard must change a command for the reference to give in to it."""


class AvoidanceTracks(Table, frozen=True):
    """What moves (`perception.tracks`)."""

    gap: Positive = 1.0
    """m between neighbouring returns from which on they are two things."""
    widest: Positive = 1.2
    """m; what is wider is not followed."""
    acceleration: Positive = 1.5
    """m/s2, standard deviation: a person's change of mind."""
    hits: Annotated[int, msgspec.Meta(ge=1)] = 4
    """After so many a track is believed."""
    misses: Annotated[int, msgspec.Meta(ge=1)] = 4
    """After so many in a row it is dropped."""
    slowest: Positive = 0.5
    """m/s; what is slower stands still."""
    certainty: Positive = 3.0
    """Standard deviations by which a velocity must differ from 0."""
    steady: Annotated[int, msgspec.Meta(ge=1)] = 5
    """Scans in a row for which it must."""
    rest: Annotated[int, msgspec.Meta(ge=1)] = 15
    """Scans in a row without it after which what moved stands."""


class AvoidanceGuard(Table, frozen=True):
    """The last word on each acceleration (`avoidance.guard`)."""

    enabled: bool | None = None
    """Not set: with "astar", "rrt" and "vfh"; there is none without a ring, with "none"."""
    keep_out: Positive = 0.55
    """m from the vehicle's centre to an occupied cell's."""
    keep_out_unseen: Positive = 0.45
    """m from the vehicle's centre to the centre of a cell that was not seen free."""
    keep_out_tight: Positive = 0.38
    """In place of `keep_out` where there is no other way than a tight one."""
    keep_out_unseen_tight: Positive = 0.2
    crawl: Positive = 1.0
    """m/s, at most, nearer than `keep_out` there."""
    keep_out_moving: Positive = 0.5
    """m from the vehicle's centre to the edge of what moves."""
    braking: Positive = 5.5
    """m/s2 on which it counts."""
    delay: Positive = 0.25
    """s from a thing's appearance to the first braking, for the speed limit: scan period, age, lag."""
    steepness: Positive = 4.0
    """1/s: how fast a barrier may be approached, and is left if it is violated."""
    nearness: Positive = 4.0
    """1/s: closing speed over distance, close to the keep-out."""
    lag_s: NotNegative = 0.15
    """From a command to the acceleration."""
    horizon_s: Positive = 0.1
    """From where the command leads to within this time there must be a stop."""
    reach: Positive = 9.0
    """m within which points are looked at."""
    stale_s: Positive = 0.3
    """A view that is older stops the vehicle."""


class Avoidance(Table, frozen=True):
    """`method`: "astar" (a way over the map, "vfh" where there is none), "rrt" (the same by sampling), "vfh" (VFH+ on
    the map), "paper", "paper-literal" (as printed, for the paper's experiment) or "none"."""

    method: str = "astar"
    vehicle_radius: Positive = 0.36
    ground_height: Positive = 0.5
    """m above the take-off point below which a return is the ground."""
    answer_delay: NotNegative = 0.02
    """s, in lockstep: from a ring's arrival to when its map and way count; by the clock it is what it takes."""
    give_up_s: Positive = 40.0
    """With "astar", "rrt" and "vfh": so long without a metre of progress, and the goal is given up."""
    lateral_margin: Positive = 3.0
    """m outside the nearer edge of an obstacle: the paper's 3. This and what follows is of "paper"."""
    safe_distance: Positive = 1.2
    """m between hull and obstacle below which a course counts as blocked."""
    decisiveness: Positive = 3.0
    """m of way that another setpoint must save to be taken instead of the present one."""
    memory_s: Positive = 3.0
    """How long a return counts: a tilted ring looks over and under what it saw before."""
    grain: Positive = 0.3
    """m; returns nearer to each other than this are remembered as one."""
    braking_acceleration: Positive = 2.5
    braking_delay: Positive = 0.3
    """s from a thing's appearance to the first braking: scan period, age, lag."""
    least_speed: Positive = 0.3
    """m/s that is always left, to move away from what is near."""
    map: AvoidanceMap = AvoidanceMap()
    plan: AvoidancePlan = AvoidancePlan()
    rrt: AvoidanceRrt = AvoidanceRrt()
    vfh: AvoidanceVfh = AvoidanceVfh()
    heights: AvoidanceAltitudeSearch = AvoidanceAltitudeSearch()
    course: AvoidanceCourse = AvoidanceCourse()
    tracks: AvoidanceTracks = AvoidanceTracks()
    guard: AvoidanceGuard = AvoidanceGuard()

    def __post_init__(self) -> None:
        _one_of("method", self.method, "astar", "vfh", "rrt", "paper", "paper-literal", "none")
        if self.guard.enabled and self.method == "none":
            raise ValueError('guard.enabled: there is no guard with method "none", which needs no ring')

    @property
    def mapped(self) -> bool:
        """The method flies a course over the map."""
        return self.method in ("astar", "vfh", "rrt")

    @property
    def looks_around(self) -> bool:
        """There is a map."""
        return self.mapped or self.guarded

    @property
    def guarded(self) -> bool:
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
    ready_timeout: Positive = 30.0
    stream_before_engaging: Positive = 1.2
    command_interval: Positive = 0.5
    command_tries: Annotated[int, msgspec.Meta(ge=1)] = 6
    overrun: Positive = 0.25
    """A tick later than this is an overrun."""
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
    rates: Rates = Rates()
    identity: Identity = Identity()
    log: Log = Log()


class _VehicleFile(msgspec.Struct, frozen=True):
    body: VehicleParameters


def picked(kind: type[T], table: msgspec.Struct, **more: Any) -> T:
    """A stage's own settings out of a table of the companion's."""
    names = (field.name for field in dataclasses.fields(kind) if field.name not in more)  # type: ignore[arg-type]
    return kind(**{name: getattr(table, name) for name in names}, **more)


def load_settings(path: Path | None, overrides: list[str]) -> Settings:
    """Raises DataFileError, naming file and key."""
    if path is None:
        return toml_files.convert({}, Settings, "settings", overrides)
    return toml_files.load(path, Settings, overrides)


def load_body(vehicle: str) -> VehicleParameters:
    """The `[body]` of a vehicle, found by name or path: all that the companion knows of it beforehand."""
    return toml_files.load(toml_files.find("vehicles", vehicle), _VehicleFile).body
