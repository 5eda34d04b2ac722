"""Compilation to machine code by numba, with a cache on disk that can't be stale.

numba's own cache depends on the file of a function, but not on the files of the functions that it calls. Here the name
of the cache's folder is a digest of all modules with compiled functions and of the project's modules that they import,
whose constants are compiled in. So an edit to any of them recompiles everything.

The cache is in `.cache/` of the project, or in the user's cache folder if the project can't be written to. If neither
can be written to, each process compiles for itself. NUMBA_CACHE_DIR replaces both folders.
"""

import contextlib
import functools
import hashlib
import importlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys
from numba.extending import overload

from protocol.machine_code import MachineCode

F = TypeVar("F", bound=Callable[..., Any])

ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("protocol", "companion", "vehicle_sim")
_SIGNS = (b"protocol.jit", b"import jit", b"protocol.disk_cache")
_IMPORT = re.compile(
    rb"""(?:^|[;:])[ \t]*
    (?:from[ \t]+([\w.]+)[ \t]+import[ \t]*(\((?:[^)\#]|\#[^\n]*+)*+\)|(?:[^\n\\\#;]|\\\n)*+)
    |import[ \t]+((?:[^\n\\\#;]|\\\n)*+))""",
    re.MULTILINE | re.VERBOSE,
)
"""Module and names, or modules. Python's own parser would take each process a quarter of a second."""
_NAME = re.compile(r"\w+")


def imported(source: bytes) -> Iterator[Path]:
    """The files of the project's modules that a module's source imports, perhaps also of some that its texts name."""
    for match in _IMPORT.finditer(source):
        module, names, modules = (group.decode(errors="replace") for group in match.groups(b""))
        found = modules.replace(",", " ").split()
        if module:
            found = [module, *(f"{module}.{name}" for name in _NAME.findall(names))]
        for name in found:
            if name.split(".")[0] in _PACKAGES:
                path = ROOT / name.replace(".", "/")
                yield from (each for each in (path.with_suffix(".py"), path / "__init__.py") if each.is_file())


def _sources_digest() -> str:
    sources = {path: path.read_bytes() for package in _PACKAGES for path in (ROOT / package).rglob("*.py")}
    unread = [path for path, text in sources.items() if any(sign in text for sign in _SIGNS)]
    relevant: set[Path] = set()
    while unread:
        path = unread.pop()
        if path not in relevant:
            relevant.add(path)
            unread.extend(imported(sources[path]))
    digest = hashlib.sha256()
    for path in sorted(relevant):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + sources[path] + b"\0")
    return digest.hexdigest()[:16]


def _stamp() -> str:
    """Changes whenever a source is written, added or taken away, also in one that is put in an old one's place."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for folder, folders, names in os.walk(ROOT / package):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            for name in sorted(names):
                path = Path(folder, name)
                state = path.stat()
                digest.update(f"{path}\0{state.st_ino} {state.st_size} {state.st_ctime_ns}\0".encode())
    return digest.hexdigest()


def _known_digest(place: Path) -> str:
    """The digest of the sources, which is kept in `place`; all are read only if one of them has changed since."""
    kept, stamp = place / "sources", _stamp()
    with contextlib.suppress(OSError, ValueError):
        of_stamp, digest = kept.read_text().split()
        if of_stamp == stamp:
            return digest
    digest = _sources_digest()
    with contextlib.suppress(OSError), tempfile.TemporaryDirectory(dir=place) as folder:
        whole = Path(folder) / kept.name
        whole.write_text(f"{stamp} {digest}")
        whole.replace(kept)
    return digest


def _cache_folder() -> Path | None:
    """The first folder that can be written to."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(chosen)] if chosen else [ROOT / ".cache" / "compiled", Path("~/.cache/courier/compiled")]
    for place in places:
        # RuntimeError: there is no home
        with contextlib.suppress(OSError, RuntimeError):
            place = place.expanduser()
            place.mkdir(parents=True, exist_ok=True)
            folder = place / _known_digest(place)
            folder.mkdir(exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
    return None


@functools.cache
def _load_numba_without_scipy() -> None:
    """numba's module of array functions asks at its import whether SciPy can be imported, which takes 0.2 s. A function
    that multiplies matrices by BLAS still asks when it is compiled. A numba that is built otherwise is left alone."""
    linalg: Any = importlib.import_module("numba.np.linalg")
    asked = getattr(linalg, "ensure_blas", None)
    if asked is None:
        return
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = asked


def _refuse_shapes(source: tuple[int, ...], slices: tuple[int, ...]) -> None:
    raise NotImplementedError


def _compiled_refuse_shapes(source: tuple[int, ...], slices: tuple[int, ...]) -> Callable[..., None]:
    def refuse(source: tuple[int, ...], slices: tuple[int, ...]) -> None:
        raise ValueError("cannot assign to a slice of another shape")

    return refuse


@functools.cache
def _refuse_shapes_in_few_words() -> None:
    """An array that is assigned to a slice of another shape is an error whose text by numba tells both shapes. To
    compile what writes them takes each process more than a second, a tenth of the first start."""
    overload(_refuse_shapes)(_compiled_refuse_shapes)
    importlib.import_module("numba.np.arrayobj").raise_with_shape_context = _refuse_shapes  # type: ignore[attr-defined]


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's own makes all ready for the compiler before it loads what needs no compiler, which takes 0.4 s; and it
    tries the folder of each function where it is defined, though one in ten is called."""

    _impl_class = MachineCode

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __getattr__(self, name: str) -> Any:
        if "_impl" in vars(self):
            raise AttributeError(name)
        super().__init__(self._function)
        return getattr(self, name)

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            loaded = self._load_overload(signature, target_context)
        if loaded is None:
            _load_numba_without_scipy()
            _refuse_shapes_in_few_words()
        return loaded


CACHE_FOLDER = _cache_folder()
numba.config.CACHE_DIR = str(CACHE_FOLDER or "")
if CACHE_FOLDER is None:
    _load_numba_without_scipy()
    _refuse_shapes_in_few_words()


def compiled(function: F) -> F:
    """A decorator: compile at the first call for its argument types, in IEEE arithmetic, so runs repeat exactly."""
    return _compiled(function)


def inlined(function: F) -> F:
    """As `compiled`, into each compiled function that calls it, so that a loop of calls can be vectorised."""
    return _compiled(function, forceinline=True)


def _compiled(function: F, **options: Any) -> F:
    result: Any = numba.njit(error_model="numpy", **options)(function)
    if CACHE_FOLDER is not None:
        result._cache = _Cache(function)
    return result  # type: ignore[no-any-return]
