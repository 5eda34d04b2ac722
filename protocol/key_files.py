"""Signing keys in files, and beside each what must not be forgotten of it: `FILE.state`.

It is written before anything acts that goes beyond what was written last (see `protocol.signing`), about once a second:
whole or not at all, so that a kill leaves the old or the new one. It is not forced onto the disk, which would hold up
the loop: a power cut may forget the last seconds.
"""

import contextlib
import json
import os
import secrets
import stat
import time
from collections.abc import Callable
from pathlib import Path

from protocol.signing import KEY_SIZE, LAST, SECOND, Memory, Signing, timestamp

_MODE = 0o600
_LARGEST_STATE = 1 << 16
_TICK_NS = 10_000
_YEAR = 365 * 86_400 * SECOND


class KeyFileError(Exception):
    """A key that can't be used; the message names its file and says why."""


def make_key(path: Path) -> None:
    """A new file with a random key, which its owner alone may read. Raises KeyFileError; nothing is overwritten."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _MODE)
        try:
            with os.fdopen(handle, "wb") as file:
                os.fchmod(handle, _MODE)
                file.write(secrets.token_bytes(KEY_SIZE))
        except OSError:  # half a key is none
            path.unlink()
            raise
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None


def read_key(path: Path) -> bytes:
    """The key of a file of 32 bytes with mode 0600. Raises KeyFileError for any other."""
    return _read(path, KEY_SIZE, f"a key has {KEY_SIZE} bytes; `companion key FILE` makes one")


def _read(path: Path, most: int, otherwise: str) -> bytes:
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            data = file.read(most + 1)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}") from None
    if mode != _MODE:
        raise KeyFileError(f"{path}: its mode is {mode:04o}, not {_MODE:04o}, with which its owner alone may use it")
    if len(data) > most or (most == KEY_SIZE and len(data) != most):
        raise KeyFileError(f"{path}: {otherwise}")
    return data


class Keeper:
    """A key, its memory, and its clock, which never goes back: not after a restart, nor when the wall's is set back.
    All links of a program share one."""

    def __init__(
        self,
        key: bytes,
        state: Path | None = None,
        unix_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`state`: the memory's file; None for a key that ends with the program. Raises KeyFileError."""
        self.fault: str | None = None
        """Why the memory can't be written."""
        self._state = state
        memory = Memory() if state is None else _remember(state)
        self._unix_ns, self._monotonic_ns = unix_ns, monotonic_ns
        self._base = max(timestamp(unix_ns()), memory.sent)
        self._base_ns = monotonic_ns()
        self.signing = Signing(key, memory, self._base)
        self._write(memory)
        if self.fault is not None:
            raise KeyFileError(self.fault)

    @classmethod
    def of(cls, path: Path) -> "Keeper":
        """The keeper of the key in a file. Raises KeyFileError."""
        return cls(read_key(path), path.with_name(f"{path.name}.state"))

    def now(self) -> int:
        """As MAVLink's timestamp."""
        return max(timestamp(self._unix_ns()), self._base + (self._monotonic_ns() - self._base_ns) // _TICK_NS)

    def settle(self) -> None:
        """Write down what is due; to be called before what was signed leaves, and before what was accepted acts."""
        if self.signing.due:
            self._write(self.signing.leased(self.now()))

    def _write(self, memory: Memory) -> None:
        if self._state is None:
            return
        draft = self._state.with_name(f"{self._state.name}.{os.getpid()}")
        try:
            with contextlib.suppress(KeyFileError):  # damaged meanwhile: it is written anew
                memory = memory.merged(_remember(self._state))
            heard = {"/".join(map(str, stream)): limit for stream, limit in memory.heard.items()}
            handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, _MODE)
            with os.fdopen(handle, "w") as file:
                json.dump({"sent": memory.sent, "heard": heard}, file)
            draft.replace(self._state)
            self.fault = None
        except OSError as error:
            self.fault = f"{self._state}: can't be written: {error.strerror}"


def _remember(state: Path) -> Memory:
    if not state.exists():
        return Memory()
    try:
        table = json.loads(_read(state, _LARGEST_STATE, "it is too long"))
        return Memory(_limit(table["sent"]), {_stream(name): _limit(limit) for name, limit in table["heard"].items()})
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise KeyFileError(
            f"{state}: damaged. It keeps old messages from being taken again: make a new key for both sides"
        ) from None


def _limit(value: object) -> int:
    """A timestamp. Raises ValueError for what is none, or leaves less than a year of them."""
    if type(value) is not int or not 0 <= value < LAST - _YEAR:
        raise ValueError(value)
    return value


def _stream(name: str) -> tuple[int, int, int]:
    system, component, link = map(int, name.split("/"))
    return system, component, link
