"""The battery failsafe: what the readings of all batteries call for, and whether the charge suffices for the way home.

Each source (a battery, or SYS_STATUS, which names none) is judged by itself, and the worst counts. Of its latest five
readings the middle one does, so that a reading that jumps changes nothing and one that is often low does. In flight a
level is never taken back: a battery recovers as soon as it is loaded less.

The consumption is what the charge has lost since shortly after the take-off or in the last minute, whichever is more a
second. A source that falls silent is taken to go on like that.
"""

from collections import deque
from collections.abc import Mapping

import msgspec

from companion.config_limits import Battery
from companion.reports import SYSTEM_BATTERY, BatteryReading
from companion.state import BatteryLevel

_PERIOD_NS = 500_000_000
_READINGS = 5
_SILENT_S = 10.0
"""A source without a reading for so long is silent."""
_LOADED_S = 5.0
"""From the take-off until the charge is that of a loaded battery: the consumption counts from there."""
_SAMPLE_S = 5.0
_SAMPLES = 13
"""A minute of them."""
_LEAST_S = 15.0
_LEAST_DROP = 0.025
"""The consumption is known from so long a time and so much of the charge on: readings are whole percents."""
_STUCK_S = 60.0
_STUCK_UNKNOWN_S = 300.0
"""A charge that does not change in the air for so long is stuck: the latter where it never has changed."""
_STUCK_STEPS = 4.0
"""Steps of one percent, at the consumption, that a charge may be late before it is stuck."""
_STEP = 0.01
_SHORT_S = 1.0
"""The charge must be too little for the way home for so long."""
_TURN_S = 6.0
"""What it takes to see that, to stop and to turn round."""
_ROUNDING = 1e-6


class BatteryVerdict(msgspec.Struct, frozen=True, gc=False):
    """What the batteries call for."""

    level: BatteryLevel = BatteryLevel.FINE
    text: str = ""
    """Why, in words; empty while all is fine."""
    missing: str | None = None
    """What a flight lacks that has not begun."""
    news: str = ""
    """What is to be said, once; empty for nothing."""


class _Source:
    """One battery."""

    def __init__(self) -> None:
        self.heard_ns = -1
        """-1: not yet."""
        self._charges: deque[float] = deque(maxlen=_READINGS)
        self._levels: deque[tuple[BatteryLevel, str]] = deque(maxlen=_READINGS)
        self._latest: float | None = None
        self._changed_ns = 0
        self._base: tuple[int, float] | None = None
        """When the consumption began to count (ns), and the charge then."""
        self._samples: deque[tuple[int, float]] = deque(maxlen=_SAMPLES)
        self._airborne_ns: int | None = None

    def take(self, reading: BatteryReading, level: BatteryLevel, words: str) -> None:
        """A reading, and what it calls for by itself."""
        self.heard_ns = reading.time_ns
        self._levels.append((level, words))
        if reading.charge is not None:
            self._charges.append(reading.charge)
            if reading.charge != self._latest:
                self._latest, self._changed_ns = reading.charge, reading.time_ns

    @property
    def level(self) -> tuple[BatteryLevel, str]:
        """What the middle one of the latest readings calls for."""
        return sorted(self._levels)[len(self._levels) // 2]

    @property
    def measured(self) -> float | None:
        """The charge by the middle one of the latest readings."""
        return sorted(self._charges)[(len(self._charges) - 1) // 2] if self._charges else None

    def watch(self, airborne: bool, now_ns: int) -> None:
        """Follow the consumption."""
        charge = self.measured
        if not airborne or charge is None:
            return
        if self._airborne_ns is None:
            self._airborne_ns = self._changed_ns = now_ns
        if now_ns - self._airborne_ns < _LOADED_S * 1e9:
            return
        self._base = self._base or (now_ns, charge)
        if not self._samples or now_ns - self._samples[-1][0] >= _SAMPLE_S * 1e9:
            self._samples.append((now_ns, charge))

    @property
    def consumption(self) -> float | None:
        """Charge a second; None while it is not known."""
        return self._consumption(self.heard_ns)

    def _consumption(self, until_ns: int) -> float | None:
        charge = self.measured
        if charge is None or self._base is None:
            return None
        rates = [
            (before - charge) / ((until_ns - then) * 1e-9)
            for then, before in (self._base, self._samples[0])
            if until_ns - then >= _LEAST_S * 1e9 and before - charge >= _LEAST_DROP
        ]
        return max(rates, default=None)

    def silence(self, now_ns: int) -> float:
        """s by which a reading is overdue; 0 while they come."""
        return max((now_ns - self.heard_ns) * 1e-9 - _SILENT_S, 0.0)

    def charge(self, now_ns: int) -> float | None:
        """The charge, carried on by the consumption where the source is silent."""
        charge, silence = self.measured, self.silence(now_ns)
        if charge is None or silence == 0.0:
            return charge
        return charge - (self.consumption or 0.0) * (silence + _SILENT_S)

    def stuck(self, now_ns: int) -> bool:
        """Readings come in the air, and do not change."""
        if self._airborne_ns is None or self.measured is None or self.silence(now_ns):
            return False
        rate = self._consumption(self._changed_ns)
        limit = _STUCK_UNKNOWN_S if rate is None else max(_STUCK_S, _STUCK_STEPS * _STEP / rate)
        return (now_ns - self._changed_ns) * 1e-9 > limit


class BatteryWatch:
    """All batteries of one flight."""

    def __init__(self, settings: Battery) -> None:
        self._settings = settings
        self._charges = settings.warn_charge, settings.return_charge, settings.land_charge
        self._sources: dict[int, _Source] = {}
        self._verdict = BatteryVerdict()
        self._told = BatteryLevel.FINE
        """The worst level that was said in flight."""
        self._due_ns = 0
        self._flying_ns: int | None = None
        """When the flight began."""
        self._short_since_ns: int | None = None
        self._said: set[str] = set()
        """Doubts, each of which is said once."""

    def judge(
        self, readings: Mapping[int, BatteryReading], landing_s: float, flying: bool, airborne: bool, now_ns: int
    ) -> BatteryVerdict:
        """What the readings call for, `landing_s` (s) from the landing place. While `flying` it never gets better."""
        if now_ns < self._due_ns:
            return self._verdict
        self._due_ns = now_ns + _PERIOD_NS
        for reading in readings.values():
            source = self._sources.setdefault(reading.source, _Source())
            if reading.time_ns != source.heard_ns:
                source.take(reading, *self._of(reading))
            source.watch(airborne, now_ns)
        if flying and self._flying_ns is None:
            self._flying_ns = now_ns
        doubts = self._doubts(now_ns)
        level, text = self._worst(doubts if flying else [], landing_s, now_ns)
        if not flying:
            self._verdict = BatteryVerdict(level, text, self._missing(level, text, doubts))
            return self._verdict
        news = [text] if level > self._told else []
        self._told = max(level, self._told)
        if news or self._verdict.missing:
            self._verdict = BatteryVerdict(level, text)
        news += [doubt for doubt in doubts if doubt not in self._said and doubt not in news]
        self._said.update(doubts)
        return msgspec.structs.replace(self._verdict, news=", ".join(news)) if news else self._verdict

    def _of(self, reading: BatteryReading) -> tuple[BatteryLevel, str]:
        """What one reading calls for by itself, and why."""
        settings = self._settings
        found = [(reading.level, reading.condition)]
        if reading.charge is not None:
            found.append(_under(reading.charge, self._charges, f"at {100.0 * reading.charge:.0f} %"))
        cell = reading.cell_volts
        if cell is None and reading.volts is not None and settings.cells is not None:
            cell = reading.volts / settings.cells
        if cell is not None:
            thresholds = (settings.warn_voltage or 0.0, settings.return_voltage or 0.0, settings.land_voltage or 0.0)
            found.append(_under(cell, thresholds, f"at {cell:.2f} V a cell"))
        return max(found, key=lambda each: each[0])

    def _name(self, source: int) -> str:
        several = sum(each >= 0 for each in self._sources) > 1
        return f"battery {source}" if several and source >= 0 else "battery"

    def _counting(self, now_ns: int) -> list[tuple[int, _Source]]:
        """All sources but silent ones that another one stands for: SYS_STATUS, or the only battery where SYS_STATUS
        still comes."""
        alive = [number for number, source in self._sources.items() if not source.silence(now_ns)]
        several = sum(number >= 0 for number in self._sources) > 1
        return [
            (number, source)
            for number, source in self._sources.items()
            if number in alive or not alive or (number != SYSTEM_BATTERY and several)
        ]

    def _worst(self, doubts: list[str], landing_s: float, now_ns: int) -> tuple[BatteryLevel, str]:
        """The worst level and its reason."""
        settings = self._settings
        found, short = [(BatteryLevel.FINE, "")], ""
        if doubts and settings.required:
            found.append((BatteryLevel.RETURN, doubts[0]))
        for number, source in self._counting(now_ns):
            name, (level, words) = self._name(number), source.level
            found.append((level, f"{name} {words}"))
            charge, rate = source.charge(now_ns), source.consumption
            if charge is None:
                continue
            if source.silence(now_ns):
                words = f"{name} silent, {100.0 * max(charge, 0.0):.0f} % reckoned"
                found.append(_under(charge, self._charges, words))
            needed = settings.land_charge + settings.way_home_margin * (rate or 0.0) * (landing_s + _TURN_S)
            if rate and settings.way_home_margin and charge < needed:
                short = f"{name} at {100.0 * charge:.0f} %, {100.0 * needed:.0f} % needed for the way home"
        if short:
            self._short_since_ns = self._short_since_ns or now_ns
            if now_ns - self._short_since_ns >= _SHORT_S * 1e9:
                found.append((BatteryLevel.RETURN, short))
        else:
            self._short_since_ns = None
        return max(found, key=lambda each: each[0])

    def _doubts(self, now_ns: int) -> list[str]:
        """What is not known of the batteries. A vehicle that has just been taken over in flight may still report."""
        counting, began_ns = self._counting(now_ns), self._flying_ns
        if all(source.measured is None for _, source in counting):
            early = began_ns is not None and now_ns - began_ns < _SILENT_S * 1e9
            return [] if early else ["no battery reports its charge"]
        doubts = [f"{self._name(number)} silent" for number, source in counting if source.silence(now_ns)]
        return doubts + [
            f"{self._name(number)} stuck at {100.0 * (source.measured or 0.0):.0f} %"
            for number, source in counting
            if source.stuck(now_ns)
        ]

    def _missing(self, level: BatteryLevel, text: str, doubts: list[str]) -> str | None:
        """What is missing for a start."""
        if level >= BatteryLevel.RETURN:
            return f"{text}: too low for a flight"
        return doubts[0] if doubts and self._settings.required else None


def _under(value: float, thresholds: tuple[float, float, float], text: str) -> tuple[BatteryLevel, str]:
    """The level that a value has sunk to; `thresholds` of warn, return, land, 0 where there is none."""
    level = BatteryLevel.FINE
    for each, threshold in zip((BatteryLevel.WARN, BatteryLevel.RETURN, BatteryLevel.LAND), thresholds, strict=True):
        if threshold > 0.0 and value < threshold - _ROUNDING:
            level = each
    return level, text if level else ""
