"""Which autopilots sent heartbeats, and what they said of their mode and state."""

from collections import Counter

import numpy as np

from companion.view.batches import Table
from companion.view.lines import Floats, Stretches
from companion.view.vehicle_names import mode_name, vehicle_name
from protocol.messages import dialect

CRITICAL = (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY, dialect.MAV_STATE_FLIGHT_TERMINATION)
"""States of a vehicle's own failsafe, or worse."""


class Commanded:
    """Which vehicles setpoints were sent to."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()

    def add(self, table: Table) -> None:
        """Fields of SETPOINTS (n,)."""
        self._counts.update(table["target_system"].tolist())

    def count(self, sender: str) -> int:
        """How many were meant for its system: where there are any, that one is flown."""
        return self._counts[int(sender.partition("/")[0])]


class Senders:
    """By sender ("system/component"), for those that are an autopilot (not a companion or a ground station)."""

    def __init__(self) -> None:
        self.modes: dict[str, Stretches] = {}
        """Stretches of HEARTBEAT.custom_mode."""
        self._mode_names: dict[tuple[str, int], str] = {}
        """By sender and custom_mode."""
        self.names: dict[str, str] = {}
        """What the sender is."""
        self.armed: dict[str, Stretches] = {}
        """1 while armed."""
        self.critical: dict[str, Stretches] = {}
        """1 while the state was critical or an emergency."""
        self.bytewise: set[str] = set()
        """Senders that put the bits of an integer parameter into PARAM_VALUE's float, as PX4 does."""
        self.commanded = Commanded()

    def name(self, sender: str) -> str:
        """What the sender is, with its number where there are several."""
        return self.names[sender] if len(self.names) == 1 else f"{self.names[sender]} {sender}"

    def mode(self, sender: str, number: int) -> str:
        """What the sender's maker calls this custom_mode of it."""
        return self._mode_names.get((sender, number), f"mode {number}")

    def add_heartbeats(self, sender: str, times: Floats, table: Table) -> None:
        """Times (n,) in s and fields of HEARTBEAT (n,)."""
        flown = table["autopilot"] != dialect.MAV_AUTOPILOT_INVALID
        times, table = times[flown], table[flown]
        if not len(table):
            return
        for autopilot, kind, mode in {(int(r["autopilot"]), int(r["type"]), int(r["custom_mode"])) for r in table}:
            if autopilot == dialect.MAV_AUTOPILOT_PX4:
                self.bytewise.add(sender)
            self._mode_names[sender, mode] = mode_name(autopilot, kind, mode)
            self.names[sender] = vehicle_name(autopilot, kind)
        armed = (table["base_mode"] & dialect.MAV_MODE_FLAG_SAFETY_ARMED) != 0
        critical = np.isin(table["system_status"], CRITICAL)
        self.modes.setdefault(sender, Stretches()).add(times, table["custom_mode"].astype(np.int64))
        self.armed.setdefault(sender, Stretches()).add(times, armed.astype(np.int64))
        self.critical.setdefault(sender, Stretches()).add(times, critical.astype(np.int64))
