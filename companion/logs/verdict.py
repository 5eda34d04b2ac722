"""The verdict on the flight of a log, the same for whoever asks."""

from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from companion.known_topics import is_foreign
from companion.link.vehicle_texts import VehicleTexts
from companion.logs.recordings import commanded, unpack
from companion.outcomes import CRITICAL_STATE, Outcome, Verdict, crash_words, recorded, worst
from protocol.flightlog import LogReader

_ARMED, _NO_AUTOPILOT = 128, 8
"""MAV_MODE_FLAG_SAFETY_ARMED, MAV_AUTOPILOT_INVALID: without the MAVLink dialect, which takes longer to load than a
log's summary to read."""
_ALERT = 1
"""MAV_SEVERITY"""
_CRITICAL, _EMERGENCY = frozenset({5, 6, 8}), frozenset({6, 8})
"""MAV_STATE: critical, emergency, flight termination."""


def verdict_of(path: Path, metadata: dict[str, dict[str, str]]) -> Verdict | None:
    """The verdict on a log's flight; None if it is no flight of this companion.

    Logs without one (of versions up to 0.1, or cut off) are judged by what the vehicle says in them. Raises
    FlightLogError for one in which that is not as its schema says.
    """
    result = metadata.get("result", {})
    found = recorded(result)
    if "outcome" in result or (found is None and "mission" not in metadata.get("flight", {})):
        return found
    told = _told(LogReader(path))
    if found is None:
        return told or Verdict(Outcome.UNFINISHED)
    return found if told is None else worst([found, told])


def _told(log: LogReader) -> Verdict | None:
    """What the vehicle says in a log, from its first arming on, of a crash or an emergency; None if nothing. Of several
    it is the one that setpoints were sent to. Raises FlightLogError for a record that is too short."""
    kinds, systems = log.topics, commanded(log)
    asked = [
        topic
        for topic, kind in kinds.items()
        if topic.startswith("/mavlink/") and topic.endswith(("/HEARTBEAT", "/STATUSTEXT")) and not is_foreign(kind)
        if not systems or topic.split("/")[2] in systems
    ]
    flown, critical, fallen, alarm = set[str](), False, False, _Alarm()
    for record in log.records(asked):
        sender, _, name = record.topic.rpartition("/")
        fields = unpack(log, kinds[record.topic], record)
        if name == "STATUSTEXT":
            if sender in flown and fields["severity"] <= _ALERT:
                alarm.take(sender, SimpleNamespace(**fields), record.time_ns)
        elif fields["autopilot"] != _NO_AUTOPILOT:
            armed, state = bool(fields["base_mode"] & _ARMED), fields["system_status"]
            if armed:
                flown.add(sender)
            if sender in flown:
                critical = critical or state in _CRITICAL
                fallen = fallen or (state in _EMERGENCY and not armed)
    crash = crash_words(alarm.text, fallen=fallen)
    if crash:
        return Verdict(Outcome.CRASHED, crash)
    return Verdict(Outcome.EMERGENCY, alarm.text or CRITICAL_STATE) if alarm.text or critical else None


class _Alarm:
    """The first text of vehicles, as far as it came."""

    def __init__(self) -> None:
        self.text = ""
        self._from: tuple[str, int, int] | None = None
        """Its sender, its number, and when it began."""
        self._texts = defaultdict[str, VehicleTexts](VehicleTexts)

    def take(self, sender: str, message: Any, now_ns: int) -> None:
        said = self._texts[sender].take(message, now_ns)
        if said is not None and self._from in (None, begun := (sender, message.id, said.began_ns)):
            self.text, self._from = said.text, begun
