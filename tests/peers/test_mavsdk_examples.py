"""The published examples of MAVSDK-Python 3 fly the vehicle, unchanged but for the address. The package comes without
them: COURIER_MAVSDK_EXAMPLES names their folder."""

import os
import shutil
from itertools import islice
from pathlib import Path

import pytest

from tests.flights.shared import alone
from tests.peers.mavsdk_3 import running
from tests.vehicle_sim.served import HOST, PATIENCE_S, served

FLY = (
    "takeoff_and_land",
    "telemetry_takeoff_and_land",
    "do_orbit",
    "mission",
    "offboard_attitude",
    "offboard_position_ned",
    "offboard_position_velocity_ned",
    "offboard_velocity_body",
    "offboard_velocity_ned",
)
"""Those that end by themselves."""
END = ("mission_raw", "mission_import", "geofence", "firmware_version", "all_params", "mavlink_direct_send", "tune")
"""Those that end without a flight."""
STAY = {"goto": ("Staying connected", 20), "manual_control": ("Starting manual control", 1)}
"""Those that go on until they are stopped, what they say last, and how often they are left to say it."""
ADDRESS = "udpin://0.0.0.0:14540"


@pytest.mark.parametrize("pace", [1.0, 5.0])
@pytest.mark.parametrize("name", [*FLY, *END, *STAY])
def test_it_ends_as_it_should(name: str, pace: float, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    published = os.environ.get("COURIER_MAVSDK_EXAMPLES")
    if published is None:
        pytest.skip("COURIER_MAVSDK_EXAMPLES names no folder of MAVSDK 3's examples")
    folder = tmp_path / "examples"
    shutil.copytree(published, folder)
    example = folder / f"{name}.py"
    text = example.read_text()
    assert text.count(ADDRESS) == 1
    with alone(tmp_path_factory, "mavsdk"), served(pace) as vehicle:  # its server has one port
        example.write_text(text.replace(ADDRESS, f"udpout://{HOST}:{vehicle.port}"))
        with running(example) as process:
            if name in STAY:
                text, times = STAY[name]
                assert len(list(islice((line for line in process.stdout or () if text in line), times))) == times
            else:
                said, _ = process.communicate(timeout=PATIENCE_S)
                assert process.returncode == 0, said[-3000:]
        assert (vehicle.flown.time_s > 1.0) is (name not in END)
        assert vehicle.flown.crash is None
