"""What is compiled is compiled before the first tick: a companion gives up on a vehicle that is silent meanwhile."""

import subprocess
import sys

import pytest

_PROGRAM = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from protocol.toml_files import find
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle, warm_up
from vehicle_sim.world import World

airframe = Airframe.load(find("vehicles", "paper_quad"), [f'estimator.sensors="{sys.argv[1]}"'])
world = World.load(find("worlds", "empty"))
warm_up(airframe, world)

def compiled():
    modules = [module for name, module in sys.modules.items() if name.split(".")[0] in ("protocol", "vehicle_sim")]
    found = {f"{each.__module__}.{each.__name__}": len(each.signatures)
             for module in modules for each in vars(module).values() if isinstance(each, Dispatcher)}
    return {name: count for name, count in found.items() if count}

before = compiled()
vehicle = Vehicle(airframe, world, seed=1)
for _ in range(1000):
    vehicle.advance()
assert before
assert compiled() == before, set(compiled().items()) - set(before.items())
"""


@pytest.mark.parametrize("level", ["perfect", "gnss", "vio"])
def test_a_warm_vehicle_compiles_nothing_afterwards(level: str) -> None:
    done = subprocess.run([sys.executable, "-c", _PROGRAM, level], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
