"""What is sensed: telemetry becomes the state of the vehicle, and a scan gets the pose that it was taken from."""

import math

from companion.config import Settings
from companion.estimate import Estimator
from companion.perception.ground_below import GroundBelow
from companion.perception.ring_check import RingCheck
from companion.perception.surface_below import SurfaceBelow
from companion.plausibility import Plausibility
from companion.reports import (
    AttitudeReport,
    BatteryReading,
    ClockSet,
    OdometryReport,
    PositionReport,
    RangeBelow,
    Rebooted,
    RepeatedAttitude,
    Report,
    SensingReport,
)
from companion.state import Pose, Scan, VehicleState


class Sensing:
    """State, scans and their ages."""

    def __init__(self, velocity_settling: float = 0.0, *, needs_scan: bool, planner: str = "") -> None:
        """`velocity_settling`: see `companion.velocity_match`. `planner`: the name of one of another package, in whose
        process the map is made."""
        self.estimator = Estimator(velocity_settling)
        self.plausibility = Plausibility()
        self.judges = True
        """In flight it is asked whether what is sensed can be true; what is made up (a rehearsal's) can't."""
        self.state: VehicleState | None = None
        """At the latest attitude; None before both position and attitude have come."""
        self._needs_scan = needs_scan
        self.scan: Scan | None = None
        """The latest, if it came since the last `look`."""
        self.ring_check = RingCheck()
        self.below = SurfaceBelow()
        self.ground = GroundBelow()
        self._scan_boot_us: int | None = None
        self._doubted: tuple[str, int] | None = None
        """What the latest ring that did not count makes of `_unseen`, and when it came."""
        self._no_map = f"no map by {planner} for" if planner else "no map for"
        self._batteries: dict[int, BatteryReading] = {}
        """The latest by their source."""

    def begin(self, lowest_return: float, *, stands: bool) -> None:
        """A flight begins: what is sensed is judged from now on. What a scan shows below `lowest_return` (m, NED) is
        the ground. `stands`: the vehicle does, it is not taken over in flight."""
        self.estimator.begin(stands=stands)
        if self.judges:
            self.plausibility.watch(stands=stands)
        self.below.begin()
        self.ground_at(lowest_return)

    def ground_at(self, lowest_return: float, slope: float = 0.0) -> None:
        """What a scan shows below `lowest_return` (m, NED) is the ground, which may rise with a `slope`."""
        self.ring_check.ground_down, self.ring_check.ground_slope = lowest_return, slope
        self.below.lowest = lowest_return

    @property
    def present(self) -> VehicleState:
        """The state, where the telemetry is fresh: after a reboot no attitude may have come since the position."""
        state = self.state or self.estimator.state()
        assert state is not None
        return state

    @property
    def boot_time_ms(self) -> int:
        """The vehicle's clock at its latest attitude."""
        return self.estimator.boot_time_ms

    def take(self, report: Report, now_ns: int) -> bool:
        """Take a report in; whether it calls for a control step."""
        match report:
            case AttitudeReport():
                attitude = self.plausibility.attitude(report, now_ns)
                if attitude is not None:
                    self.estimator.attitude(attitude, now_ns)
                return True
            case PositionReport():
                position = self.plausibility.position(report, now_ns)
                if position is not None:
                    self.estimator.position(position, now_ns)
            case Scan():
                self._take_scan(report, now_ns)
            case RepeatedAttitude():
                return True
            case RangeBelow():
                pose = self.estimator.pose_at(1000 * report.boot_time_ms)
                self.below.take(report, pose, now_ns)
                self.ground.take(report, pose, now_ns)
            case BatteryReading():
                self._batteries[report.source] = report
            case OdometryReport():
                self.plausibility.resets(now_ns, reset=self.estimator.odometry(report))
            case ClockSet():
                self.estimator.clock_set(report.by_ms)
                self.plausibility.clock_set(report.by_ms)
            case Rebooted():
                self.estimator.restart()
                self.plausibility.restart()
        return False

    def _take_scan(self, scan: Scan, now_ns: int) -> None:
        """A scan that knows nothing, the same one again, or one that can't be true is none: the last one grows
        stale."""
        if not scan.known.any():
            self._doubted = "only blind rings for", now_ns
        elif scan.boot_time_us == self._scan_boot_us:
            self._doubted = "only repeated rings for", now_ns
        else:
            self._scan_boot_us = scan.boot_time_us
            pose = self.estimator.pose_at(scan.boot_time_us)
            if not self.plausibility.watches:
                self.scan, self.ring_check.sure_ns = scan, now_ns
            elif pose is not None and self.ring_check.believes(scan, pose, now_ns):
                self.scan = scan
            elif pose is not None:
                self._doubted = f"only {self.ring_check.doubt} rings for", now_ns

    def update(self) -> VehicleState | None:
        """The state at the attitude that has just come."""
        self.state = self.estimator.state()
        return self.state

    def look(self) -> tuple[Scan, Pose] | None:
        """The scan that came since the last call, with position (3,) and attitude (4,) at its own time."""
        scan, self.scan = self.scan, None
        pose = None if scan is None or self.state is None else self.estimator.pose_at(scan.boot_time_us)
        return None if scan is None or pose is None else (scan, pose)

    @property
    def implausible(self) -> dict[str, int]:
        """What was not believed up to now, as counts."""
        return {"motion_implausible": self.plausibility.refused, "rings_implausible": self.ring_check.refused}

    def scan_age(self, now_ns: int) -> float:
        """s since the latest scan arrived that nothing speaks against; inf before the first."""
        sure_ns = self.ring_check.sure_ns
        return math.inf if sure_ns is None else (now_ns - sure_ns) * 1e-9

    def is_blind(self, now_ns: int) -> bool:
        """No position has come for so long that the last one is not to be flown by."""
        return self.estimator.lacks_position(now_ns)

    def report(self, now_ns: int, map_age: float) -> SensingReport:
        """Ages; the surroundings are as old as the latest scan or as the map (s), whichever is older."""
        age_ns, ring_age = self.estimator.age_ns(now_ns), self.scan_age(now_ns)
        return SensingReport(
            telemetry_age=math.inf if age_ns is None else age_ns * 1e-9,
            scan_age=max(ring_age, map_age) if self._needs_scan else 0.0,
            has_state=self.state is not None,
            batteries=self._batteries,
            contradiction=self.plausibility.fault(now_ns),
            unseen=self._unseen(ring_age, map_age, now_ns),
        )

    def _unseen(self, ring_age: float, map_age: float, now_ns: int) -> str:
        """Words before the age of the surroundings: of two ages, what is older by far is what is missing."""
        if map_age > 2.0 * ring_age:  # a map is a little older than its ring
            return self._no_map
        if self._doubted is not None and ring_age > 2e-9 * (now_ns - self._doubted[1]):
            return self._doubted[0]
        return "no ring for"


def sensing_of(settings: Settings) -> Sensing:
    """As the settings want it."""
    avoidance, settling = settings.avoidance, settings.control.estimation.velocity_settling
    planner = "" if avoidance.plugin is None else f"{avoidance.plugin.kind.value} {avoidance.plugin.text}"
    return Sensing(settling, needs_scan=avoidance.needs_scan, planner=planner)
