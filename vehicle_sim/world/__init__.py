"""The world that is flown in: obstacles and hills on flat ground, and the wind."""

from vehicle_sim.world.scene import Scene
from vehicle_sim.world.tables import BoxTable, CylinderTable, HillTable, OriginTable, WallTable, WorldTable
from vehicle_sim.world.world import World

__all__ = ["BoxTable", "CylinderTable", "HillTable", "OriginTable", "Scene", "WallTable", "World", "WorldTable"]
