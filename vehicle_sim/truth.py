"""The true motion of every tick: a structured array in an .npy file, written after the flight."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.toml_files import TomlFileError
from vehicle_sim.physics.rigid_body import STATES

TRUTH = np.dtype(
    [
        ("time_ns", "i8"),  # since boot, at the tick's end
        ("state", "f8", STATES),  # at that time; see rigid_body
        ("wind_ned", "f8", 3),  # m/s, during the tick
    ]
)
_BLOCK_TICKS = 15_000
"""One minute."""


class TruthRecorder:
    """Keeps one row a tick in memory, in blocks of a minute. Nothing is copied or written before `write`."""

    def __init__(self, path: Path) -> None:
        """Raises TomlFileError if the file can't be written."""
        self._path = path
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise TomlFileError(f"{path}: {error.strerror}") from error
        self._full: list[NDArray[np.void]] = []
        self._next_block()

    def _next_block(self) -> None:
        self._block = np.empty(_BLOCK_TICKS, TRUTH)
        self._rows = 0
        # writing to a field of a whole block is faster than to a field of one row
        self._times, self._states, self._winds = (self._block[name] for name in ("time_ns", "state", "wind_ned"))

    def record(self, time_ns: int, state: Array, wind_ned: Array) -> None:
        """Record one tick: the state (17,) at its end, the wind (3,) (m/s) in it."""
        row = self._rows
        if row == _BLOCK_TICKS:
            self._full.append(self._block)
            self._next_block()
            row = 0
        self._times[row] = time_ns
        self._states[row] = state
        self._winds[row] = wind_ned
        self._rows = row + 1

    def write(self) -> None:
        """Write (ticks,) of TRUTH and close the file. Raises TomlFileError if that fails, as on a full disk."""
        try:
            with self._file:
                np.save(self._file, np.concatenate([*self._full, self._block[: self._rows]]))
        except OSError as error:
            raise TomlFileError(f"{self._path}: {error.strerror or error}") from error
