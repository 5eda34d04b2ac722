"""`companion view` beside a flight in real time: states of the vehicle that reach the page, and what the flight pays.

    python -m bench.view [--mission circle] [--rounds 2] [--json]

In turn: a demo by the clock alone, and one with the page and somebody who looks at it: a WebSocket as the page's own
script opens it, without a browser, whose drawing would be measured too. A state is a pose of the vehicle in the scene.
What the flight pays is the median time from attitude to command, as a share of the loop's period of 4 ms. For an idle
machine; the load of the machine before the start is printed with it.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from bench.realtime import fly
from companion.runtime.runner import TICK_NS

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 5.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def poses(url: str, times: list[float]) -> None:
    """Look at the page until it ends: the times (s) at which a pose of the vehicle came."""
    host = url.split("/")[2]
    address, name = url.replace("http:", "ws:").rstrip("/"), Subprotocol(f"viser-v{viser.__version__}")
    with connect(address, origin=Origin(f"http://{host}"), subprotocols=[name], compression=None) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        try:
            for frame in socket:
                assert isinstance(frame, bytes)
                packed = int.from_bytes(frame[8:16], "little")
                data = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed])
                if any(
                    message["type"] == "SetPositionMessage" and message["name"] == "/vehicle"
                    for message in msgspec.msgpack.decode(data)["messages"]
                ):
                    times.append(time.monotonic())
        except ConnectionClosed:
            return


def watched(mission: str, folder: Path) -> tuple[dict[str, float], list[float]]:
    """A demo beside the page: its figures, and when poses came."""
    command = [sys.executable, "-m", "companion", "view", "--wait", "--no-open", "--port", "0", "--log", str(folder)]
    times: list[float] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as page:
        assert page.stdout is not None
        url = page.stdout.readline().split()[1]
        looks = threading.Thread(target=poses, args=(url, times), daemon=True)
        looks.start()
        try:
            flown = fly(mission, str(folder))
        finally:
            page.terminate()
        looks.join(10.0)
    return flown, times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mission", default="circle")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    load, alone, beside, gaps = os.getloadavg()[0], [], [], []
    for _ in range(arguments.rounds):
        with tempfile.TemporaryDirectory() as folder:
            alone.append(fly(arguments.mission, folder)["latency_p50_us"])
        with tempfile.TemporaryDirectory() as folder:
            flown, times = watched(arguments.mission, Path(folder))
            beside.append(flown["latency_p50_us"])
            gaps += [after - before for before, after in pairwise(times)]
    costs = statistics.median(beside) - statistics.median(alone)
    figures = {
        "load before": load,
        "states a second": 1.0 / statistics.median(gaps),
        "latency alone, us": statistics.median(alone),
        "latency beside the page, us": statistics.median(beside),
        "share of the loop's period, %": 100.0 * costs * 1e3 / TICK_NS,
    }
    if arguments.json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        print(f"{name:>30} {value:8.1f}")


if __name__ == "__main__":
    main()
