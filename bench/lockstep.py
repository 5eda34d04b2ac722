"""How much faster than real time the whole system flies: two processes over UDP in lockstep, 250 Hz control, 1 kHz
physics, full logging, each of the three outputs, by the truth and by sensors with an estimator.

    python bench/lockstep.py [--rounds 3] [--json]
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from typing import Any

CASES = tuple((output, sensors) for output in ("attitude", "rates", "actuators") for sensors in ("perfect", "gnss"))


def fly(output: str, sensors: str, logs: str) -> dict[str, Any]:
    """One demo; its end table."""
    command = [sys.executable, "-m", "companion", "demo", "--no-report", "--output", output, "--log", logs, "--json"]
    command += ["--sensors", sensors]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    table: dict[str, Any] = json.loads(done.stdout)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="flights of each case, taken in turn")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    flights: dict[tuple[str, str], list[dict[str, Any]]] = {case: [] for case in CASES}
    with tempfile.TemporaryDirectory() as logs:
        for _ in range(arguments.rounds):
            for case in CASES:
                flights[case].append(fly(*case, logs))
    result = {
        ", ".join(case): {
            "real_time_factor": statistics.median(flight["real_time_factor"] for flight in flown),
            "best": max(flight["real_time_factor"] for flight in flown),
            "tick_us": round(4000.0 / statistics.median(flight["real_time_factor"] for flight in flown), 1),
            "simulated_s": flown[0]["duration_s"],
            "messages": flown[0]["messages_in"] + flown[0]["messages_out"],
        }
        for case, flown in flights.items()
    }
    if arguments.json:
        print(json.dumps(result))
        return
    print(f"{'output, sensors':20} {'factor':>8} {'best':>8} {'us/tick':>8} {'simulated s':>12} {'messages':>9}")
    for name, row in result.items():
        print(
            f"{name:20} {row['real_time_factor']:8.1f} {row['best']:8.1f} {row['tick_us']:8.1f} "
            f"{row['simulated_s']:12.1f} {row['messages']:9}"
        )


if __name__ == "__main__":
    main()
