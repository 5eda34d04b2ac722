"""Vehicles beside each other in real time: does each send its position 100 times a second, and in time?

    python bench/instances.py [--count 8] [--seconds 30] [--json]

Each is a `vehicle-sim --instance N`, a process of its own, and is asked for LOCAL_POSITION_NED every 10 ms. By the
message's own stamp no gap may be longer than three ticks (12 ms). A message is late by how much later than the
promptest one it reached the socket, as the kernel stamped it; more than 10 ms is a missed deadline. What a bare loop
misses meanwhile, which only waits for every 10th millisecond, is the machine's. For an idle machine; on a busy one,
`chrt --fifo 5 python bench/instances.py` puts all of it before other work.
"""

import argparse
import json
import multiprocessing
import os
import selectors
import socket
import struct
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect

PERIOD_S = 0.01
_ASK = dialect.MAVLink_command_long_message(
    0, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 1e6 * PERIOD_S, *[0.0] * 5
)
_STAMPED = getattr(socket, "SO_TIMESTAMPNS", 35)


@dataclass
class Ear:
    """Where one vehicle sends to."""

    number: int
    end: socket.socket
    framer: Framer = field(default_factory=Framer)
    peers: set[tuple[int, int]] = field(default_factory=set)
    """System and port."""
    heard: list[tuple[int, int]] = field(default_factory=list)
    """Arrival (ns) and stamp (ms)."""

    def listen(self) -> None:
        data, extra, _, (_, port) = self.end.recvmsg(65535, 64)
        seconds, nanoseconds = struct.unpack("qq", extra[0][2])
        for frame in self.framer.datagram(data):
            if not self.peers:
                self.end.sendto(Encoder(255, 190).encode(_ASK), ("127.0.0.1", port))
            self.peers.add((frame.system, port))
            if frame.message_id == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                message: Any = decode(frame)
                self.heard.append((seconds * 1_000_000_000 + nanoseconds, message.time_boot_ms))

    def result(self) -> dict[str, Any]:
        behind = [arrival * 1e-6 - stamp for arrival, stamp in self.heard]
        late = sorted(each - min(behind) for each in behind)
        gaps = [b[1] - a[1] for a, b in zip(self.heard, self.heard[1:], strict=False)]
        return {
            "instance": self.number,
            "peers": sorted(self.peers),
            "messages": len(late),
            "largest_gap_ms": max(gaps),
            "late_p50_ms": late[len(late) // 2],
            "late_p99_ms": late[len(late) * 99 // 100],
            "late_max_ms": late[-1],
            "missed": sum(each > 1e3 * PERIOD_S for each in late),
        }


def bare(seconds: float) -> int:
    """Deadlines that a loop without work misses by more than a period."""
    missed, due = 0, time.monotonic()
    end = due + seconds
    while due < end:
        due += PERIOD_S
        time.sleep(max(due - time.monotonic(), 0.0))
        missed += time.monotonic() - due > PERIOD_S
    return missed


def measure(count: int, seconds: float) -> dict[str, Any]:
    vehicles, ears, choice = [], [], selectors.DefaultSelector()
    try:
        for number in range(count):
            end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            end.setsockopt(socket.SOL_SOCKET, _STAMPED, 1)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
            end.bind(("127.0.0.1", 14540 + number))
            ears.append(Ear(number, end))
            choice.register(end, selectors.EVENT_READ, ears[-1])
            command = [sys.executable, "-m", "vehicle_sim", "--world", "empty", "--instance", str(number)]
            vehicles.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
        _listen(choice, lambda: all(len(ear.heard) > 1 / PERIOD_S for ear in ears))
        for ear in ears:
            ear.heard.clear()
        cpu, load = _cpu(vehicles), os.getloadavg()[0]
        with multiprocessing.Pool(1) as pool:
            waiting = pool.apply_async(bare, (seconds,))
            _listen(choice, waiting.ready)
            missed = waiting.get()
        return {
            "count": count,
            "seconds": seconds,
            "cores": os.cpu_count(),
            "load_before": load,
            "load_after": os.getloadavg()[0],
            "cpu_share_each": (_cpu(vehicles) - cpu) / seconds / count,
            "bare_loop_missed": missed,
            "vehicles": [ear.result() for ear in ears],
        }
    finally:
        for vehicle in vehicles:
            vehicle.terminate()
        for vehicle in vehicles:
            vehicle.wait()
        for ear in ears:
            ear.end.close()


def _listen(choice: selectors.BaseSelector, until: Any) -> None:
    while not until():
        for key, _ in choice.select(0.1):
            key.data.listen()


def _cpu(processes: "list[subprocess.Popen[bytes]]") -> float:
    """Seconds that they have computed."""
    ticks = 0
    for process in processes:
        ticks += sum(map(int, Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    found = measure(arguments.count, arguments.seconds)
    if arguments.json:
        print(json.dumps(found))
        return
    print(f"{'':>4} {'system, port':>16} {'messages':>9} {'gap ms':>7} {'late p50':>9} {'p99':>6} {'max ms':>7} missed")
    for row in found["vehicles"]:
        who = " ".join(f"{system}, {port}" for system, port in row["peers"])
        print(
            f"{row['instance']:4} {who:>16} {row['messages']:9} {row['largest_gap_ms']:7} {row['late_p50_ms']:9.2f} "
            f"{row['late_p99_ms']:6.2f} {row['late_max_ms']:7.2f} {row['missed']:6}"
        )
    print(
        f"a bare loop missed {found['bare_loop_missed']} of {round(found['seconds'] / PERIOD_S)}; each vehicle takes "
        f"{100 * found['cpu_share_each']:.0f} % of a core; load {found['load_before']:.1f} to "
        f"{found['load_after']:.1f} on {found['cores']} cores"
    )


if __name__ == "__main__":
    main()
