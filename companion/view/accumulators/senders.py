"""Which autopilots sent heartbeats, and what they said of their mode and state."""

import numpy as np

from companion.link.firmware import firmware_of
from companion.view.batches import Table
from companion.view.lines import Floats, Stretches
from protocol.messages import dialect

_CRITICAL = (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY)


class Senders:
    """By sender ("system/component"), for those that are an autopilot (not a companion or a ground station)."""

    def __init__(self) -> None:
        self.modes: dict[str, Stretches] = {}
        """Stretches of HEARTBEAT.custom_mode."""
        self.mode_names: dict[int, str] = {}
        """By custom_mode."""
        self.armed: dict[str, Stretches] = {}
        """1 while armed."""
        self.critical: dict[str, Stretches] = {}
        """1 while the state was critical or an emergency."""
        self.bytewise: set[str] = set()
        """Senders that put the bits of an integer parameter into PARAM_VALUE's float, as PX4 does."""

    def add_heartbeats(self, sender: str, times: Floats, table: Table) -> None:
        """Times (n,) in s and fields of HEARTBEAT (n,)."""
        flown = table["autopilot"] != dialect.MAV_AUTOPILOT_INVALID
        times, table = times[flown], table[flown]
        if not len(table):
            return
        for autopilot, mode in {(int(row["autopilot"]), int(row["custom_mode"])) for row in table}:
            if autopilot == dialect.MAV_AUTOPILOT_PX4:
                self.bytewise.add(sender)
            firmware = firmware_of(autopilot)
            self.mode_names[mode] = firmware.mode_of(mode).value if firmware else f"mode {mode}"
        armed = (table["base_mode"] & dialect.MAV_MODE_FLAG_SAFETY_ARMED) != 0
        critical = np.isin(table["system_status"], _CRITICAL)
        self.modes.setdefault(sender, Stretches()).add(times, table["custom_mode"].astype(np.int64))
        self.armed.setdefault(sender, Stretches()).add(times, armed.astype(np.int64))
        self.critical.setdefault(sender, Stretches()).add(times, critical.astype(np.int64))
