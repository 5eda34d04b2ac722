"""The order of the tests: slow ones first, each by itself, so that all workers end together; the others a file at a
time, so that a file's fixtures are made once. And what holds for all property tests: the same examples in each run, and
no limit on the time that they take, which says how busy the machine is."""

import gc

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

from tests.slow import FLOWN, NOT_QUICK, TOGETHER, seconds

settings.register_profile("courier", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("courier")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        flown = FLOWN.intersection(getattr(item, "fixturenames", ()))
        if seconds(item.nodeid) or flown or item.nodeid.startswith(NOT_QUICK):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: -seconds(item.nodeid))


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
        file = nodeid.split("::")[0]
        return nodeid if seconds(nodeid) and file not in TOGETHER else file


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LongestFirst:
    config.option.loadscopereorder = False
    return LongestFirst(config, log)
