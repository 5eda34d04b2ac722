"""What a mission's flat scan does not show, told before the flight: by the plan, the settings and the file of a
simulated world."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from companion.config_avoidance import Avoidance
from companion.mission.plan import Mission, Phase, Step
from companion.view.lines import Floats
from companion.view.scene import ROOM, Prism, between, solids
from protocol.vehicle_parameters import GRAVITY, VehicleParameters

_SECTOR = math.radians(5.0)
"""Width of a sector, as most drivers of LiDARs send them."""
_LEVEL_M = 0.1
"""m of height that a level leg changes by, at most."""
_ALONG_M = 5.0
"""m that a leg leads along the ground, at least, to be flown at its speed."""
_COMES_M_S = 4.0
"""Speed of a mover that comes ahead on."""
_THINNEST_LAYER_M = 0.5
"""m; a thinner layer of the map is of no use: the scan leaves it with any lean."""
_EVADED_IN_S = 0.7
"""s before it would be met, from which on it must be seen: of 100 none was met after 0.76 s, of six two after 0.56."""


def unseen(
    mission: Mission, plan: Sequence[Step], world: bytes, avoidance: Avoidance, body: VehicleParameters
) -> list[str]:
    """In words, of a plan from a start at (0, 0, 0); `world` is its file, or empty."""
    speed = max(step.speed or mission.speed for step in plan)
    found = [_poles(speed, avoidance)]
    for number, step in enumerate(plan, 1):
        if step.phase is Phase.DESCEND:
            found.append(f"what stands below it (step {number}), which a range finder that looks down does")
        elif step.phase is Phase.LAND:
            found.append(f"what stands where it lands (step {number})")
    prisms = solids(world)
    for number, start, end in _legs(plan):
        found += [f"{each} (step {number})" for each in _missed(prisms, start, end)]
    for each, numbers in _late(mission, plan, prisms, avoidance, body).items():
        found.append(f"in time, {each} (step {', '.join(map(str, numbers))})")
    return list(dict.fromkeys(found))


def seen_too_late(
    mission: Mission, plan: Sequence[Step], world: bytes, avoidance: Avoidance, body: VehicleParameters
) -> list[str]:
    """In words, what the scan shows too late for the speeds of a plan from a start at (0, 0, 0)."""
    return list(_late(mission, plan, solids(world), avoidance, body))


def _late(
    mission: Mission, plan: Sequence[Step], prisms: Sequence[Prism], avoidance: Avoidance, body: VehicleParameters
) -> dict[str, list[int]]:
    """What the scan shows too late, and the numbers of the steps on which it does."""
    found: dict[str, list[int]] = {}
    for number, start, end in _legs(plan):
        if math.dist(start[:2], end[:2]) > _ALONG_M:
            speed = plan[number - 1].speed or mission.speed
            above = -float(max(start[2], end[2])) - avoidance.ground_height
            near = [each for each in prisms if between([each], start, end, ROOM)]
            for each in (*_comes(speed, above, body), *_hangs(near, -float(start[2]), speed, avoidance, body)):
                found.setdefault(each, []).append(number)
    return found


def thinnest(speed: float, avoidance: Avoidance) -> float:
    """Width (m) of the thinnest pole that one beam in each sector meets while the vehicle can still stop before it."""
    return _stops_m(speed, avoidance) * _SECTOR


def _stops_m(speed: float, avoidance: Avoidance) -> float:
    guard = avoidance.guard
    return speed**2 / (2.0 * guard.braking) + speed * guard.reaction_time + avoidance.vehicle_radius


def sight_m(speed: float, height: float, body: VehicleParameters) -> float:
    """How far ahead (m) a flat scan has come down by a height (m), as the vehicle leans against its drag at a speed
    (m/s) in still air."""
    slope = body.drag_kg_s[0] * speed / (body.mass_kg * GRAVITY)
    return height / slope if slope > 0.0 else math.inf


def _comes(speed: float, height: float, body: VehicleParameters) -> Iterator[str]:
    """Who comes ahead on, where it is too late for an evasion once it is seen, above the `height` (m) over what counts
    as the ground."""
    sight = sight_m(speed, height, body)
    if 0.0 < sight < (speed + _COMES_M_S) * _EVADED_IN_S:
        lean = math.degrees(math.atan(height / sight))
        yield (
            f"who comes ahead on at {_COMES_M_S:g} m/s: at {speed:g} m/s, in still air, the vehicle leans by "
            f"{lean:.0f} degrees, and its scan meets the ground, or what counts as such, {sight:.0f} m ahead"
        )


def _hangs(
    prisms: Sequence[Prism], height: float, speed: float, avoidance: Avoidance, body: VehicleParameters
) -> Iterator[str]:
    """What of the prisms near a leg at a `height` (m) hangs, where the leaning scan looks beneath it until it is too
    late to stop. What a scan shows beyond the map's layer is not taken for free."""
    for prism in prisms:
        room = height - prism.bottom
        if prism.bottom > 0.0 and 0.0 <= room < avoidance.map.layer and height <= prism.top:
            sight = sight_m(speed, room, body)
            layer = f"the vehicle is as slow as that needs with avoidance.map.layer={0.9 * room:.1f}"
            if sight < _stops_m(speed, avoidance):
                yield (
                    f"{prism.name}, which hangs from {prism.bottom:.1f} m on: at {speed:g} m/s, in still air, the scan "
                    f"looks beneath it until {sight:.1f} m before it; "
                    + (layer if room >= _THINNEST_LAYER_M else "fly at another height")
                )


def _poles(speed: float, avoidance: Avoidance) -> str:
    width = f"{100.0 * thinnest(speed, avoidance):.0f} cm at {speed:g} m/s"
    return (
        f"poles thinner than {width}, in time, by a LiDAR with one beam in 5 degrees; wires, and glass that lets beams "
        "through, at any speed"
    )


def _legs(plan: Sequence[Step]) -> Iterator[tuple[int, Floats, Floats]]:
    """The numbers of the steps that are flown straight and not up, with start and end (3,), m, NED; landings to the
    ground."""
    places: list[tuple[int, Step, Floats]] = []
    for number, step in enumerate(plan, 1):
        if step.target_ned is not None:
            places.append((number, step, step.target_ned))
        elif step.phase is Phase.LAND and places:
            places.append((number, step, places[-1][2] * (1.0, 1.0, 0.0)))
    for (_, _, start), (number, step, end) in pairwise(places):
        if step.curve is None and end[2] > start[2] - _LEVEL_M:
            yield number, start, end


def _missed(prisms: Sequence[Prism], start: Floats, end: Floats) -> Iterator[str]:
    """What is near to a leg, and not at the height from which it is looked at: that of the leg's start."""
    height = -float(start[2])
    for prism in prisms:
        if prism.bottom <= height <= prism.top or not between([prism], start, end, ROOM):
            continue
        if prism.bottom > height:
            yield f"{prism.name}, which hangs {prism.bottom - height:.1f} m above the scan"
        else:
            yield f"{prism.name}, which ends {height - prism.top:.1f} m below the scan"


def words(found: Sequence[str]) -> str:
    """As lines."""
    return "\n".join(["The LiDAR does not show:", *(f"- {each}" for each in found)])
