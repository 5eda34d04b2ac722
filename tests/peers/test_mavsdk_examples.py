"""The published examples of MAVSDK-Python 3 fly the vehicle, unchanged but for the address, where COURIER_MAVSDK_3
names the Python of an environment with `mavsdk<4`, and COURIER_MAVSDK_EXAMPLES their folder."""

import os
import shutil
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

from tests.flights.shared import alone
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
STAY = {"goto": "Staying connected", "manual_control": "Starting manual control"}
"""Those that go on until they are stopped, and what they say last."""
ADDRESS = "udpin://0.0.0.0:14540"


@pytest.mark.parametrize("name", [*FLY, *END, *STAY])
def test_it_ends_as_it_should(name: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    python, published = os.environ.get("COURIER_MAVSDK_3"), os.environ.get("COURIER_MAVSDK_EXAMPLES")
    if python is None or published is None:
        pytest.skip("COURIER_MAVSDK_3 and COURIER_MAVSDK_EXAMPLES name no MAVSDK 3 with its examples")
    folder = tmp_path / "examples"
    shutil.copytree(published, folder)
    example = folder / f"{name}.py"
    text = example.read_text()
    assert text.count(ADDRESS) == 1
    with alone(tmp_path_factory, "mavsdk"), served(5.0) as vehicle:  # its server has one port
        example.write_text(text.replace(ADDRESS, f"udpout://{HOST}:{vehicle.port}"))
        command = [python, "-u", "-W", "ignore", str(example)]
        out = subprocess.PIPE if name in STAY else subprocess.DEVNULL
        with subprocess.Popen(command, cwd=folder, stdout=out, text=True, start_new_session=True) as process:
            try:
                if process.stdout is None:
                    assert process.wait(PATIENCE_S) == 0
                else:
                    assert any(STAY[name] in line for line in process.stdout)
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)  # its server, too
        assert (vehicle.summary().flight_time_s > 1.0) is (name not in END)
        assert vehicle.flight.crash is None
