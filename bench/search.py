"""How much sooner a search by CMA-ES finds a failure than random sampling with the same budget.

    python bench/search.py [--searches 30] [--budget 500] [--json]
    python bench/search.py --searches 5 popup-search ...

Without names it searches the flights of studies/drills.py: a vehicle by its own laws in batched physics, milliseconds
each. A name is that of a campaign's file with a [search] table: whole flights of companion and vehicle, on all cores.

A search ends with its first failure or with its budget. All flights of the random searches together say how many fail:
of rarely failing flights, random sampling needs ln 2 / share until half of all searches have found one.
"""

import argparse
import json
import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import msgspec
import numpy as np
from distributed import Client

from protocol.toml_files import find
from studies.campaigns.search import SAMPLERS, Chooser, SearchFile
from studies.campaigns.search import search as campaign_search
from studies.campaigns.statistics import wilson
from studies.drills import DRILLS, Drill
from studies.engine import cluster

Scores = Callable[[str, int], Iterator[float]]
"""From a sampler's name and a search's seed to the scores of its flights, without end; 0 or less is a failure."""


def of_drill(drill: Drill) -> Scores:
    def scores(sampler: str, seed: int) -> Iterator[float]:
        chooser = Chooser(drill.ranges, sampler, seed)
        while True:
            asked = chooser.ask()
            values = {name: np.array([each[name] for each, _ in asked]) for name in drill.ranges}
            found = drill.clearance(values, np.array([seed for _, seed in asked])).tolist()
            chooser.tell(found)
            yield from found

    return scores


def of_campaign(file: SearchFile, client: Client) -> Scores:
    def scores(sampler: str, seed: int) -> Iterator[float]:
        endless = msgspec.structs.replace(file.search, budget=10**7, failures=10**7, seed=seed)
        for tried in campaign_search(SearchFile(endless, file.tables), sampler, client):
            yield tried.score

    return scores


def first_failure(scores: Iterator[float], budget: int) -> int | None:
    """Number of the first flight that fails; None if none of the budget does."""
    return next((number for number, score in zip(range(1, budget + 1), scores, strict=False) if score <= 0.0), None)


def measure(scores: Scores, searches: int, budget: int) -> dict[str, Any]:
    """A row. Random searches fly on after their first failure, for the share."""
    sampled = [[score for score, _ in zip(scores("random", seed), range(budget), strict=False)]
               for seed in range(1, searches + 1)]  # fmt: skip
    random = [first_failure(iter(each), budget) for each in sampled]
    cma = [first_failure(scores("cma", seed), budget) for seed in range(1, searches + 1)]
    flights, failures = searches * budget, sum(score <= 0.0 for each in sampled for score in each)
    median = statistics.median(math.inf if each is None else each for each in cma)
    expected = math.log(2.0) / (failures / flights) if failures else None
    return {
        "random_flights": flights,
        "random_failures": failures,
        "one_in": round(flights / failures) if failures else None,
        "one_in_at_least": round(1.0 / wilson(failures, flights).high),
        "searches": searches,
        "budget": budget,
        "random_found": sum(each is not None for each in random),
        "cma_found": sum(each is not None for each in cma),
        "cma_median": median,
        "cma_most": max(math.inf if each is None else each for each in cma),
        "random_median": None if expected is None else round(expected),
        "sooner": None if expected is None else round(expected / median, 1),
    }


def rows(names: list[str], searches: int, budget: int) -> Iterator[tuple[str, Mapping[str, Any]]]:
    if not names:
        for drill in DRILLS.values():
            yield drill.title, measure(of_drill(drill), searches, budget)
        return
    with ExitStack() as stack:
        client = stack.enter_context(cluster())
        for name in names:
            yield name, measure(of_campaign(SearchFile.load(find("campaigns", name)), client), searches, budget)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="campaigns with a [search] table")
    parser.add_argument("--searches", type=int, default=30, help=f"with each of {', '.join(SAMPLERS)}")
    parser.add_argument("--budget", type=int, default=500, help="flights of a search")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    table = {}
    for name, row in rows(arguments.names, arguments.searches, arguments.budget):
        table[name] = row
        if not arguments.json:
            print(name, *(f"  {key:16} {value}" for key, value in row.items()), sep="\n", flush=True)
    if arguments.json:
        print(json.dumps(table))


if __name__ == "__main__":
    main()
