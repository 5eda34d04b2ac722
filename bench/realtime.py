"""Missed deadlines and latency in real time, beside a bare loop that does nothing but wait for the same ticks.

    python bench/realtime.py [--rounds 3] [--mission courier] [--json]

In turn: a demo by the clock, then the bare loop for as long, under the same real-time priority and with the same sleep
and spin. A tick is missed if it begins more than half a period (2 ms) late: what the bare loop misses too is the
machine's. For an idle machine.
"""

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from typing import Any

from companion.runtime.runner import LATE_NS, SPIN_S, TICK_NS


def fly(mission: str, logs: str) -> dict[str, Any]:
    """One demo; its end table."""
    command = [
        sys.executable,
        "-m",
        "companion",
        "demo",
        mission,
        "--sensors",
        "perfect",
        "--no-report",
        "--pace",
        "realtime",
        "--log",
        logs,
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    table: dict[str, Any] = json.loads(done.stdout)
    return table


def bare(seconds: float) -> int:
    """Ticks that a loop without work misses."""
    reader, writer = os.pipe()
    missed = 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except OSError:
        print("no real-time priority for the bare loop", file=sys.stderr)
    try:
        now = time.monotonic_ns()
        due, end = now + TICK_NS, now + round(seconds * 1e9)
        while now < end:
            select.select([reader], [], [], max((due - now) * 1e-9 - SPIN_S, 0.0))
            while (now := time.monotonic_ns()) < due:
                pass
            missed += now - due > LATE_NS
            due += TICK_NS * (1 + (now - due) // TICK_NS)
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.close(reader)
        os.close(writer)
    return missed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--mission", default="courier")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as logs:
        for _ in range(arguments.rounds):
            flown = fly(arguments.mission, logs)
            seconds = flown["duration_s"]
            rows.append(
                {
                    "seconds": seconds,
                    "missed": flown["missed_deadlines"],
                    "bare_missed": bare(seconds),
                    "latency_p50_us": flown["latency_p50_us"],
                    "latency_p99_us": flown["latency_p99_us"],
                }
            )
    if arguments.json:
        print(json.dumps(rows))
        return
    print(f"{'s':>7} {'missed':>7} {'bare loop':>10} {'p50 us':>8} {'p99 us':>8}")
    for row in rows:
        print(
            f"{row['seconds']:7.1f} {row['missed']:7} {row['bare_missed']:10} "
            f"{row['latency_p50_us']:8.1f} {row['latency_p99_us']:8.1f}"
        )


if __name__ == "__main__":
    main()
