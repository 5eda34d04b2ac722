"""Arrays that take a library's seconds to be computed, kept on disk beside the compiled code and as safe from being
stale: an edit to a module that has any begins anew."""

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


def kept(*packages: str) -> Callable[[F], F]:
    """For a function whose array follows from its arguments and these packages' versions."""

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def read_or_computed(*arguments: Any) -> Any:
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

        kept_function: Any = read_or_computed
        result: F = kept_function
        return result

    return decorate
