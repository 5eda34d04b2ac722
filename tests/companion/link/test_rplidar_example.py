"""The example of a scanner's driver, run as its page says, with a scanner that is none."""

import os
import subprocess
import sys
from pathlib import Path

from protocol.framing import Framer
from protocol.messages import decode, dialect
from protocol.transport import Udp

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "rplidar_driver.py"
SCANNER = """
class RPLidar:
    def __init__(self, port):
        assert port == "/dev/ttyUSB0"

    def iter_measures(self):
        yield True, 15, 0.4, 2000.0
        yield False, 15, 92.0, 3500.0
        yield False, 15, 90.0, 4000.0
        yield False, 0, 180.0, 0.0
        yield False, 15, 359.0, 2500.0
        yield True, 15, 0.4, 2000.0

    def iter_scans(self):
        turn = []
        for begins, quality, angle, distance in self.iter_measures():
            if begins and turn:
                yield turn
                turn = []
            if distance > 0:
                turn.append((quality, angle, distance))
"""
"""As of rplidar-roboticia 0.9.5: measurements have the distance 0 where nothing came back, scans leave them out."""


def test_it_sends_a_ring_for_each_turn(tmp_path: Path) -> None:
    (tmp_path / "rplidar.py").write_text(SCANNER)
    link = Udp("127.0.0.1", 0, bind=True)
    command = [sys.executable, str(EXAMPLE), "/dev/ttyUSB0", f"127.0.0.1:{link.port}"]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(tmp_path)}, timeout=60)
    data = link.receive(5.0)
    assert data is not None
    (frame,) = Framer().datagram(data)
    ring = decode(frame)
    link.close()
    assert ring is not None and frame.message_id == dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE and ring.increment_f == 5.0
    measured = {k: cm for k, cm in enumerate(ring.distances) if cm != 65535}
    assert measured == {0: 200, 18: 350, 36: 1201}
