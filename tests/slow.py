"""The tests that take longest, for their order (conftest.py) and for `make quick`, which leaves them out."""

from pathlib import PurePosixPath

SLOW: dict[str, float] = {}
"""Seconds that a test takes on an idle machine, by its id or the beginning of it (a folder, a file, a test without its
parameters); the longest that fits counts. Whole processes and browsers are here even where they are quick."""


def seconds(nodeid: str) -> float:
    """What is known of a test; 0 for those that are not slow."""
    names = [nodeid, nodeid.partition("[")[0]]
    file, _, _ = nodeid.partition("::")
    names += [file, *(str(folder) for folder in PurePosixPath(file).parents)]
    return next((SLOW[name] for name in names if name in SLOW), 0.0)
