"""Rings of an ArduPilot, which is silent where nothing is, and of sensors that are not the autopilot's."""

import numpy as np
import pytest

from companion.link.rings import ArrivalClock
from companion.link.vehicle_link import VehicleLink
from companion.reports import Report
from companion.state import Announcement, Output, Scan
from protocol.messages import dialect
from tests.companion.link.sender import (
    ARDUPILOT,
    MS,
    NOW,
    OWN_COMPONENT,
    PX4,
    SECOND,
    SETTINGS,
    Sender,
    found,
    hear,
    sent,
)

PROXIMITY = dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY
OTHERS = 0x3FFFFFFF & ~PROXIMITY
RING, SECTOR, STATUS = (
    dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE,
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR,
    dialect.MAVLINK_MSG_ID_SYS_STATUS,
)


def status(vehicle: Sender, present: int = PROXIMITY, enabled: int = PROXIMITY, health: int = PROXIMITY) -> bytes:
    return vehicle(dialect.MAVLink_sys_status_message, present, enabled, health, *[0] * 10)


def scans(link: VehicleLink, data: bytes, now: int = NOW) -> list[Scan]:
    return [report for report in hear(link, data, now) if isinstance(report, Scan)]


def sensed(link: VehicleLink, data: bytes, now: int = NOW) -> list[Report | Announcement]:
    """What comes of bytes on a sensor's own link."""
    return link.receive(data, now, whole=False, sensor=True)


# -- silence -----------------------------------------------------------------------------------------------------------


def test_the_silence_of_a_healthy_sensor_of_an_ardupilot_is_a_free_ring() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    hear(link, vehicle.quaternion(5000))
    (scan,) = scans(link, status(vehicle))
    assert scan.known.all() and not scan.hit.any() and scan.boot_time_us == 5_000_000
    (later,) = scans(link, status(vehicle) + vehicle.quaternion(5050), NOW + 50 * MS)
    assert later.time_ns == NOW + 50 * MS


@pytest.mark.parametrize(
    "bits",
    [(0, PROXIMITY, PROXIMITY), (PROXIMITY, 0, PROXIMITY), (PROXIMITY, PROXIMITY, 0), (OTHERS, OTHERS, OTHERS)],
)
def test_a_sensor_that_is_not_there_or_off_or_ill_says_nothing_by_silence(bits: tuple[int, int, int]) -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    assert scans(link, status(vehicle, *bits)) == []


def test_of_another_make_silence_means_nothing() -> None:
    link, vehicle = found(autopilot=PX4)
    assert scans(link, status(vehicle)) == []


def test_no_ring_is_free_while_sectors_come_or_whole_rings_have_come() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    for number in range(20):
        now = NOW + number * 67 * MS
        hear(link, vehicle.sector(number, 0), now)
        assert scans(link, status(vehicle), now + 30 * MS) == []
    assert len(scans(link, status(vehicle), now + 150 * MS)) == 1
    hear(link, vehicle.scan(9000))
    assert scans(link, status(vehicle), now + SECOND) == []


def test_free_rings_satisfy_the_rate_of_rings() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    for number in range(15):
        hear(link, status(vehicle), NOW + number * 60 * MS)
    link.beat(NOW + 900 * MS, asks_rates=True)
    assert RING not in asked(link)


def asked(link: VehicleLink) -> list[int]:
    """The messages whose intervals are asked for now."""
    command = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    return [round(m.param1) for m in sent(link) if m.get_type() == "COMMAND_LONG" and m.command == command]


def test_of_an_ardupilot_sectors_and_health_are_asked_for_from_the_start_and_what_it_denies_once() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    link.beat(NOW, asks_rates=False)
    sent(link)
    link.request_rates()
    first = asked(link)
    assert {RING, SECTOR, STATUS} <= set(first)
    for message_id in first:
        result = dialect.MAV_RESULT_DENIED if message_id == RING else dialect.MAV_RESULT_ACCEPTED
        hear(link, vehicle.ack(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, result, 1, OWN_COMPONENT))
    for second in range(1, 4):
        link.beat(NOW + second * SECOND, asks_rates=True)
        again = asked(link)
        assert RING not in again and {SECTOR, STATUS} <= set(again)
    hear(link, vehicle.quaternion(90_000) + vehicle.quaternion(10))  # it reboots, and may be another version now
    link.beat(NOW + 4 * SECOND, asks_rates=True)
    assert RING in asked(link)


def test_an_empty_sector_of_an_ardupilot_is_its_farthest_distance() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    (scan,) = scans(link, b"".join(vehicle.sector(1, k, 1500 if k % 2 else 1499) for k in range(8)))
    assert scan.hit.tolist() == [True, False] * 4 and scan.known.all()


# -- sensors of others -------------------------------------------------------------------------------------------------


def test_a_ring_of_any_component_of_the_vehicles_system_counts() -> None:
    link, _ = found()
    sensor = Sender(1, 196)
    (scan,) = scans(link, sensor.scan(70, 300))
    assert scan.hit.all() and np.allclose(scan.ranges_m, 3.0)
    (sectors,) = scans(found()[0], b"".join(sensor.sector(70, k) for k in range(8)))
    assert sectors.known.all()
    assert scans(link, Sender(2, 196).scan(71)) == [], "of another system"
    assert scans(link, sensor.quaternion(72) + sensor.heartbeat()) == [], "nothing else of it counts"


def test_a_better_source_is_kept_when_it_falls_silent() -> None:
    """What stands behind is never looked at for a moment: the flight holds and lands as without a sensor."""
    link, vehicle = found()
    sensor, own = Sender(1, 196), Sender(1, 195)
    assert len(scans(link, vehicle.scan(1))) == 1
    assert len(scans(link, sensor.scan(1))) == 1
    assert scans(link, vehicle.scan(2), NOW + 10 * SECOND) == []
    assert [type(each) for each in sensed(link, own.scan(1), NOW + 11 * SECOND)] == [Scan]
    assert scans(link, sensor.scan(2) + vehicle.scan(3), NOW + 12 * SECOND) == []
    assert [type(each) for each in sensed(link, own.scan(2), NOW + 13 * SECOND)] == [Scan]


def test_a_sector_of_a_component_takes_no_whole_ring_away() -> None:
    link, vehicle = found()
    sensor = Sender(1, 196)
    assert len(scans(link, vehicle.scan(1))) == 1
    assert scans(link, sensor.sector(1, 0)) == []
    assert len(scans(link, vehicle.scan(2), NOW + 70 * MS)) == 1


def test_a_sector_that_was_not_measured_takes_nothing_away() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    sensor = Sender(1, 196)
    for turn in range(2):
        hear(link, sensor.sector(100 * turn, 0, quality=1))
        ring = b"".join(vehicle.sector(100 * turn, k) for k in range(8))
        assert len(scans(link, ring, NOW + 100 * turn * MS)) == 1


def test_a_ring_of_an_autopilot_without_a_stamp_is_of_when_it_came() -> None:
    link, vehicle = found()
    stamps = []
    for boot_ms in (5000, 5070):
        now = NOW + (boot_ms - 5000) * MS
        hear(link, vehicle.quaternion(boot_ms), now)
        stamps += [scan.boot_time_us for scan in scans(link, vehicle.scan(0), now)]
    assert stamps == [5_000_000, 5_070_000]


def test_bytes_of_a_sensors_own_link_may_come_in_pieces_and_mean_rings_alone() -> None:
    link, vehicle = found()
    sensor = Sender(9, 158)
    data = b"junk" + sensor.heartbeat() + sensor.scan(5, 250) + vehicle.position(4)
    reports = [report for index in range(len(data)) for report in sensed(link, data[index : index + 1])]
    (scan,) = reports
    assert isinstance(scan, Scan) and np.allclose(scan.ranges_m, 2.5)
    assert sensed(VehicleLink(SETTINGS, Output.RATES), sensor.scan(6)) == [], "there is no vehicle yet"


def test_the_same_ring_twice_is_one_but_a_sensor_without_a_clock_is_believed() -> None:
    link, _ = found()
    sensor = Sender(1, 196)
    assert len(scans(link, sensor.scan(70) + sensor.scan(70))) == 1
    assert len(scans(link, sensor.scan(0) + sensor.scan(0))) == 2


def test_a_ring_of_a_sensor_with_its_own_clock_is_as_old_as_its_arrival_tells() -> None:
    """Delays differ; the least one seen is taken for none. The vehicle's clock is 100 s ahead of the companion's."""
    link, vehicle = found()
    link.beat(NOW, asks_rates=False)
    hear(link, vehicle.timesync(NOW + 100 * SECOND + 1 * MS, NOW), NOW + 2 * MS)
    sensor, epoch_ms = Sender(1, 196), 1_700_000_000_000
    ages = []
    for number, delay_ms in enumerate((30, 5, 40, 80, 5, 20)):
        measured = NOW + (1000 + 70 * number) * MS
        data = sensor(
            dialect.MAVLink_obstacle_distance_message,
            (epoch_ms + 70 * number) * 1000, 0, [300] * 72, 5, 20, 1500, 5.0, 0.0, 12,
        )  # fmt: skip
        (scan,) = scans(link, data, measured + delay_ms * MS)
        ages.append(measured + delay_ms * MS + 100 * SECOND - scan.boot_time_us * 1000)
    assert np.array(ages[1:]) / MS == pytest.approx([0, 35, 75, 0, 15], abs=0.2)


def test_a_clock_that_was_set_is_known_anew() -> None:
    clock = ArrivalClock()
    assert clock.measured_ns(5 * SECOND, 100 * SECOND) == 100 * SECOND
    assert clock.measured_ns(6 * SECOND, 101 * SECOND + 20 * MS) == pytest.approx(101 * SECOND, abs=MS)
    assert clock.measured_ns(900 * SECOND, 102 * SECOND) == 102 * SECOND
    assert clock.measured_ns(2 * SECOND, 103 * SECOND) == 103 * SECOND
