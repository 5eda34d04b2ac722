"""Figs. 6-9: the world is what the study says of it, and a flight of each published outcome."""

import math

import numpy as np
import pytest

from companion.runtime.files import load_mission
from protocol import toml_files
from studies import waypoints
from vehicle_sim.world import World


def test_each_obstacle_stands_across_its_leg_five_metres_behind_the_start() -> None:
    mission, _ = load_mission(waypoints.MISSION)
    world = World.load(toml_files.find("worlds", mission.world))
    assert len(world.boxes) == len(mission.waypoints)
    start = np.zeros(3)
    for waypoint in mission.waypoints:
        end = np.array([waypoint.north, waypoint.east, 0.0])
        course = (end - start) / np.linalg.norm(end - start)
        eye = start - [0.0, 0.0, waypoint.height]
        assert world.range_along(eye, course, 18.0) == pytest.approx(5.0)
        assert np.linalg.norm(end - start) == pytest.approx(18.0)
        start = end


def test_a_yaw_weight_of_one_is_too_late() -> None:
    flight = waypoints.fly(2.5, 1.0)
    assert not flight.passed and flight.met is not None and flight.met.startswith("obstacle")
    assert flight.as_published
    assert flight.latest.distance < 4.5 and flight.latest.speed > 2.0
    # the LQR's poles for this weight are at 1 and 48 1/s; the nose is turned before the rule speaks up
    errors = flight.yaw_errors[1]
    assert errors[150] == pytest.approx(errors[0] * math.exp(-0.6), rel=0.15)


def test_a_yaw_weight_of_fifty_passes() -> None:
    flight = waypoints.fly(2.5, 50.0)
    assert flight.passed and flight.met is None and flight.as_published
    assert flight.clearance > 0.3
    assert [sighting.leg for sighting in flight.sightings] == [1, 2, 3, 4]
    assert flight.latest.distance > 4.5 and flight.latest.speed < 2.0
