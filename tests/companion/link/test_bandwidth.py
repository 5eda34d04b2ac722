"""Rates that a link carries."""

import pytest

from companion.config import Rates
from companion.link.bandwidth import fitted

WANTED = Rates()


@pytest.mark.parametrize("more", [0, 13])
@pytest.mark.parametrize("scans", [True, False])
@pytest.mark.parametrize("baud", [115_200, 230_400, 460_800, 921_600, 3_000_000])
def test_what_is_asked_for_fits_both_ways_with_room_to_spare(baud: int, scans: bool, more: int) -> None:
    """`more` bytes each with a signature."""
    rates, capacity = fitted(WANTED, baud / 10, scans=scans, signed=more > 0), baud / 10
    incoming = (44 + more) * rates.attitude + (40 + more) * rates.position + (300 + more) * rates.scan * scans
    incoming += (245 + more) * rates.odometry
    assert incoming < 0.7 * capacity and (51 + more) * rates.attitude < 0.7 * capacity
    assert 20.0 <= rates.attitude <= WANTED.attitude and rates.scan >= 5.0
    flown = rates.attitude, rates.position, rates.scan
    assert (flown == (WANTED.attitude, WANTED.position, WANTED.scan)) is (baud >= 460_800) or more
    assert rates.odometry == 0.0 or rates.odometry >= 5.0
    assert rates.least_share == WANTED.least_share


def test_a_faster_link_gives_no_less() -> None:
    attitudes = [fitted(WANTED, capacity, scans=True).attitude for capacity in range(8000, 100_000, 500)]
    assert attitudes == sorted(attitudes)


def test_odometry_gets_what_the_flight_leaves() -> None:
    asked = [fitted(WANTED, baud / 10, scans=True).odometry for baud in (230_400, 460_800, 921_600)]
    assert asked[0] == 0.0 and 0.0 < asked[1] < WANTED.odometry == asked[2]


def test_a_link_that_carries_no_flight_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(ValueError, match=r"carries 960 bytes a second, a flight needs \d{4}"):
        fitted(WANTED, 960.0, scans=False)
