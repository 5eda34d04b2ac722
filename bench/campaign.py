"""Flights a core-hour of a campaign: the forest (a trunk in 25 m2) at 5 m/s, whole companion and whole vehicle with all
bytes of MAVLink between them, and what the engine adds.

    pip install rotorpy==3.0.0                        # for RotorPy's figure
    git worktree add build/before 0714a47             # another version, flown in turn with this one
    python bench/campaign.py [--beside build/before] [--seeds 12] [--json]

Time is that of the processor, so others on the machine change little; each version is a process of its own, and all fly
a seed before any flies the next. The first flight of each is not counted. RotorPy flies a course of the same length and
speed without obstacles, LiDAR, avoidance and messages, by its SE3 controller, 250 steps a second, for as long as the
flights last in the mean.

The engine: the same seeds by one worker and by two. Its overhead is the campaign's time without the flights' own, over
the latter; its efficiency is how much sooner two workers end, over two. Both need a machine that does nothing else.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # another version has no dask
    from distributed import Client

SPEED, LENGTH, HEIGHT, METHOD = 5.0, 40.0, 3.0, "astar"
ACCELERATION = 4.0
"""m/s2, of RotorPy's course."""
ROOT = Path(__file__).resolve().parent.parent


def child() -> None:
    """Fly each seed that comes as a line; a line of JSON for each. Only what 0714a47 has, too, is used."""
    from studies import campaign, worlds

    setup = campaign.Setup("forest", "forest", worlds.forest, (SPEED,))
    with TemporaryDirectory() as folder:
        for line in sys.stdin:
            began = time.process_time()
            row = campaign.fly(campaign.Job(setup, METHOD, SPEED, int(line), Path(folder)))
            result = {"cpu_s": time.process_time() - began, "simulated_s": row.simulated_s, "outcome": row.outcome}
            print(json.dumps(result), flush=True)


class Version:
    """The project of a folder, as a process that flies."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        command = [sys.executable, str(Path(__file__).resolve()), "--child"]
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self.flown: list[dict[str, Any]] = []

    def fly(self, seed: int) -> dict[str, Any]:
        assert self._process.stdin is not None and self._process.stdout is not None
        print(seed, file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("a version does not fly: see above")
        result: dict[str, Any] = json.loads(line)
        return result

    def close(self) -> None:
        self._process.communicate()

    @property
    def row(self) -> dict[str, Any]:
        seconds = [each["cpu_s"] for each in self.flown]
        return {
            "flights_a_core_hour": round(3600.0 / statistics.fmean(seconds)),
            "cpu_s_a_flight": round(statistics.fmean(seconds), 3),
            "times_real_time": round(sum(each["simulated_s"] for each in self.flown) / sum(seconds), 1),
            "reached": sum(each["outcome"] == "reached" for each in self.flown),
        }


@contextmanager
def version(folder: Path) -> Iterator[Version]:
    flying = Version(folder)
    try:
        yield flying
    finally:
        flying.close()


class Course:
    """A climb, and a straight way with ramps at its ends, as RotorPy's trajectories are asked."""

    def update(self, time_s: float) -> dict[str, Any]:
        import numpy as np

        height = min(HEIGHT, 1.5 * time_s)
        along, speed, push = self._along(time_s - HEIGHT / 1.5)
        zero = np.zeros(3)
        return {
            "x": np.array([along, 0.0, height]), "x_dot": np.array([speed, 0.0, 0.0]),
            "x_ddot": np.array([push, 0.0, 0.0]), "x_dddot": zero, "x_ddddot": zero,
            "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0,
        }  # fmt: skip

    @staticmethod
    def _along(time_s: float) -> tuple[float, float, float]:
        """m, m/s, m/s2."""
        ramp = SPEED / ACCELERATION
        whole = LENGTH / SPEED + ramp
        since, left = max(time_s, 0.0), whole - time_s
        if since <= ramp:
            return 0.5 * ACCELERATION * since**2, ACCELERATION * since, ACCELERATION if since > 0.0 else 0.0
        if left <= ramp:
            left = max(left, 0.0)
            return LENGTH - 0.5 * ACCELERATION * left**2, ACCELERATION * left, -ACCELERATION if left > 0.0 else 0.0
        return SPEED * (since - 0.5 * ramp), SPEED, 0.0


def rotorpy(seconds: float, rounds: int) -> dict[str, Any] | None:
    """None if it is not installed."""
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.environments import Environment
        from rotorpy.vehicles.hummingbird_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor
        from rotorpy.world import World
    except (ImportError, NameError):
        return None
    spent, away = [], math.inf
    for _ in range(rounds + 1):
        space = World.empty((-50.0, 50.0, -50.0, 50.0, -50.0, 50.0))
        flight = Environment(Multirotor(quad_params), SE3Control(quad_params), Course(), world=space, sim_rate=250)
        flight.vehicle.initial_state["x"][:] = 0.0
        began = time.process_time()
        result = flight.run(t_final=seconds, terminate=False)
        spent.append(time.process_time() - began)
        away = abs(float(result["state"]["x"][-1][0]) - LENGTH)
    mean = statistics.fmean(spent[1:])
    return {
        "flights_a_core_hour": round(3600.0 / mean),
        "cpu_s_a_flight": round(mean, 3),
        "times_real_time": round(seconds / mean, 1),
        "from_the_goal_m": round(away, 2),
    }


def campaign_of(client: "Client", place: Path, seeds: int) -> tuple[float, float, float]:
    """Seconds: of the flights by themselves, of the campaign, and of this process (client and scheduler)."""
    from studies import campaign, worlds
    from studies.campaigns.runner import Campaign

    setup = campaign.Setup("forest", "forest", worlds.forest, (SPEED,))
    jobs = [campaign.Job(setup, METHOD, SPEED, seed, place) for seed in range(1, seeds + 1)]
    began, cpu = time.perf_counter(), time.process_time()
    flights = sum((row.wall_s for row in Campaign(jobs, place).fly(client)), 0.0)
    return flights, time.perf_counter() - began, time.process_time() - cpu


def engine(seeds: int) -> dict[str, Any]:
    """The campaign by one worker and by two, each warmed up by a flight a worker."""
    from studies.engine import cluster

    found = {}
    for workers in (1, 2):
        with TemporaryDirectory() as folder, cluster(workers=workers) as client:
            campaign_of(client, Path(folder) / "warm", workers)
            found[workers] = campaign_of(client, Path(folder) / "flown", seeds)
    (flights, alone, cpu), (_, by_two, _) = found[1], found[2]
    return {
        "one_worker_s": round(alone, 2),
        "two_workers_s": round(by_two, 2),
        "overhead_percent": round(100.0 * (alone / flights - 1.0), 2),
        "client_and_scheduler_cpu_percent": round(100.0 * cpu / flights, 2),
        "efficiency_of_two": round(alone / by_two / 2.0, 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beside", type=Path, action="append", default=[], help="a folder with another version")
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--no-engine", action="store_true", help="only the flights")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child()
        return
    folders = [ROOT, *(each.resolve() for each in arguments.beside)]
    with ExitStack() as stack:
        versions = [stack.enter_context(version(folder)) for folder in folders]
        for each in versions:
            each.fly(1)
        for seed in range(1, arguments.seeds + 1):
            for each in versions:
                each.flown.append(each.fly(seed))
        result: dict[str, Any] = {"this": versions[0].row}
        result |= {str(path): each.row for path, each in zip(arguments.beside, versions[1:], strict=True)}
    mean_s = statistics.fmean(each["simulated_s"] for each in versions[0].flown)
    result["rotorpy"] = rotorpy(mean_s, 3)
    if not arguments.no_engine:
        result["engine"] = engine(arguments.seeds)
    print(json.dumps(result, indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
