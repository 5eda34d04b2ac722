"""The order of the tests. Slow ones come first, each by itself, so that all workers end together; those that wait in
real time are spread over the run, so that the cores are never idle; the others come a file at a time, so that a file's
fixtures are made once. And what holds for all property tests: the same examples in each run, and no limit on the time
that they take, which says how busy the machine is."""

import gc
from itertools import accumulate

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

from tests.slow import FLOWN, NOT_QUICK, TOGETHER, WAITING, seconds

settings.register_profile("courier", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("courier")

_QUICK_S = 0.04
"""A test that is not listed as slow takes so long."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        flown = FLOWN.intersection(getattr(item, "fixturenames", ()))
        if seconds(item.nodeid) or flown or item.nodeid.startswith(NOT_QUICK):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: -seconds(item.nodeid))
    items[:] = spread(items)


def unit(nodeid: str) -> str:
    """What one worker runs in one go: a slow test by itself, or a file."""
    file = nodeid.split("::")[0]
    return nodeid if seconds(nodeid) and file not in TOGETHER else file


def spread(items: list[pytest.Item]) -> list[pytest.Item]:
    """In their order, but so that those that wait and the others have always spent the same share of their time."""
    took: dict[str, float] = {}
    for item in items:
        name = unit(item.nodeid)
        took[name] = seconds(item.nodeid) or took.get(name, 0.0) + _QUICK_S
    begins: dict[str, float] = {}
    for wait in (True, False):
        names = [name for name in took if name.startswith(WAITING) is wait]
        before = list(accumulate((took[name] for name in names), initial=0.0))
        begins |= {name: at / before[-1] for name, at in zip(names, before, strict=False)}
    return sorted(items, key=lambda item: begins[unit(item.nodeid)])


def pytest_collection_finish(session: pytest.Session) -> None:
    """Thousands of tests are there to stay: no collection of garbage need look at them again."""
    gc.collect()
    gc.freeze()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Or they are left over at the end, which extension modules complain of."""
    gc.unfreeze()


class LongestFirst(LoadScopeScheduling):  # type: ignore[misc]
    """Hands out units of work in the order of the tests."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LongestFirst:
    config.option.loadscopereorder = False
    return LongestFirst(config, log)
