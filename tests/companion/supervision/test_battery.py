"""The battery failsafe: each class of reading has its answer, and nothing in flight takes one back."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config_limits import Battery
from companion.reports import SYSTEM_BATTERY, BatteryReading
from companion.state import BatteryLevel
from companion.supervision.battery import BatteryVerdict, BatteryWatch

FINE, WARN, RETURN, LAND = BatteryLevel
SECOND = 1_000_000_000
PERIOD = SECOND // 50


@dataclass
class Flight:
    """A watch that is asked 50 times a second; readings come once a second."""

    watch: BatteryWatch = field(default_factory=lambda: BatteryWatch(Battery()))
    now: int = SECOND
    landing_s: float = 0.0
    flying: bool = True
    readings: dict[int, BatteryReading] = field(default_factory=dict)
    news: list[str] = field(default_factory=list)
    levels: list[BatteryLevel] = field(default_factory=list)

    def second(self, **sources: Any) -> BatteryVerdict:
        """One second that begins with these readings: `b0`, `b1`: charges or readings of batteries; `system`."""
        for name, value in sources.items():
            source = SYSTEM_BATTERY if name == "system" else int(name[1:])
            fields = value if isinstance(value, dict) else {"charge": value}
            self.readings[source] = BatteryReading(source, self.now, **fields)
        for _ in range(50):
            verdict = self.watch.judge(self.readings, self.landing_s, self.flying, self.flying, self.now)
            self.news += [verdict.news] if verdict.news else []
            self.levels.append(verdict.level)
            self.now += PERIOD
        return verdict

    def seconds(self, charges: Iterable[float]) -> "Flight":
        for charge in charges:
            self.second(b0=charge)
        return self

    @property
    def level(self) -> BatteryLevel:
        return self.levels[-1] if self.levels else FINE


def flight(**changes: Any) -> Flight:
    return Flight(BatteryWatch(Battery(**changes)))


def percent(charge: float) -> float:
    """As it comes over the wire."""
    return round(charge * 100.0) / 100.0


@pytest.mark.parametrize(("charge", "level"), [(0.25, FINE), (0.24, WARN), (0.15, WARN), (0.14, RETURN), (0.06, LAND)])
def test_a_charge_below_a_threshold_calls_for_its_answer(charge: float, level: BatteryLevel) -> None:
    assert flight().seconds([charge] * 5).level is level


def test_each_level_is_said_once_and_names_the_charge() -> None:
    told = flight().seconds(percent(0.4 - 0.01 * second) for second in range(40))
    assert len(told.news) == 3 and all("battery at" in each and "%" in each for each in told.news)
    assert told.level is LAND


def test_a_charge_that_was_low_before_the_start_is_said_once_in_flight() -> None:
    told = flight()
    told.flying = False
    assert told.seconds([0.2] * 5).news == []
    told.flying = True
    assert told.seconds([0.2] * 5).news == ["battery at 20 %"]
    assert told.level is WARN


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60))
@settings(max_examples=60)
def test_no_reading_takes_an_answer_back_in_flight(charges: list[float]) -> None:
    levels = flight().seconds(charges).levels
    assert levels == sorted(levels)


def test_before_the_flight_a_charge_may_recover() -> None:
    """A battery that is changed, or was read wrongly at first."""
    waiting = flight()
    waiting.flying = False
    waiting.seconds([0.1] * 5)
    low = waiting.second(b0=0.1)
    assert low.missing is not None and "10 %" in low.missing
    waiting.seconds([0.9] * 5)
    assert waiting.second(b0=0.9).missing is None and waiting.level is FINE


@pytest.mark.parametrize("jump", [0.0, 0.05, 1.0])
def test_a_reading_that_jumps_changes_nothing(jump: float) -> None:
    charges = [0.8] * 20
    charges[4:6] = [jump, jump]
    charges[12] = jump
    assert flight().seconds(charges).level is FINE


def test_a_reading_that_is_often_low_counts() -> None:
    assert flight().seconds([0.8, 0.1] * 10).level is RETURN


@pytest.mark.parametrize("low", [0, 1])
def test_the_worse_of_two_batteries_counts_and_is_named(low: int) -> None:
    both = flight()
    for _ in range(5):
        verdict = both.second(b0=0.1 if low == 0 else 0.9, b1=0.1 if low == 1 else 0.9)
    assert verdict.level is RETURN and f"battery {low} at 10 %" in verdict.text


def test_the_system_s_status_alone_suffices() -> None:
    told = flight()
    for _ in range(5):
        told.second(system=0.1)
    assert told.level is RETURN and not any("silent" in each or "reports" in each for each in told.news)


def test_a_battery_that_never_reports_is_said_and_flown_with() -> None:
    told = flight()
    for _ in range(30):
        told.second(system={"charge": None, "volts": 12.0})
    assert told.level is FINE and told.news == ["no battery reports its charge"]


@pytest.mark.parametrize("sources", [{}, {"system": {"charge": None}}, {"b0": {"charge": None}}])
def test_a_battery_that_never_reports_is_refused_where_one_is_required(sources: dict[str, Any]) -> None:
    waiting = flight(required=True)
    waiting.flying = False
    assert waiting.second(**sources).missing == "no battery reports its charge"
    assert waiting.second(b0=0.9).missing is None
    waiting.flying = True
    assert waiting.second(b0=0.9).level is FINE


@pytest.mark.parametrize(("silent_s", "level"), [(3, FINE), (9, FINE), (12, RETURN)])
def test_a_vehicle_that_is_taken_over_in_flight_has_time_to_report(silent_s: int, level: BatteryLevel) -> None:
    told = flight(required=True)
    for _ in range(silent_s):
        told.second()
    told.seconds([0.9] * 5)
    assert told.level is level and bool(told.news) is (level is RETURN)


def drains(rate: float, start: float = 0.9) -> Callable[[int], float]:
    return lambda second: percent(start - rate * second)


def test_a_battery_that_falls_silent_is_taken_to_go_on_draining() -> None:
    told = flight().seconds(map(drains(0.005), range(60)))
    assert told.level is FINE
    for _ in range(60):
        told.second()
    assert told.level is FINE and any("silent" in each for each in told.news)
    for _ in range(60):
        told.second()
    assert told.level >= RETURN  # 0.9 - 0.005 * 180 s is nothing
    assert not any("stuck" in each for each in told.news), "it says nothing any more"


def test_what_a_silent_battery_has_left_counts_from_its_last_reading() -> None:
    told, charge = flight(), drains(0.005)
    told.seconds(map(charge, range(60)))
    silent_s = 0
    while told.level < RETURN:
        told.second()
        silent_s += 1
    assert charge(60 + silent_s) == pytest.approx(Battery().return_charge, abs=0.05)


def test_a_silent_battery_returns_where_one_is_required() -> None:
    told = flight(required=True).seconds([0.9] * 20)
    for _ in range(15):
        told.second()
    assert told.level is RETURN and told.news == ["battery silent"]


def test_a_stuck_charge_is_said_and_returns_where_one_is_required() -> None:
    for required, level in ((False, FINE), (True, RETURN)):
        told = flight(required=required).seconds(map(drains(0.008), range(60)))
        assert told.level is FINE and not told.news
        stuck = drains(0.008)(60)
        told.seconds([stuck] * 90)
        assert told.level is level
        assert sum("stuck at 42 %" in each for each in told.news) == 1


def test_a_slow_battery_is_not_stuck() -> None:
    told = flight(required=True).seconds(map(drains(0.0004), range(400)))
    assert told.level is FINE and not told.news


@pytest.mark.parametrize("rate", [0.001, 0.004])
def test_it_returns_in_time_for_the_way_home(rate: float) -> None:
    """Out at 5 m/s, and home at the same speed: what is left at home is what it lands with, or a little more."""
    out, charge = flight(), drains(rate)
    second = 0
    while out.level < RETURN:
        out.landing_s = float(second)
        out.second(b0=charge(second))
        second += 1
    at_home = charge(2 * second)
    assert 0.07 <= at_home < 0.07 + 0.4 * rate * second + 0.02
    assert "needed for the way home" in out.news[-1]


def test_a_reading_that_jumps_is_none_of_the_way_home() -> None:
    told, charges = flight(), [drains(0.004)(second) for second in range(80)]
    told.landing_s = 20.0
    charges[40:42] = [0.1, 0.1]
    assert told.seconds(charges).level is FINE


def test_above_its_landing_place_a_vehicle_returns_in_time_to_stop_and_turn() -> None:
    told, charge, second = flight(warn_charge=0.07, return_charge=0.07), drains(0.008), 0
    while told.level < RETURN:
        told.second(b0=charge(second))
        second += 1
    assert told.level is RETURN and charge(second + 3) > Battery().land_charge


def test_consumption_is_that_of_the_last_minute_where_it_has_risen() -> None:
    """Five minutes of little, then ten times as much: 80 s from home, half of the charge is none too much."""
    told, charge = flight(), 0.95
    for second in range(400):
        charge -= 0.0004 if second < 300 else 0.004
        told.landing_s = 80.0
        told.second(b0=percent(charge))
    assert charge > 0.4 and told.level is RETURN


@pytest.mark.parametrize("sag", [0.05, 0.15])
def test_the_sag_at_the_take_off_is_not_taken_for_consumption(sag: float) -> None:
    told = flight()
    told.landing_s = 60.0
    told.seconds([0.9] + [0.9 - sag] * 60)
    assert told.level is FINE


@pytest.mark.parametrize(("volts", "level"), [(3.6, FINE), (3.45, WARN), (3.35, RETURN), (3.1, LAND)])
def test_voltages_of_cells_have_thresholds_of_their_own(volts: float, level: BatteryLevel) -> None:
    thresholds = {"warn_voltage": 3.5, "return_voltage": 3.4, "land_voltage": 3.2}
    by_cell, by_pack, unset = flight(**thresholds), flight(**thresholds, cells=4), flight()
    for _ in range(5):
        by_cell.second(b0={"charge": 0.9, "cell_volts": volts})
        by_pack.second(system={"charge": 0.9, "volts": 4.0 * volts})
        unset.second(b0={"charge": 0.9, "cell_volts": volts})
    assert (by_cell.level, by_pack.level, unset.level) == (level, level, FINE)


def test_what_the_vehicle_says_of_its_battery_counts() -> None:
    told = flight()
    for _ in range(5):
        verdict = told.second(b0={"charge": 0.9, "level": LAND, "condition": "failed"})
    assert verdict.level is LAND and verdict.text == "battery failed"


def test_a_threshold_of_zero_is_off() -> None:
    off = flight(warn_charge=0.0, return_charge=0.0, land_charge=0.0, way_home_margin=0.0)
    assert off.seconds(map(drains(0.02), range(50))).level is FINE


@pytest.mark.parametrize(
    ("off", "charge", "level"),
    [("warn_charge", 0.2, FINE), ("return_charge", 0.1, WARN), ("land_charge", 0.02, RETURN)],
)
def test_each_threshold_can_be_off_by_itself(off: str, charge: float, level: BatteryLevel) -> None:
    assert flight(**{off: 0.0}).seconds([charge] * 5).level is level


def test_thresholds_that_are_on_rise() -> None:
    for wrong in ({"land_charge": 0.2}, {"return_charge": 0.3}, {"land_charge": 0.3, "return_charge": 0.0}):
        with pytest.raises(ValueError, match=r"must rise"):
            flight(**wrong)


def test_a_reading_at_the_very_first_moment_counts() -> None:
    first = Flight(now=0, flying=False)
    assert first.second(b0=0.9).missing is None and first.level is FINE
