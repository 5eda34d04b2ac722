"""Where commands write: first to a folder beside the target, so that its name stands for a whole file or none."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from companion.logs.recordings import is_recording
from protocol.flightlog import FlightLogError

DRAFTS = ".courier-"
"""Start of the names of the folders with drafts; only a kill leaves one behind."""


@contextmanager
def output(
    target: Path, *, source: Path | None = None, replaces: bool = False, parents: bool = False
) -> Iterator[Path]:
    """Path for a draft of `target`, a file or a folder; it gets that name when the block ends without an error.

    An existing target is refused. With `replaces` an older file is replaced, but never `source` and never a recording.
    A device or a pipe is written to directly. `parents` makes the folders above.
    Raises FlightLogError, naming the target, for a refused target and for OSErrors in the block.
    """
    folder = None
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            yield target
            return
        place = target.resolve()
        if parents:
            place.parent.mkdir(parents=True, exist_ok=True)
        writable(target, source=source, replaces=replaces)
        folder = Path(tempfile.mkdtemp(prefix=DRAFTS, dir=place.parent))
        draft = folder / place.name
        yield draft
        writable(target, source=source, replaces=replaces)  # somebody else may have been here meanwhile
        draft.replace(place)
    except OSError as error:
        raise FlightLogError(f"{target}: can't be written: {error.strerror or error}") from error
    except FlightLogError as error:
        if folder is None:
            raise
        raise FlightLogError(str(error).replace(f"{folder}/{target.resolve().name}", str(target))) from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def writable(target: Path, *, source: Path | None = None, replaces: bool = False) -> None:
    """Raises FlightLogError if `output` would refuse the target, as far as can be told beforehand."""
    try:
        if not target.parent.is_dir():
            raise FlightLogError(f"{target}: no such folder")
        if not target.exists() and not target.is_symlink():
            return
        if not replaces or target.is_dir():
            raise FlightLogError(f"{target}: exists already")
        if is_recording(target) or (source is not None and source.exists() and target.samefile(source)):
            raise FlightLogError(f"{target}: a log is never written over")
    except OSError as error:
        raise FlightLogError(f"{target}: can't be written: {error.strerror or error}") from error
