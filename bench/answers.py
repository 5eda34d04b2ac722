"""What the planner's answers cost in flight, place by place: from a scan to the path and the free space, which is
nearly all of the way to the reference.

    python bench/answers.py [--seeds 3] [--rounds 3] [--json] [PLACE ...]

A place is one of the studies' set-ups by its name; without names it is those that are enclosed or narrow. Each is flown
first, both sides joined in memory, with cells of 0.125 m; then its scans are answered again by new planners and timed.
A round takes all places one after the other; of each answer the least of all rounds counts, so that what else the
machine does shows less.
"""

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from companion.avoidance.planner import PlanningPipeline, PlanRequest
from companion.config_avoidance import Avoidance
from companion.runtime.planning import rehearse
from protocol.arrays import Array
from studies import barn, enclosed, forest, moving, narrow, traps
from studies.campaign import Setup
from studies.joined import Joined

SETUPS = {
    setup.name: setup
    for study in (enclosed, narrow, traps, forest, moving, barn)
    for setup in study.SETUPS
    if not setup.vehicle_overrides
}
PLACES = ("shaft", "corridor", "alley", "warehouse", "office", "gap", "maze", "court")
Flown = tuple[Avoidance, list[PlanRequest]]


def requests_of(setup: Setup, seed: int, folder: Path) -> Flown:
    """Settings and requests of a flight."""
    site, speed = setup.site(seed), setup.speeds[-1]
    mission = site.mission(speed, site.save(folder / f"{setup.name}-{seed}", speed)[0])
    joined = Joined(mission, overrides=setup.overrides, seed=seed, remembers=False)
    asked, ask = [], joined.planner.ask

    def kept(request: PlanRequest) -> None:
        asked.append(request)
        ask(request)

    joined.planner.ask = kept  # type: ignore[method-assign]
    joined.fly(setup.limit_s + 60.0)
    return joined.autopilot.settings.avoidance, asked


def answer(settings: Avoidance, requests: list[PlanRequest]) -> Array:
    """(n,) ms that each answer took."""
    pipeline, times = PlanningPipeline(settings), np.empty(len(requests))
    for number, request in enumerate(requests):
        began = time.perf_counter_ns()
        pipeline.answer(request)
        times[number] = 1e-6 * (time.perf_counter_ns() - began)
    return times


def measure(places: list[str], seeds: int, rounds: int) -> dict[str, Array]:
    """ms of each answer, by place."""
    with TemporaryDirectory() as folder:
        flown = {
            place: [requests_of(SETUPS[place], seed, Path(folder)) for seed in range(1, seeds + 1)] for place in places
        }
    rehearse(next(iter(flown.values()))[0][0])
    found: dict[str, Array] = {}
    for _ in range(rounds):
        for place, flights in flown.items():
            times = np.concatenate([answer(*flight) for flight in flights])
            found[place] = np.minimum(found.get(place, times), times)
    return found


def figures(times: Array) -> dict[str, float]:
    p50, p99 = np.percentile(times, (50, 99))
    return {"answers": len(times), "p50_ms": round(p50, 2), "p99_ms": round(p99, 2), "max_ms": round(times.max(), 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description="cost of the planner's answers in flight, milliseconds")
    parser.add_argument("places", nargs="*", metavar="PLACE", help=f"of {', '.join(SETUPS)}")
    parser.add_argument("--seeds", type=int, default=3, help="flights in each place")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true", help="one object instead of the table")
    asked = parser.parse_args()
    if unknown := set(asked.places) - set(SETUPS):
        parser.error(f"no place: {', '.join(sorted(unknown))}")
    times = measure(asked.places or list(PLACES), asked.seeds, asked.rounds)
    rows = {place: figures(each) for place, each in times.items()}
    rows["all"] = figures(np.concatenate(list(times.values())))
    if asked.json:
        print(json.dumps({"bench": "answers", "places": rows}))
        return
    print(f"{'ms':<12}{'answers':>9}{'p50':>8}{'p99':>8}{'max':>8}")
    for place, row in rows.items():
        print(f"{place:<12}{row['answers']:>9}{row['p50_ms']:>8.2f}{row['p99_ms']:>8.2f}{row['max_ms']:>8.2f}")


if __name__ == "__main__":
    main()
