"""A vehicle that is always where the reference is, for the tests of guidance; and what a smooth reference is."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from companion.avoidance.guard import Guard
from companion.avoidance.planner import PlanningPipeline, PlanResult
from companion.config import Settings
from companion.guidance import Guidance
from companion.mission.navigator import Leg
from companion.mission.plan import Mission, Phase, Step, Waypoint
from companion.reports import MotionReport
from companion.runtime.files import load_mission, load_settings
from companion.state import Reference, Scan, VehicleState
from protocol.arrays import Array
from protocol.frames import from_euler

TICK_NS, SECOND = 4_000_000, 1_000_000_000
DT = TICK_NS * 1e-9
SCAN_EVERY = 16
ROUTE = Mission(name="route", waypoints=[Waypoint(60.0, 0.0, 3.0)], speed=4.0)
STEPS = load_mission("step")[0]
CIRCLE = load_mission("circle")[0]
START = np.array([0.0, 0.0, -3.0])
SMALL_MAP = ("avoidance.map.cells=128", "avoidance.map.cell=0.25")
BEARINGS = np.radians(np.linspace(0.0, 355.0, 72))


def vehicle(
    place: Sequence[float] | Array, velocity: Sequence[float] | Array = (0.0, 0.0, 0.0), yaw: float = 0.0
) -> VehicleState:
    attitude = from_euler(0.0, 0.0, yaw)
    return VehicleState(0, np.array(place, np.float64), np.array(velocity, np.float64), attitude, np.zeros(3), 0)


def leg_to(
    target: Sequence[float] | Array, phase: Phase = Phase.ROUTE, *, avoids: bool = False, passes: bool = False
) -> Leg:
    target_ned = np.array(target, np.float64)
    return Leg(Step(phase, target_ned, passes=passes, avoids=avoids), 1, target_ned, 4.0, False)


def guidance_of(mission: Mission, *overrides: str) -> tuple[Guidance, Settings]:
    table = load_settings(None, list(overrides))
    guard = Guard(table.avoidance.guard) if table.avoidance.looks_around else None
    return Guidance(table, mission, guard), table


class ReferenceFlight:
    """A vehicle that is always where the reference is, and sees open space around it."""

    def __init__(self, mission: Mission = ROUTE, *overrides: str) -> None:
        self.guidance, self.settings = guidance_of(mission, *SMALL_MAP, *overrides)
        self.planning = PlanningPipeline(self.settings.avoidance)
        self.tick = 0
        self.state = vehicle(START)
        self.guidance.begin(self.state, self.state.position_ned)
        self.references: list[Reference] = []
        self.motion: MotionReport | None = None
        self.results: list[PlanResult] = []
        self.sees_m = 15.0
        """The range of the LiDAR."""
        self.ranges = np.full(72, self.sees_m)
        """m, of the scans from now on; what is nearer than `sees_m` is an obstacle."""

    @property
    def now(self) -> int:
        return self.tick * TICK_NS

    @property
    def reference(self) -> Reference:
        return self.guidance.reference(self.now)

    def move(self) -> None:
        """The vehicle goes to where the reference is one tick later."""
        self.tick += 1
        reference = self.reference
        self.references.append(reference)
        self.state = vehicle(reference.position_ned, reference.velocity_ned, reference.yaw)

    def drift(self, seconds: float) -> "ReferenceFlight":
        """Nobody steers."""
        for _ in range(round(seconds / DT)):
            self.move()
        return self

    def steer(
        self, leg: Leg, seconds: float, until: Callable[["ReferenceFlight"], bool] = lambda flight: False
    ) -> "ReferenceFlight":
        for _ in range(round(seconds / DT)):
            if until(self):
                break
            if self.tick % SCAN_EVERY == 0:
                self.see(leg)
            self.motion = self.guidance.steer(leg, self.state, self.now)
            self.move()
        return self

    def see(self, leg: Leg) -> None:
        """A scan is taken up at once."""
        hit, known = self.ranges < self.sees_m, np.ones(72, np.bool_)
        scan = Scan(self.now, self.now // 1000, BEARINGS, self.ranges, hit, known)
        pose = self.state.position_ned, self.state.attitude_ned_frd
        request = self.guidance.look(scan, pose, 0.0, self.state, leg, self.now)
        if request is not None:
            self.results.append(self.planning.answer(request))
            self.guidance.take_up(self.results[-1], leg, self.now)

    @property
    def speed(self) -> float:
        return float(np.linalg.norm(self.reference.velocity_ned))


def assert_smooth(references: Sequence[Reference], acceleration: float, jerk: float) -> None:
    """At 250 Hz no position, velocity or acceleration jumps, and each axis keeps to its limits."""
    rows = np.array([reference.rows for reference in references])
    assert np.abs(rows[:, 2]).max() <= acceleration + 1e-6
    speed = np.abs(rows[:, 1]).max()
    assert np.abs(np.diff(rows[:, 0], axis=0)).max() <= (speed + acceleration * DT) * DT + 1e-9
    assert np.abs(np.diff(rows[:, 1], axis=0)).max() <= acceleration * DT + 1e-9
    assert np.abs(np.diff(rows[:, 2], axis=0)).max() <= jerk * DT + 1e-6
    middle = 0.5 * (rows[1:, 1] + rows[:-1, 1])
    assert np.diff(rows[:, 0], axis=0) == pytest.approx(middle * DT, abs=jerk * DT**3), "velocity is its derivative"


def assert_at_rest(reference: Reference) -> None:
    assert np.abs(reference.rows[1:5]).max() < 1e-9


def assert_same_motion(before: Reference, after: Reference, places: float = 1e-9) -> None:
    """Position, velocity and acceleration, with heading and its rate."""
    assert after.rows[:3] == pytest.approx(before.rows[:3], abs=places)
    assert after.rows[5, :2] == pytest.approx(before.rows[5, :2], abs=places)
