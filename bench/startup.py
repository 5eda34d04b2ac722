"""From the start of `companion fly`, with everything compiled, to its first heartbeat, and what memory it holds then.

    python bench/startup.py [--rounds 5] [--mission courier] [--json]

The vehicle's end of the link is a socket that says nothing. Wall and processor time are those of the companion's first
process. Its memory is all of its pages (RSS), and the same with a page that n processes share as 1/n of one (PSS); so
is that of the planner's and the recorder's processes together. A first round, which may compile, is not counted.
"""

import argparse
import contextlib
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from pymavlink.dialects.v20 import common as dialect

from protocol.framing import Framer

LONGEST_S = 900.0
"""With everything to compile on a busy machine."""


def processor_s(pid: int) -> float:
    """User's and system's time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> tuple[float, float]:
    """PSS and RSS of a process."""
    rows = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    kib = {row.split(":")[0]: int(row.split()[1]) for row in rows[1:]}
    return kib["Pss"] / 1024.0, kib["Rss"] / 1024.0


def children(pid: int) -> Iterator[int]:
    for each in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split():
        yield int(each)
        yield from children(int(each))


def start(mission: str, logs: str) -> dict[str, float]:
    """One start."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(LONGEST_S)
        url = f"udpout:127.0.0.1:{end.getsockname()[1]}"
        command = [sys.executable, "-m", "companion", "fly", mission, "--connect", url, "--log", logs]
        began = time.perf_counter()
        flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            framer = Framer()
            while all(
                frame.message_id != dialect.MAVLINK_MSG_ID_HEARTBEAT for frame in framer.datagram(end.recv(65535))
            ):
                pass
            wall, processor = time.perf_counter() - began, processor_s(flying.pid)
            own, others = memory_mb(flying.pid), [memory_mb(pid) for pid in children(flying.pid)]
        finally:
            for pid in [*children(flying.pid), flying.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            flying.wait()
    return {
        "to_heartbeat_s": wall,
        "processor_s": processor,
        "pss_mb": own[0],
        "rss_mb": own[1],
        "others_pss_mb": sum(pss for pss, _ in others),
        "others_rss_mb": sum(rss for _, rss in others),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--mission", default="courier")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with TemporaryDirectory() as logs:
        start(arguments.mission, logs)
        rounds = [start(arguments.mission, logs) for _ in range(arguments.rounds)]
    result = {key: round(statistics.median(each[key] for each in rounds), 2) for key in rounds[0]}
    print(json.dumps(result, indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
