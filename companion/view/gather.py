"""One pass over a log, ours or one converted from another system's telemetry: everything that the report draws."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config import Settings
from companion.known_topics import is_foreign
from companion.logs.recordings import SETPOINTS
from companion.logs.settings import settings_or_defaults
from companion.logs.verdict import verdict_of
from companion.records import LOOP, TICK, TRACE
from companion.view.accumulators.clearance import Clearance
from companion.view.accumulators.estimator import EstimatorJumps
from companion.view.accumulators.interventions import Interventions
from companion.view.accumulators.last_values import LastValues
from companion.view.accumulators.parameters import Parameters
from companion.view.accumulators.paths import Paths
from companion.view.accumulators.power import Energy
from companion.view.accumulators.rates import BodyRates
from companion.view.accumulators.scans import ScansBySender, ring_sender
from companion.view.accumulators.senders import Senders
from companion.view.accumulators.texts import Texts
from companion.view.accumulators.timing import Timing
from companion.view.accumulators.tracking import Tracking
from companion.view.batches import Leap, Table, batches, sender_and_name
from companion.view.columns import message_columns, trace_columns
from companion.view.lines import Floats, Lines, Regularity, Stretches
from companion.view.rings import RING
from protocol.flightlog import TEXT, LogReader

BATTERY = "BATTERY_STATUS"
_DAY_NS = 86_400_000_000_000


class GatheredFlight:
    """What a log says of its flight: the composition of the accumulators, each of which answers one question.

    Keys of `lines` are "SOURCE:QUANTITY", where the source is "trace" or "SYSTEM/COMPONENT/MESSAGE" and the quantity
    one of `companion.view.columns`, with ".AXIS" behind it for a vector's.
    """

    def __init__(self, path: Path) -> None:
        """Read the whole log. Raises FlightLogError if it can't be opened."""
        self.log = LogReader(path)
        self.verdict = verdict_of(path, self.log.metadata)
        """None for a log that is no flight of this companion."""
        self.start_ns = 0
        """Time 0 of the charts, on the log's clock: the clock's own zero if that is less than a day before."""
        self.begin: float | None = None
        """s"""
        self.end = 0.0
        """s"""
        self.lines = Lines()
        self.clocks: dict[str, Regularity] = {}
        """By topic."""
        self.last = LastValues()
        self.states = Stretches()
        self.phases = Stretches()
        self.texts = Texts()
        self.tracking = Tracking()
        self.settings_read = settings_or_defaults(self.log.attachments.get("settings.json", b"{}"))
        self.clearance = Clearance(self.settings.avoidance.safe_distance)
        self.interventions = Interventions()
        self.timing = Timing()
        self.paths = Paths()
        self.body_rates = BodyRates()
        self.senders = Senders()
        self.scans = ScansBySender()
        self.jumps = EstimatorJumps()
        self.energy = Energy()
        self._parameters = Parameters()
        self._first_battery: dict[str, int] = {}
        """Number of the battery that each sender told of first."""
        leaps: list[Leap] = []
        for topic, _, times_ns, table in batches(self.log, leaps):
            self._add(topic, self._seconds(times_ns), table)
        self.texts.finish()
        self.leaps = [((leap.at_ns - self.start_ns) * 1e-9, leap.by_ns * 1e-9) for leap in leaps]
        """When the log's clock leapt and by how much (s): the times of the charts are without that."""

    def _seconds(self, times_ns: NDArray[np.int64]) -> Floats:
        """(n,) times of the log as seconds of the charts."""
        if self.begin is None:
            self.start_ns = 0 if 0 <= times_ns[0] < _DAY_NS else int(times_ns[0])
            self.begin = float(times_ns[0] - self.start_ns) * 1e-9
        times: Floats = (times_ns - self.start_ns) * 1e-9
        self.begin = min(self.begin, float(times[0]))
        self.end = max(self.end, float(times[-1]))
        return times

    def _add(self, topic: str, times: Floats, table: Any) -> None:
        self.clocks.setdefault(topic, Regularity()).add(times)
        self.last.add(topic, table)
        if topic == TRACE.topic:
            self._add_steps(times, table)
        elif topic == TICK.topic:
            self.timing.add_ticks(times, table)
        elif topic == LOOP.topic:
            self.timing.add_latencies(times, table)
        elif topic == TEXT.topic:
            self.texts.add_log(times, table)
        elif (message := sender_and_name(topic)) is not None:
            self._add_message(*message, times, table)

    def _add_steps(self, times: Floats, table: Table) -> None:
        for quantity, values in trace_columns(table).items():
            self.lines.add(f"trace:{quantity}", times, values)
        self.states.add(times, table["state"])
        self.phases.add(times, table["phase"])
        for part in (self.tracking, self.clearance, self.interventions, self.paths, self.body_rates):
            part.add_steps(times, table)

    def _add_message(self, sender: str, name: str, times: Floats, table: Any) -> None:
        if name == "STATUSTEXT":
            self.texts.add_statustexts(sender, times, table)
        elif name == "PARAM_VALUE":
            self._parameters.add(sender, table)
        elif name == BATTERY:
            self._add_batteries(sender, times, table)
        elif not isinstance(table, list):
            self._add_measurements(sender, name, times, table)

    def _add_batteries(self, sender: str, times: Floats, table: Table) -> None:
        """A vehicle may have several; the first that is told has the message's name, any other its number behind it."""
        first = self._first_battery.setdefault(sender, int(table["id"][0]))
        for number in np.unique(table["id"]).tolist():
            chosen = table["id"] == number
            source = f"{sender}/{BATTERY}" if number == first else f"{sender}/{BATTERY} {number}"
            self._add_columns(source, BATTERY, times[chosen], table[chosen])

    def _add_measurements(self, sender: str, name: str, times: Floats, table: Table) -> None:
        source = f"{sender}/{name}"
        if name == "HEARTBEAT":
            self.senders.add_heartbeats(sender, times, table)
        elif name in SETPOINTS:
            self.senders.commanded.add(table)
        elif (nearest := self.scans.add(sender, name, times, table)) is not None:
            self.lines.add(f"{sender}/{RING}:nearest", *nearest)
        for part in (self.paths, self.jumps, self.body_rates):
            part.add_message(sender, name, times, table)
        self._add_columns(source, name, times, table)

    def _add_columns(self, source: str, name: str, times: Floats, table: Table) -> None:
        columns = message_columns(name, table)
        for quantity, values in columns.items():
            self.lines.add(f"{source}:{quantity}", times, values)
        if "volts" in columns and "amperes" in columns:
            self.energy.add(source, times, columns["volts"] * columns["amperes"])

    @property
    def settings(self) -> Settings:
        """Those that were flown, as far as they can be read here."""
        return self.settings_read[0]

    @property
    def foreign(self) -> tuple[str, ...]:
        """The topics that are left out: they are not what their names say."""
        return tuple(sorted(topic for topic, kind in self.log.topics.items() if is_foreign(kind)))

    @property
    def has_trace(self) -> bool:
        """Whether the companion's trace is in the log."""
        return TRACE.topic in self.clocks

    @property
    def vehicle(self) -> str:
        """The autopilot ("system/component") that is reported on: the one that setpoints were sent to, or else the one
        that said most; empty if there is none."""
        counts: dict[str, int] = {}
        for topic, clock in self.clocks.items():
            message = sender_and_name(topic)
            if message is not None and message[0] in self.senders.modes:
                counts[message[0]] = counts.get(message[0], 0) + clock.count
        return max(counts, key=lambda sender: (self.senders.commanded.count(sender), counts[sender]), default="")

    @property
    def scanner(self) -> str:
        """Who sent the scans around it; empty without any."""
        return ring_sender(self.vehicle, self.scans.of, self.senders.modes)

    @property
    def batteries(self) -> tuple[str, ...]:
        """The sources of lines about the vehicle's batteries, each of which has its own; or of those about all of them,
        where it tells no more."""
        single = f"{self.vehicle}/{BATTERY}"
        found = {source for key in self.lines if (source := key.partition(":")[0]).partition(" ")[0] == single}
        return tuple(sorted(found)) or (f"{self.vehicle}/SYS_STATUS",)

    @property
    def output(self) -> str:
        """What was commanded, "auto" if that was left to the vehicle and the log was cut; empty for another's log."""
        metadata = self.log.metadata
        asked: str = metadata.get("flight", {}).get("output", "")
        flown: str = metadata.get("result", {}).get("output", asked)
        return flown

    @property
    def parameters(self) -> dict[str, float]:
        """The vehicle's parameters as it told them last."""
        return self._parameters.values(self.vehicle, self.senders.bytewise)
