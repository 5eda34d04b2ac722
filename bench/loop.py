"""What a tick of the companion's loop costs: all stages from the datagram's bytes to the command's, without socket and
log, on the events of whole flights.

    python bench/loop.py [--mission courier] [--json]

The flight is flown first (both sides joined in memory), then its events are handled again by new autopilots and timed.
The memory is what the process holds (resident) after the first and after the last of these.
"""

import argparse
import gc
import json
import resource
import time
from pathlib import Path

import numpy as np

from companion.autopilot import Autopilot
from companion.events import Tick
from companion.runtime.files import load_body, load_settings
from companion.state import Output
from studies.joined import Joined, mission_of

ROUNDS = 5


def resident_kib() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() // 1024


def measure(mission: str, output: Output) -> dict[str, float]:
    """us a tick in flight (its datagrams and the tick itself), and KiB."""
    flown = Joined(mission_of(mission), output)
    flown.fly()
    costs: list[float] = []
    memory: list[int] = []
    for _ in range(ROUNDS):
        autopilot = Autopilot(load_settings(None, []), load_body(flown.mission.vehicle), flown.mission, output)
        gc.collect()
        gc.disable()
        spent, controlled = 0, False
        for event in flown.events:
            began = time.perf_counter_ns()
            reaction = autopilot.handle(event)
            spent += time.perf_counter_ns() - began
            controlled = controlled or reaction.trace is not None
            if isinstance(event, Tick):
                if controlled:
                    costs.append(spent * 1e-3)
                spent, controlled = 0, False
        gc.enable()
        memory.append(resident_kib())
    p50, p99 = np.percentile(costs, [50, 99])
    return {
        "ticks": len(costs),
        "p50_us": round(float(p50), 1),
        "p99_us": round(float(p99), 1),
        "first_kib": memory[0],
        "last_kib": memory[-1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mission", default="courier")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = {output.value: measure(arguments.mission, output) for output in Output}
    if arguments.json:
        print(json.dumps(result))
        return
    print(f"{'output':10} {'ticks':>8} {'p50 us':>8} {'p99 us':>8} {'KiB after one':>14} {f'after {ROUNDS}':>9}")
    for output, row in result.items():
        print(
            f"{output:10} {row['ticks']:8} {row['p50_us']:8} {row['p99_us']:8} "
            f"{row['first_kib']:14} {row['last_kib']:9}"
        )


if __name__ == "__main__":
    main()
