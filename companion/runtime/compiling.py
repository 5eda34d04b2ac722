"""The first start on a machine, which compiles the numerical code: on two cores."""

import functools
import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager

from companion.config_avoidance import Avoidance
from companion.runtime.interrupts import end_with_parent, start_uninterrupted
from companion.runtime.planning import rehearse
from protocol.jit import CACHE_FOLDER


@functools.cache
def first_start() -> bool:
    """Whether nothing is compiled yet, though it would be kept."""
    return CACHE_FOLDER is not None and next(CACHE_FOLDER.rglob("*.nbi"), None) is None


@contextmanager
def planner_compiled_beside(settings: Avoidance) -> Iterator[None]:
    """A block during which a process of its own compiles the map and the planner into the cache; it ends with both.

    What that process leaves uncompiled, also if it fails, is compiled where it is called first.
    """
    process = multiprocessing.get_context("spawn").Process(target=_compile, args=(settings,), daemon=True)
    start_uninterrupted(process)
    try:
        yield
        process.join()
    finally:
        process.kill()


def _compile(settings: Avoidance) -> None:
    end_with_parent()
    rehearse(settings)
