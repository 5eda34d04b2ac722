"""Types of records: their definitions, in a file and out of it."""

import numpy as np
import pytest

from protocol.flightlog import (
    FlightLogError,
    LogReader,
    RecordType,
    record_type,
)
from tests.protocol.flightlog.made_logs import (
    COUNT,
    TRACE,
    Opener,
    count,
)


def test_varying_records_are_no_array(start: Opener) -> None:
    log = start()
    count(log, range(3))
    log.close()
    with pytest.raises(FlightLogError, match=COUNT.topic):
        LogReader(log.path).array(COUNT.topic)


@pytest.mark.parametrize(
    "field",
    [("a", "float64[]x"), ("a", "float16"), ("a", "string[]"), ("a", "uint8[0]"), ("a b", "uint8"), ("uint8", "a")],
)
def test_impossible_types(field: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match=field[0]):
        record_type("/t", "courier/T", [field])


def test_definition_survives_the_file() -> None:
    again = RecordType(TRACE.topic, TRACE.schema_name, TRACE.definition)
    assert again.fields == TRACE.fields
    assert again.size == TRACE.size == 30
    assert again.dtype == np.dtype([("position_ned", "<f8", (3,)), ("phase", "u1"), ("armed", "?"), ("thrust", "<f4")])
