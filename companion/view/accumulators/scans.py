"""The LiDAR scans that the vehicles sent, thinned for a chart."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

import numpy as np

from companion.view.batches import Table
from companion.view.lines import Floats, ScanRows
from companion.view.rings import RingTables, shows_around


def ring_sender(vehicle: str, scanners: Iterable[str], vehicles: Collection[str]) -> str:
    """Whose scans are those around a vehicle, of the `scanners` that sent any, as the companion has it (docs/lidar.md):
    a driver's with ids of its own, those of another component of the vehicle's system, or the vehicle's; empty without.

    All are "system/component"; `vehicles` are autopilots.
    """
    flown, own = {_system(each) for each in vehicles}, _system(vehicle)
    best: tuple[int, str] = (0, "")
    for sender in scanners:
        if sender == vehicle:
            rank = 1
        elif sender in vehicles or (_system(sender) in flown and _system(sender) != own):
            continue  # another vehicle's
        else:
            rank = 2 if _system(sender) == own else 3
        best = max(best, (rank, sender))
    return best[1]


def _system(sender: str) -> str:
    return sender.partition("/")[0]


class ScansBySender:
    """The scans of all senders, from whatever message each sends them in."""

    def __init__(self) -> None:
        self.of: dict[str, Scans] = {}
        self.left_out = 0
        """Rings that can't be drawn around a vehicle."""
        self._rings = RingTables()

    def add(self, sender: str, name: str, times: Floats, table: Table) -> tuple[Floats, Floats] | None:
        """Times (n,) in s and n messages; returns the times (k,) of the scans that they complete and the nearest range
        (k,) of each in m, NaN if nothing is seen. None if they complete none."""
        rings = self._rings.take(sender, name, times, table)
        if rings is None:
            return None
        times, table = rings
        around = shows_around(table)
        self.left_out += len(times) - int(around.sum())
        times, table = times[around], table[around]
        return (times, self.of.setdefault(sender, Scans()).add(times, table)) if len(times) else None


@dataclass(slots=True)
class Scans:
    """The scans (OBSTACLE_DISTANCE) of one sender."""

    rows: ScanRows = field(default_factory=ScanRows)
    offset_deg: float = 0.0
    """Bearing of the first beam."""
    increment_deg: float = 5.0
    """Between two beams, clockwise."""

    def add(self, times: Floats, table: Table) -> Floats:
        """Times (n,) in s and fields (n,); returns the nearest range of each scan (n,) in m, NaN if nothing is seen."""
        distances = table["distances"].astype(np.float64)
        ranges = np.where(distances <= table["max_distance"][:, None], distances * 0.01, np.nan)
        for at, row in zip(times.tolist(), ranges, strict=True):
            self.rows.add(at, row)
        last = table[-1]
        self.increment_deg = float(last["increment_f"]) or float(last["increment"])
        self.offset_deg = float(last["angle_offset"])
        with np.errstate(all="ignore"):
            nearest: Floats = np.fmin.reduce(ranges, axis=1)
        return nearest
