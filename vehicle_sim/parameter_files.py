"""Parameters in a file, in QGroundControl's form: a line each with system, component, name, value and type. MAVProxy's
form, name and value, is read, too."""

from contextlib import suppress
from pathlib import Path

from vehicle_sim.services.parameter_store import Parameters, Refusal, text_of


class ParameterFileError(Exception):
    """A file or an assignment that can't be used; the message names it and says why."""


def keep(parameters: Parameters, path: Path | None, assignments: list[str], pace: float = 1.0) -> None:
    """Read a file, if it exists, then set NAME=VALUE each; from then on write each change to the file.

    At another pace than real time the times after which a peer counts as lost are scaled once the file has been read;
    the file keeps them as they are at real time. Raises ParameterFileError.
    """
    if path is not None:
        _read(parameters, path)
    if pace != 1.0:
        parameters.scale_losses(pace)
    for assignment in assignments:
        name, separator, value = assignment.partition("=")
        if not separator:
            raise ParameterFileError(f"--param {assignment}: write it as NAME=VALUE")
        _set(parameters, name, value, f"--param {assignment}")
    if path is not None:
        _write(parameters, path)
        parameters.on_change = lambda: _write_if_possible(parameters, path)


def _read(parameters: Parameters, path: Path) -> None:
    """Nothing if there is no such file. A mark of the byte order, as programs of Windows write it, is passed over."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        return
    except OSError as error:
        raise ParameterFileError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ParameterFileError(f"{path}: {error}") from error
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.startswith("#"):
            columns = line.split()
            if len(columns) not in (2, 5):
                raise ParameterFileError(f"{path}, line {number}: not system, component, name, value, type")
            name, value = columns[2:4] or columns
            _set(parameters, name, value, f"{path}, line {number}", in_file=True)


def _set(parameters: Parameters, name: str, text: str, where: str, *, in_file: bool = False) -> None:
    """What is so about the vehicle is not taken from a file, which may be another vehicle's."""
    try:
        value = parameters.parse(name, text)
    except (ValueError, OverflowError):
        raise ParameterFileError(f"{where}: {text} is no value of {name}") from None
    if name in parameters and parameters[name] == value:
        return
    refusal = parameters.set(name, value)
    if refusal is not None and (refusal is not Refusal.READ_ONLY or not in_file):
        raise ParameterFileError(f"{where}: {name}: {refusal.name.lower().replace('_', ' ')}")


def _write(parameters: Parameters, path: Path) -> None:
    """Whole, or not at all."""
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_text(text_of(parameters, at_real_time=True), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise ParameterFileError(f"{path}: {error.strerror}") from error


def _write_if_possible(parameters: Parameters, path: Path) -> None:
    """A disk that is full ends no flight."""
    with suppress(ParameterFileError):
        _write(parameters, path)
