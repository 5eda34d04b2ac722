"""Whether a contact with something that moved or appeared could have been avoided.

Escapes are tried from each moment (every 0.1 s, at most 4 s before the contact) at which the obstacle was in sight,
that is within the LiDAR's range and not hidden, and the vehicle higher than 0.5 m: it can't get out of the way on the
ground, nor see there, as returns from lower count to the ground. The vehicle continues its motion for the reaction
time: a scan period, the scan's age when it is sent, and the lag of attitude and rotors. Then it may accelerate as hard
as its tilt limit allows, in any of 36 directions and for up to 1.5 s, and brake as hard to a standstill; or brake at
once. If the hull stays free of everything in one of these manoeuvres until a second after the contact, while everything
else moves as it did, the contact was avoidable. The look ahead is perfect: this tests what was possible, not what could
be known.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.timing import TICK_NS
from vehicle_sim.world import Scene, World

DIRECTIONS = 36
BURSTS_S = (0.3, 0.6, 1.0, 1.5)
LOOK_BACK_S = 4.0
AFTER_S = 1.0
_EVERY = 25
"""Ticks between two moments from which an escape is tried."""
_STEP = 5
"""Ticks between two checks of an escape's way."""
_TICK_S = TICK_NS * 1e-9
_IN_THE_WAY_M = 0.05
_ALOFT_M = 0.5


@dataclass(frozen=True, slots=True)
class Abilities:
    """What the vehicle can do, in the horizontal plane."""

    acceleration: float
    """m/s2, in any direction."""
    reaction_s: float
    hull: float
    """m"""

    @classmethod
    def of(cls, airframe: Airframe, tilt: float) -> "Abilities":
        """The abilities of a vehicle with a limit on its tilt (rad)."""
        body, lidar = airframe.body, airframe.lidar
        lag = body.rotor_time_constant_s
        if body.attitude_loop_gain_1_s > 0.0:
            lag += 1.0 / body.attitude_loop_gain_1_s
        reaction = 1.0 / lidar.rate_hz + lidar.latency_s + lag
        return cls(GRAVITY * math.tan(tilt), reaction, airframe.hull.radius_m)


def avoidable(world: World, truth: Array, met: str, abilities: Abilities, range_m: float) -> bool:
    """Whether the contact with the obstacle named `met` could have been avoided, in a `world` as in its file. `truth`
    (n, 17) is the vehicle's state at all ticks from the boot to the contact, `range_m` the LiDAR's range."""
    scene = Scene(world)
    for tick, state in enumerate(truth):
        scene.update(tick * TICK_NS, state[:3].tolist())
    contact = len(truth) - 1
    worlds = _Worlds(scene, contact + round(AFTER_S / _TICK_S))
    first = max(0, contact - round(LOOK_BACK_S / _TICK_S))
    return any(
        truth[tick, 2] <= -_ALOFT_M
        and _in_sight(worlds.at(tick), truth[tick, :3], met, range_m)
        and _escapes(worlds, truth, tick, abilities)
        for tick in range(first, contact, _EVERY)
    )


class _Worlds:
    """Snapshots of a scene, each of which is made once."""

    def __init__(self, scene: Scene, end: int) -> None:
        self.end = end
        self._scene = scene
        self._kept: dict[int, World] = {}

    def at(self, tick: int) -> World:
        if tick not in self._kept:
            self._kept[tick] = self._scene.at(tick * TICK_NS)
        return self._kept[tick]


def _in_sight(world: World, place: Array, met: str, range_m: float) -> bool:
    if met not in world.names[len(world.boxes) :]:
        return False
    north, east, radius = world.cylinders[world.names.index(met) - len(world.boxes), :3]
    way = np.array([north - place[0], east - place[1], 0.0])
    distance = float(np.linalg.norm(way))
    if distance - radius > range_m:
        return False
    return bool(world.range_along(place, way / distance, range_m) >= distance - radius - _IN_THE_WAY_M)


def _escapes(worlds: _Worlds, truth: Array, tick: int, abilities: Abilities) -> bool:
    """Whether one of the manoeuvres that begin at this tick stays free."""
    begin = tick + round(abilities.reaction_s / _TICK_S)
    if begin >= len(truth):
        return False  # the contact comes before the vehicle can react
    position, velocity = truth[begin, :3], truth[begin, 3:5]
    return any(
        _is_free(worlds, begin, position, velocity, push, burst_s, abilities)
        for push, burst_s in _manoeuvres(abilities)
    )


def _manoeuvres(abilities: Abilities) -> Iterator[tuple[Array, float]]:
    """Accelerations (2,) in m/s2 and their durations (s) before braking."""
    yield np.zeros(2), 0.0
    for angle in np.linspace(0.0, 2.0 * math.pi, DIRECTIONS, endpoint=False):
        for burst_s in BURSTS_S:
            yield abilities.acceleration * np.array([math.cos(angle), math.sin(angle)]), burst_s


def _is_free(
    worlds: _Worlds, begin: int, position: Array, velocity: Array, push: Array, burst_s: float, abilities: Abilities
) -> bool:
    place, speed = position.copy(), velocity.copy()
    dt = _STEP * _TICK_S
    for tick in range(begin, worlds.end, _STEP):
        if worlds.at(tick).clearance(place) <= abilities.hull:
            return False
        if (tick - begin) * _TICK_S < burst_s:
            after = speed + dt * push
        else:
            size = float(np.linalg.norm(speed))
            after = speed * max(0.0, 1.0 - dt * abilities.acceleration / size) if size > 0.0 else speed
        place[:2] += 0.5 * dt * (speed + after)
        speed = after
    return True
