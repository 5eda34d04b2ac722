"""The verdict on a flight whose log has none, by what vehicles say in it."""

from pathlib import Path

import pytest

from companion.logs.info import info
from companion.logs.writer import Writer
from companion.outcomes import Outcome
from protocol.flightlog import Direction
from protocol.messages import Encoder, dialect

FLOWN, OTHER = 2, 1


def cut_off(path: Path, crashed: int, *, commanded: bool = True) -> Path:
    """The log of a flight of FLOWN beside OTHER, one of which crashes."""
    with Writer(path, 10**18, {"flight": {"mission": "courier"}}) as writer:
        for number, system in enumerate((FLOWN, OTHER, FLOWN, OTHER)):
            vehicle = Encoder(system, 1)
            data = vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 209, 6 << 16, 4, 3)
            if number > 1 and system == crashed:
                words = b"Crash: Disarming: AngErr=66>30"
                data += vehicle.encode_fields(dialect.MAVLink_statustext_message, 0, words, 0, 0)
            writer.datagram(10**9 * number, number, Direction.IN, "", data)
        fields = (0, FLOWN, 1, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
        sent = Encoder(FLOWN, 191).encode_fields(dialect.MAVLink_set_attitude_target_message, *fields)
        if commanded:
            writer.datagram(5 * 10**9, 5, Direction.OUT, "", sent)
    return path


@pytest.mark.parametrize(
    ("crashed", "commanded", "outcome"),
    [
        (FLOWN, True, Outcome.CRASHED),
        (OTHER, True, Outcome.UNFINISHED),
        (OTHER, False, Outcome.CRASHED),
    ],
)
def test_another_vehicle_s_crash_is_none_of_the_flown_one(
    tmp_path: Path, crashed: int, commanded: bool, outcome: Outcome
) -> None:
    """Where no setpoint says which one is flown, what any of them says counts."""
    verdict = info(cut_off(tmp_path / "flight.mcap", crashed, commanded=commanded)).verdict
    assert verdict is not None and verdict.outcome is outcome


@pytest.mark.parametrize("whole", [True, False])
def test_a_long_cause_is_told_as_far_as_it_came(tmp_path: Path, whole: bool) -> None:
    cause, log = "Crash: disarming: the angle error is 66 degrees, above 30", tmp_path / "flight.mcap"
    vehicle = Encoder(1, 1)
    with Writer(log, 10**18, {"flight": {"mission": "courier"}}) as writer:
        data = vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 209, 6 << 16, 4, 3)
        for piece in range(1 + whole):
            part = cause[50 * piece :][:50].encode()
            data += vehicle.encode_fields(dialect.MAVLink_statustext_message, 0, part, 5, piece)
            data += vehicle.encode_fields(dialect.MAVLink_statustext_message, 0, b"What came of it", 0, 0)
        writer.datagram(10**9, 1, Direction.IN, "", data)
    verdict = info(log).verdict
    said = cause if whole else cause[:50]
    assert verdict is not None and verdict.text == f"crashed: {said.partition(':')[2].strip()}"
