"""The places that can be made, by name: `python -m studies worlds NAME`."""

from collections.abc import Callable

from studies import askew, crowded, worlds
from studies.worlds import Site

SITES: dict[str, Callable[..., Site]] = {
    "forest": worlds.forest,
    "utrap": worlds.u_trap,
    "court": worlds.court,
    "gap": worlds.gap,
    "pole": worlds.pole,
    "maze": worlds.maze,
    "popup": worlds.pop_up,
    "street": worlds.street,
    "barn": worlds.barn,
    "shaft": worlds.shaft,
    "corridor": worlds.corridor,
    "alley": worlds.alley,
    "office": worlds.office,
    "fig6": worlds.fig6,
    "warehouse": crowded.warehouse,
    "doors": askew.doors,
    "bend": askew.bend,
    "zigzag": askew.zigzag,
    "rooms": askew.rooms,
    "roundroom": askew.round_room,
    "posts": askew.posts,
    "oncoming": crowded.oncoming,
    "crossing": crowded.crossing,
    "overtaking": crowded.overtaking,
    "settingoff": crowded.setting_off,
    "car": crowded.car,
    "several": crowded.several,
    "waiting": crowded.waiting,
}
