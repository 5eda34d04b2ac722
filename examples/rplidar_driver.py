"""An RPLIDAR on a serial port as the companion's scanner: `pip install rplidar-roboticia`, then

python examples/rplidar_driver.py /dev/ttyUSB0 127.0.0.1:14600        beside
companion fly MISSION --lidar udpin:127.0.0.1:14600
"""

import os
import sys
import time
from collections.abc import Iterator

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from rplidar import RPLidar  # degrees clockwise from the front, millimetres; 0 where nothing came back

BINS, NEAREST_CM, FARTHEST_CM, NOT_MEASURED = 72, 15, 1200, 65535


def turns(scanner: RPLidar) -> Iterator[list[tuple[float, float]]]:
    """Angles and distances of each turn. `iter_scans` leaves out where nothing came back: nothing would be free."""
    turn: list[tuple[float, float]] = []
    for begins, _, angle, distance in scanner.iter_measures():
        if begins and turn:
            yield turn
            turn = []
        turn.append((angle, distance))


def main(port: str, target: str) -> None:
    """Send one OBSTACLE_DISTANCE for each turn of the scanner."""
    link = mavutil.mavlink_connection(f"udpout:{target}", source_system=1, source_component=196)
    for turn in turns(RPLidar(port)):
        bins = [NOT_MEASURED] * BINS
        for angle, distance in turn:
            k = round(angle / 5.0) % BINS
            cm = max(round(distance / 10.0), NEAREST_CM) if distance else FARTHEST_CM + 1  # one beyond: nothing there
            bins[k] = min(bins[k], min(cm, FARTHEST_CM + 1))  # the nearest of each 5 degrees
        now_us = time.monotonic_ns() // 1000
        link.mav.obstacle_distance_send(now_us, 0, bins, 5, NEAREST_CM, FARTHEST_CM, 5.0, 0.0, 12)


if __name__ == "__main__":
    main(*sys.argv[1:3])
