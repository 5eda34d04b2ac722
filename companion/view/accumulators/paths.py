"""Where the vehicle was, and how far it flew."""

import numpy as np

from companion.logs.recordings import FARTHEST_M
from companion.mission.plan import Phase
from companion.view.accumulators.continuation import Continuation
from companion.view.batches import Table
from companion.view.lines import Floats, Track

_EARTH_RADIUS_M = 6371000.0


class Paths:
    """Paths in NED axes (m), from the companion's trace and from the positions that the vehicles told."""

    def __init__(self) -> None:
        self.traced = Track(10)
        """Rows of time (s), position, reference and avoidance's target."""
        self.told: dict[str, Track] = {}
        """Rows of time (s) and position, by sender; from GLOBAL_POSITION_INT by sender and " global"."""
        self.distance_m = 0.0
        """Length of the traced path from take-off on."""
        self._trace = Continuation()
        self._homes: dict[str, tuple[float, float]] = {}
        """Latitude and longitude (rad) of the first fix, by sender."""

    def add_steps(self, times: Floats, table: Table) -> None:
        """Control steps: times (n,) in s and records of the trace (n,)."""
        rows = (table["position_ned"], table["reference_position_ned"], table["target_ned"])
        self.traced.add(times, np.column_stack(rows))
        joined = self._trace.join(table)
        airborne = joined["phase"][1:] > Phase.PREPARE.value
        steps = np.linalg.norm(np.diff(joined["position_ned"], axis=0), axis=1)
        self.distance_m += float(steps[airborne].sum())

    def add_message(self, sender: str, name: str, times: Floats, table: Table) -> None:
        """Messages of one name: times (n,) in s and fields (n,); names without a position are ignored."""
        if name == "LOCAL_POSITION_NED":
            rows = np.column_stack((table["x"], table["y"], table["z"]))
            known = (abs(rows) <= FARTHEST_M).all(axis=1)
            self.told.setdefault(sender, Track(4)).add(times[known], rows[known])
        elif name == "GLOBAL_POSITION_INT":
            self._global_position(sender, times, table)

    def _global_position(self, sender: str, times: Floats, table: Table) -> None:
        """Metres north and east of the first fix, on a sphere; a position of 0, 0 is no fix."""
        fixed = (table["lat"] != 0) | (table["lon"] != 0)
        times, table = times[fixed], table[fixed]
        if not len(table):
            return
        latitudes, longitudes = np.radians(table["lat"] * 1e-7), np.radians(table["lon"] * 1e-7)
        home = self._homes.setdefault(sender, (float(latitudes[0]), float(longitudes[0])))
        turned = (longitudes - home[1] + np.pi) % (2.0 * np.pi) - np.pi  # also across 180 degrees
        north, east = _EARTH_RADIUS_M * (latitudes - home[0]), _EARTH_RADIUS_M * np.cos(home[0]) * turned
        rows = np.column_stack((north, east, table["relative_alt"] * -1e-3))
        self.told.setdefault(f"{sender} global", Track(4)).add(times, rows)
