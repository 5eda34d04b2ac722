"""Compilation to machine code (numba), with a cache on disk that can't be stale.

numba's own cache looks at the file of a function alone, not at the files of the functions that it calls. Here the
cache's folder is named after the text of every module that holds compiled functions, so that an edit anywhere
recompiles everything and nothing old is ever run.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

ROOT = Path(__file__).resolve().parent.parent


def _sources_digest() -> str:
    digest = hashlib.sha256()
    for package in ("protocol", "companion", "vehicle_sim"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_bytes()
            if b"protocol.compiled import" in text:
                digest.update(path.name.encode() + text)
    return digest.hexdigest()[:16]


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = str(ROOT / ".cache" / "compiled" / _sources_digest())


def compiled(function: F) -> F:
    """Compile on the first call for its argument types; IEEE arithmetic throughout, so that runs repeat to the bit."""
    result: F = numba.njit(cache=True, error_model="numpy")(function)
    return result
