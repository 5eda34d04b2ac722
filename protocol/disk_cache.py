"""A cache on disk for arrays whose computation takes a library's import and seconds.

It is beside the compiled code and is renewed as that is: an edit to a module that uses it starts an empty one.
"""

import contextlib
import functools
import hashlib
import pickle
import tempfile
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from protocol.jit import CACHE_FOLDER

F = TypeVar("F", bound=Callable[..., Any])


def cached_on_disk(*packages: str) -> Callable[[F], F]:
    """A decorator for a function whose array depends only on its arguments and on the versions of these packages.

    The arguments must be picklable. A file that is damaged is computed and written again.
    """

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def read_or_compute(*arguments: Any) -> Any:
            if CACHE_FOLDER is None:
                return function(*arguments)
            versions = [metadata.version(package) for package in packages]
            key = hashlib.sha256(pickle.dumps((versions, arguments), protocol=5)).hexdigest()[:16]
            path = CACHE_FOLDER / f"{function.__module__}.{function.__name__}-{key}.npy"
            with contextlib.suppress(OSError, ValueError, EOFError):
                return np.load(path)
            result = function(*arguments)
            with contextlib.suppress(OSError), tempfile.TemporaryDirectory(dir=CACHE_FOLDER) as folder:
                whole = Path(folder) / path.name
                np.save(whole, result)
                whole.replace(path)
            return result

        decorated: Any = read_or_compute
        result: F = decorated
        return result

    return decorate
