"""Where a vehicle stands, asked before its flight."""

import pytest

from companion.runtime.files import load_settings
from companion.runtime.locate import locate
from companion.runtime.station_files import origin_of
from tests.companion.runtime.test_check import IMPATIENT, NEVER_SENT, SETTINGS, Listened, Nobody


def test_the_place_is_the_vehicle_s_own_and_nothing_is_flown() -> None:
    link = Listened()
    place = locate(SETTINGS, link)
    assert place == pytest.approx(origin_of("empty"), abs=1e-6)
    assert not link.sent & NEVER_SENT and not link.vehicle.flight.armed


def test_without_a_vehicle_there_is_none() -> None:
    assert locate(load_settings(None, [IMPATIENT]), Nobody()) is None
