"""Flights with a ring that comes as DISTANCE_SENSOR, an eighth each, as ArduPilot reports it."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.events import Datagram
from companion.link.refusals import RefusedError
from companion.link.wire_ranges import sector_distance
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined, mission_of
from studies.worlds import Site, pole
from tests.flights.short import SMALL_MAP, landing

RING = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
FAR_CM = 1500


def sensor(sector: int, cm: int, number: int = 10, fov: float = 0.0, quality: int = 0) -> tuple[object, ...]:
    """The fields of DISTANCE_SENSOR."""
    return (0, 20, FAR_CM, cm, 0, number + sector, sector, 0, fov, fov, (0.0,) * 4, quality)


class Sectors:
    """A meddler that hands each ring on as eight nearest distances, and nothing else of it."""

    def __init__(self) -> None:
        self._encoder = Encoder(1, 1)
        self.asked = 0

    def __call__(self, time_ns: int, data: bytes) -> bytes:
        parts = []
        for frame in Framer().datagram(data):
            if frame.message_id == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
                continue  # the simulator's own are narrow
            if frame.message_id != RING:
                parts.append(frame.raw)
                continue
            message = decode(frame)
            assert message is not None
            bins = np.roll(np.array(message.distances), 4)  # 9 of 5 degrees around each middle, the first at -20
            for sector in range(8):
                nearest = int(bins[9 * sector : 9 * sector + 9].min())
                fields = list(sensor(sector, nearest))
                fields[0] = message.time_usec // 1000
                parts.append(self._encoder.encode_fields(dialect.MAVLink_distance_sensor_message, *fields))
        return b"".join(parts)


def flown(site: Site, folder: Path, speed: float) -> Joined:
    mission = site.mission(speed, site.save(folder)[0])
    overrides = (SMALL_MAP,)
    return Joined(mission, meddle=Sectors(), overrides=overrides, remembers=False).fly(limit_s=120.0, until=landing)


def test_a_pole_is_flown_around(tmp_path: Path) -> None:
    joined = flown(pole(1), tmp_path, 2.0)
    summary = joined.vehicle.summary()
    assert landing(joined) and summary.contacts == 0 and joined.autopilot.supervisor.fault is None
    assert math.dist(joined.vehicle.motion.position_ned[:2], pole(1).goal) < 0.5
    assert summary.least_clearance_m is not None and summary.least_clearance_m > 0.1


class ArduPilotsSectors(Sectors):
    """The same as ArduPilot does it: nothing while all are empty, and a sector that never saw anything is left out."""

    def __init__(self) -> None:
        super().__init__()
        self._ever: set[int] = set()
        self.silent = self.said = 0

    def __call__(self, time_ns: int, data: bytes) -> bytes:
        parts = []
        for frame in Framer().datagram(super().__call__(time_ns, data)):
            if frame.message_id == dialect.MAVLINK_MSG_ID_SYS_STATUS:
                message = decode(frame)
                assert message is not None
                for name in ("present", "enabled", "health"):
                    bits = getattr(message, f"onboard_control_sensors_{name}")
                    setattr(message, f"onboard_control_sensors_{name}", bits | dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY)
                parts.append(self._encoder.encode(message))
            elif frame.message_id == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
                parts += self._sector(decode(frame))
            else:
                parts.append(frame.raw)
        return b"".join(parts)

    def _sector(self, message: Any) -> list[bytes]:
        if message.orientation == 0:
            self._ring: list[Any] = []
        self._ring.append(message)
        if len(self._ring) < 8:
            return []
        seen = {each.orientation for each in self._ring if each.current_distance < FAR_CM}
        self._ever |= seen
        self.said += bool(seen)
        self.silent += not seen
        for each in self._ring:
            each.current_distance = min(each.current_distance, FAR_CM)
        return [self._encoder.encode(each) for each in self._ring if seen and each.orientation in self._ever]


def test_out_of_open_country_past_a_pole_and_into_it_again(tmp_path: Path) -> None:
    """No hold where nothing is to be seen: not before the take-off, not behind the last obstacle."""
    site = pole(1)
    meddle = ArduPilotsSectors()
    overrides = (SMALL_MAP,)
    mission = site.mission(2.0, site.save(tmp_path)[0])
    joined = Joined(mission, meddle=meddle, overrides=overrides, remembers=False)
    joined.fly(limit_s=5.0, until=lambda each: each.autopilot.link.firmware is not None)
    joined.autopilot.link.telemetry.rings.silent_when_free = True
    joined.fly(limit_s=120.0, until=landing)
    summary = joined.vehicle.summary()
    assert landing(joined) and summary.contacts == 0 and joined.autopilot.supervisor.fault is None
    assert math.dist(joined.vehicle.motion.position_ned[:2], site.goal) < 0.5
    assert meddle.silent > 20 and meddle.said > 20, "both were flown through"
    assert not any("holding" in text or "no ring" in text for text in joined.said)


@pytest.mark.parametrize(("frame", "cm", "kept"), [(0, 300, True), (12, 65535, True), (12, 300, False)])
def test_sectors_count_until_a_whole_ring_says_something(frame: int, cm: int, kept: bool) -> None:
    """One that is refused, or blind, takes nothing away."""
    autopilot = Joined(mission_of("hover")).autopilot
    encoder = Encoder(1, 1)
    heartbeat = encoder.encode_fields(dialect.MAVLink_heartbeat_message, 2, dialect.MAV_AUTOPILOT_PX4, 81, 0, 4, 3)
    ring = encoder.encode_fields(
        dialect.MAVLink_obstacle_distance_message, 1, 0, [cm] * 72, 5, 20, FAR_CM, 5.0, 0.0, frame
    )
    autopilot.handle(Datagram(1, heartbeat + ring))
    assert (autopilot.sensing.scan_age(1) == math.inf) is kept
    for sector in range(8):
        fields = (40, *sensor(sector, 500)[1:])
        autopilot.handle(Datagram(2, encoder.encode_fields(dialect.MAVLink_distance_sensor_message, *fields)))
    assert autopilot.sensing.scan_age(4) == pytest.approx(2e-9 if kept else 3e-9)


def message_of(fields: tuple[object, ...]) -> object:
    (frame,) = Framer().datagram(Encoder(1, 1).encode_fields(dialect.MAVLink_distance_sensor_message, *fields))
    return decode(frame)


def test_which_sensors_cover_a_sector() -> None:
    report = sector_distance(message_of(sensor(2, 300)))
    assert report is not None and (report.sector, report.range_m, report.hit, report.known) == (2, 3.0, True, True)
    nothing = sector_distance(message_of(sensor(0, FAR_CM + 1)))
    assert nothing is not None and not nothing.hit and nothing.range_m == 15.0
    wide = sector_distance(message_of(sensor(0, 300, number=0, fov=0.8, quality=1)))
    assert wide is not None and not wide.known
    assert sector_distance(message_of(sensor(0, 300, number=0))) is None, "a narrow beam"
    assert sector_distance(message_of(sensor(0, 300, number=10, fov=0.05))) is None
    for up_or_down in (24, 25):
        assert sector_distance(message_of(sensor(up_or_down, 300))) is None
    with pytest.raises(RefusedError, match="from 20 to 10"):
        sector_distance(message_of((0, 20, 10, 15, 0, 10, 0, 0, 0.0, 0.0, (0.0,) * 4, 0)))
