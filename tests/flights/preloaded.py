"""What a process has that is forked for a test (`warm.py`): the modules of both programs, and their compiled code."""

import vehicle_sim.cli
import vehicle_sim.runner  # noqa: F401
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.rehearsal import rehearse
from companion.state import Output
from protocol.toml_files import find
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import warm_up
from vehicle_sim.world import World

_mission = load_mission("courier")[0]
rehearse(load_settings(None, []), load_body(_mission.vehicle), _mission, Output.RATES)
warm_up(Airframe.load(find("vehicles", _mission.vehicle)), World.load(find("worlds", _mission.world)))
