"""The settings of avoidance: the map, the methods, the motion along a path, the guard."""

from typing import Annotated

import msgspec

from companion.avoidance_methods import METHODS, method_of
from companion.config_types import MANY, MOST, Count, NotNegative, Positive, Table, one_of
from companion.plugins import Kind, Options, Plugin, options_for, plugin

RRT_PLANNERS = ("bit*", "informed-rrt*")


class AvoidanceMap(Table, frozen=True):
    """The occupancy grid of "astar", "vfh" and the guard (`perception.rolling_map`)."""

    cell: Annotated[float, msgspec.Meta(ge=0.025, le=MOST)] = 0.125
    """m, from 0.025 on: size of a cell."""
    cells: int = 384
    """Along each side of the window around the vehicle; an even number up to 4096."""
    memory_cells: int = 1024
    """Along each side of the square around the vehicle in which what has left the window is remembered, for when the
    vehicle comes back; an even number up to 4096. 0: nothing is."""
    beyond_window: bool = True
    """Whether the way is looked for in all that is remembered, once the vehicle has had to go back: so it gets out of
    what is larger than the window."""
    layer: Positive = 3.0
    """m above and below the height of flight that the map stands for."""
    memory_s: Positive = 120.0
    """How long a return at close range is remembered; weaker evidence fades in proportion."""
    keeps_free: bool = True
    """Whether the return of a sector, which lies somewhere on an arc across it, leaves free what was seen free there,
    where something stands on that arc already; and whether a wall is joined between its returns only over what was not
    seen free. Sectors wider than 15 degrees always close it."""

    def __post_init__(self) -> None:
        if not 16 <= self.cells <= 4096 or self.cells % 2:
            raise ValueError(f"cells {self.cells}: not an even number from 16 to 4096")
        if not 0 <= self.memory_cells <= 4096 or self.memory_cells % 2:
            raise ValueError(f"memory_cells {self.memory_cells}: not an even number from 0 to 4096")

    @property
    def memory(self) -> int:
        """Cells along each side of what is remembered: the window at the least."""
        return max(self.memory_cells, self.cells)


class AvoidancePlan(Table, frozen=True):
    """The method "astar" (`avoidance.astar_planner`). Distances are m from the centre of an occupied cell, costs are
    added to 1 for each metre of path."""

    inflation: Positive = 0.6
    """m; cells nearer than this are forbidden."""
    tight_inflation: Positive = 0.38
    """m; the inflation of tight paths, which are planned where the path that keeps `inflation` is a long way round."""
    max_detour: Positive = 12.0
    """m; a path that keeps `inflation` is a long way round if it costs this much more than the least expected."""
    unconfirmed_cost: Positive = 400.0
    """Cost of a cell at an obstacle that may not be there; falls to 0 at `tight_inflation`. The vehicle flies up to
    such obstacles to see whether there is a gap."""
    tight_cost: NotNegative = 40.0
    """Cost of a cell at the obstacle, for tight paths; falls to 0 at `inflation`, so that they keep to the middle."""
    switch_cost: NotNegative = 1.0
    """Share by which a metre costs more away from the path that was chosen last, where tight paths are planned."""
    switch_growth: Annotated[float, msgspec.Meta(ge=1.0, le=MOST)] = 1.25
    """Factor by which that share grows with each turn away from such a path, up to 16 times, until there is a path that
    keeps `inflation`. What is seen askew from afar changes its price from scan to scan; so one of two ways is flown to
    its end. 1: it does not grow."""
    switch_growth_tight: Annotated[float, msgspec.Meta(ge=1.0, le=MOST)] = 8.0
    """What that share has grown by at the least, where nothing moves, once the vehicle is in a tight passage or at its
    mouth: who has entered one flies to its end, or to where it is seen to be closed."""
    turn_scans: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 8
    """Scans in a row that must show a passage closed until the way back out of it is the one that costs less to go on
    with: one that errs does not turn the vehicle round. 1: each counts."""
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
    iterations: Count = 2000
    """Length of the search for each plan; what one iteration is depends on the planner."""
    seed: Annotated[int, msgspec.Meta(ge=1, le=2**32 - 1)] = 1
    """Seed of each plan's random numbers."""

    def __post_init__(self) -> None:
        one_of("planner", self.planner, *RRT_PLANNERS)


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
    short_detour: NotNegative = 5.0
    """m; a height from which the way has a longer detour is not yet past what is in the way: the next one is tried, if
    there is one. Around what it sees there it would be led on by what is just below (or above) its scan."""
    speed: Positive = 2.0
    """m/s, at most, at another height than the route's: a scan that is tilted far passes over or under edges there."""
    edge_distance: Positive = 0.4
    """m below a vehicle that flies over obstacles (above one that flies under them) from which on returns are not in
    the way: its scan meets their edges whenever it tilts."""
    patience_s: Positive = 10.0
    """s without a metre of progress at another height than the route's after which the next one is tried, if there is
    one; `avoidance.give_up_s` at the most."""
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
    smooth_from: NotNegative = 6.0
    """m/s; for a higher speed than this the paths of "astar" are made smooth and followed by their curve, and lead
    around what appears on the side that is in reach, so that less speed is lost."""
    velocity_gain: Positive = 3.0
    """1/s: acceleration by the difference between desired and reference velocity."""
    max_lead: Positive = 0.3
    """m between the reference and the vehicle, at most."""
    adapts: bool = False
    """The integrals of the position law go on along the way over the map, too. There the reference leads the vehicle,
    so they would learn a wind that is none, and the guard's braking would fall short by it."""
    yield_threshold: Positive = 0.3
    """m/s2; the reference yields to the vehicle's motion if the guard changes the command by more."""
    max_yield: Positive = 9.5
    """m/s2 of the guard's acceleration that the reference takes over, at most: with more, it would go on backwards
    after an emergency."""


class AvoidanceTracks(Table, frozen=True):
    """Tracking of moving obstacles (`perception.tracks`)."""

    range_gap: Positive = 0.2
    """m; neighbouring returns whose ranges differ by more belong to two segments. Six standard deviations of the noise
    that a LiDAR shows at rest, if that is more."""
    max_extent: Positive = 5.0
    """m, a car's length; wider segments are not tracked."""
    acceleration_noise: Positive = 1.5
    """m/s2, standard deviation of a tracked obstacle's acceleration; 1.5 suits a walking person."""
    confirm_hits: Count = 3
    """Scans that must see a track before it is confirmed."""
    hidden_scans: Annotated[int, msgspec.Meta(ge=0, le=MANY)] = 30
    """For so many scans in a row that can't show it, since they are tilted, or of which something hides a part, what
    moves is expected to go on."""
    delete_misses: Count = 4
    """Scans in a row that miss a confirmed track before it is deleted."""
    min_speed: Positive = 0.5
    """m/s; slower tracks stand."""
    min_speed_sigmas: Positive = 2.5
    """Standard deviations by which the velocity of a moving track differs from 0, at least."""
    moving_scans: Count = 1
    """Scans in a row with such a velocity after which a track is moving."""
    stopped_scans: Count = 15
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
    keep_out_unseen_tight: Positive = 0.38
    """m, in place of `keep_out_unseen` on a tight path, where unknown cells beside a return count to the obstacle: at
    least the hull's radius."""
    tight_speed: Positive = 1.0
    """m/s, at most, within `keep_out` on a tight path."""
    keep_out_moving: Positive = 0.5
    """m to the edge of a moving obstacle."""
    braking: Positive = 5.5
    """m/s2 that the vehicle brakes with, by which its speed is chosen."""
    emergency_braking: NotNegative = 9.5
    """m/s2 that it brakes with where no stop at `braking` is free any more, if that is more."""
    evasion: Positive = 9.5
    """m/s2 that the vehicle evades moving obstacles with."""
    evasion_stops: bool = True
    """Once it has begun to evade, it brakes as soon as that keeps clear of all that moves. Otherwise it goes on
    accelerating aside until its command keeps clear."""
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
    sight_s: NotNegative = 0.3
    """The vehicle is no faster than it can stop within what its scan, which leans with it against drag and wind, sees
    before it meets the ground; the lean is averaged over so many s. 0: this is not asked, as where a gimbal keeps the
    scanner level."""


class Avoidance(Table, frozen=True):
    """The method, and what all methods share. The mapped methods plan over the map of [avoidance.map]."""

    method: str = "astar"
    """One of those listed at the end of docs/settings.md, or a planner of another package (docs/extend.md)."""
    options: Options = msgspec.field(default_factory=dict)
    """Settings of the planner, if it is one of another package."""
    vehicle_radius: Positive = 0.36
    """m; no distance that is kept from the vehicle's centre may be less."""
    ground_height: Positive = 0.5
    """m above the take-off point, or above the ground that is followed; returns from below are the ground."""
    ground_slope: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.0
    """Rise over run of the steepest ground that is followed: then the heights of the route count from the ground below
    the vehicle, as a range finder that looks down shows it, and returns that may be such ground are none of an
    obstacle. Steeper ground is flown around. For the mapped methods alone. 0: heights count from the take-off point,
    but for `trajectory.height_drift`, and the ground is flat."""
    keep_out_below: NotNegative = 0.7
    """m above what stands where a parcel is to be released, by a range finder that looks down: the descent ends there.
    0: it is not looked at."""
    velocity_error_s: NotNegative = 2.0
    """s; planner and guard take obstacles for larger by what the standard deviation of the vehicle's velocity, as the
    vehicle says it (`rates.odometry`), exceeds 0.03 m/s by, times this, up to 0.3 m: so far aside of where it believes
    to be it may have come since it saw them. 0: they do not."""
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
        options_for(self.plugin, self.options)
        if self.guard.enabled and not self.needs_scan:
            raise ValueError(f'guard.enabled: there is no guard with method "{self.method}", which needs no scan')
        if self.ground_slope > 0.0 and not self.mapped:
            raise ValueError(f'ground_slope: with method "{self.method}" heights do not follow the ground')

    @property
    def plugin(self) -> Plugin | None:
        """The method, if it is a planner of another package."""
        return plugin(Kind.PLANNER, "method", self.method, METHODS)

    def by(self, method: str) -> "Avoidance":
        """The same by another method that flies with the chosen one; without what it does not go with."""
        other, options = method_of(method), self.options if method == self.method else {}
        guard = self.guard if other.needs_scan else msgspec.structs.replace(self.guard, enabled=None)
        slope = self.ground_slope if other.mapped else 0.0
        return msgspec.structs.replace(self, method=method, options=options, guard=guard, ground_slope=slope)

    @property
    def mapped(self) -> bool:
        """The method plans paths over the map."""
        return method_of(self.method).mapped

    @property
    def needs_scan(self) -> bool:
        """The method can't fly without a LiDAR."""
        return method_of(self.method).needs_scan

    @property
    def looks_around(self) -> bool:
        """There is a map, for the method or for the guard."""
        return self.mapped or self.guarded

    @property
    def guarded(self) -> bool:
        """The guard is on."""
        return self.mapped if self.guard.enabled is None else self.guard.enabled
