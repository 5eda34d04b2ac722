"""Memory that the start of a flight needed and the flight does not: it goes back to the system."""

import ctypes
import gc
import re
from collections.abc import Iterator
from pathlib import Path

_SMAPS = Path("/proc/self/smaps")
_COMPILER = "libllvmlite"
"""The library that compiles: nothing is compiled in flight."""
_MAPPING = re.compile(
    r"^([0-9a-f]+)-([0-9a-f]+) r-.p [^\n]*/([^/\n]+)\n(?:\w+:[^\n]*\n)*?Anonymous: +0 kB$", re.MULTILINE
)
"""A mapping of a file that may not be written to, all of it as in the file: begin, end and name."""
_DONTNEED = 4
"""MADV_DONTNEED of Linux."""


def give_back() -> None:
    """Free what is left over: 14 MB of the heap, and 70 MB of the compiler's code, where the system is Linux.

    What of the code is used after all is read again from its file.
    """
    gc.collect()
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):  # glibc's alone
        libc.malloc_trim(0)
    for begin, end in unchanged(_COMPILER):
        libc.madvise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), _DONTNEED)


def unchanged(library: str) -> Iterator[tuple[int, int]]:
    """First address and end of what this process maps of a library, by the beginning of its name, and has not changed;
    nothing where the system does not say."""
    try:
        text = _SMAPS.read_text()
    except OSError:
        return
    for begin, end, name in _MAPPING.findall(text):
        if name.startswith(library):
            yield int(begin, 16), int(end, 16)
