"""An unmodified MAVSDK-Python 3 flies the vehicle, in real time and at five times its speed."""

import socket
from pathlib import Path

import pytest

from tests.peers.mavsdk_3 import running
from tests.vehicle_sim.served import HOST, PATIENCE_S, served

PROGRAM = Path(__file__).with_name("mavsdk_3_user.py")


@pytest.mark.parametrize("pace", [1.0, 5.0])
def test_each_part_of_it_is_served(pace: float, tmp_path: Path) -> None:
    with served(pace) as vehicle, socket.socket() as reserved:
        reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)  # its server sets it, too
        reserved.bind((HOST, 0))
        address, port = f"udpout://{HOST}:{vehicle.port}", str(reserved.getsockname()[1])
        with running(PROGRAM, address, port, str(tmp_path)) as user:
            said, _ = user.communicate(timeout=3 * PATIENCE_S)
        assert user.returncode == 0, said[-3000:]
