"""The verdict on the flight of a log, the same for whoever asks."""

from pathlib import Path

from companion.logs.recordings import commanded
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

    Logs without one (of versions up to 0.1, or cut off) are judged by what the vehicle says in them.
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
    it is the one that setpoints were sent to."""
    kinds, systems = log.topics, commanded(log)
    asked = [
        topic
        for topic in kinds
        if topic.startswith("/mavlink/") and topic.endswith(("/HEARTBEAT", "/STATUSTEXT"))
        if not systems or topic.split("/")[2] in systems
    ]
    flown, critical, fallen, said = set[str](), False, False, ""
    for record in log.records(asked):
        sender, _, name = record.topic.rpartition("/")
        fields = kinds[record.topic].unpack(record.data)
        if name == "STATUSTEXT":
            if sender in flown and fields["severity"] <= _ALERT:
                said = said or fields["text"]
        elif fields["autopilot"] != _NO_AUTOPILOT:
            armed, state = bool(fields["base_mode"] & _ARMED), fields["system_status"]
            if armed:
                flown.add(sender)
            if sender in flown:
                critical = critical or state in _CRITICAL
                fallen = fallen or (state in _EMERGENCY and not armed)
    crash = crash_words(said, fallen=fallen)
    if crash:
        return Verdict(Outcome.CRASHED, crash)
    return Verdict(Outcome.EMERGENCY, said or CRITICAL_STATE) if said or critical else None
