"""Laws, planners and outputs of other packages, found by their entry points (docs/extend.md).

They are looked for when a setting names something that is not built in. So a package that is installed and broken stops
no flight but its own.
"""

import functools
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import EntryPoint, entry_points
from typing import Any

Options = dict[str, float | bool | str]
"""Options of a plug-in, by name."""


class Kind(Enum):
    """What a plug-in is, in words; each has its group of entry points."""

    POSITION_LAW = "position law"
    ATTITUDE_LAW = "attitude law"
    PLANNER = "planner"
    OUTPUT = "output message"

    @property
    def group(self) -> str:
        """The group of the entry points."""
        return f"courier.{self.name.lower()}s"


METHODS = {
    Kind.POSITION_LAW: ("reset", "acceleration_command"),
    Kind.ATTITUDE_LAW: ("reset", "turning_command"),
    Kind.PLANNER: ("plan",),
    Kind.OUTPUT: ("message",),
}
"""What each kind is asked."""


class PluginError(Exception):
    """A plug-in can't be loaded or made, or gives something that can't be flown."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """An entry point."""

    kind: Kind
    name: str
    package: str
    """With its version."""
    entry: EntryPoint

    @property
    def text(self) -> str:
        """Its name and its package."""
        return f'"{self.name}" of {self.package}'

    def make(self, settings: Any, options: Options) -> Any:
        """Call its factory with the settings of its stage and its own options. Raises PluginError, also if what it
        makes lacks a method."""
        with self.named():
            made = self.entry.load()(settings, **options)
        for method in METHODS[self.kind]:
            if not callable(getattr(made, method, None)):
                raise self.broken(f"{type(made).__name__} has no method {method}()")
        return made

    @contextmanager
    def named(self) -> Iterator[None]:
        """A block in which whatever is raised is a PluginError that names the plug-in: also what exits the program, or
        is no Exception, would end a flight without a word of who did. An interrupt is the user's. What is printed goes
        to standard error: standard output is the command's, whose answer may be JSON."""
        try:
            with redirect_stdout(sys.stderr):
                yield
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise self.broken(error) from error

    def broken(self, reason: object) -> PluginError:
        """The error that names it."""
        text = f"{reason!r}{self._place(reason)}" if isinstance(reason, BaseException) else reason
        return PluginError(f"{self.kind.value} {self.text}: {text}")

    def _place(self, error: BaseException) -> str:
        """Where in its own package an error was raised, to stand behind it; empty if it was elsewhere."""
        package, place, trace = self.entry.module.partition(".")[0], "", error.__traceback__
        while trace is not None:
            module = str(trace.tb_frame.f_globals.get("__name__"))
            if module.partition(".")[0] == package:
                place = f" at {module}:{trace.tb_lineno}"
            trace = trace.tb_next
        return place


@functools.cache
def installed(kind: Kind) -> Mapping[str, tuple[Plugin, ...]]:
    """By name: one, or several that have the same."""
    found: dict[str, tuple[Plugin, ...]] = {}
    for entry in entry_points(group=kind.group):
        package = "?" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
        found[entry.name] = *found.get(entry.name, ()), Plugin(kind, entry.name, package, entry)
    return found


def plugin(kind: Kind, key: str, name: str, built_in: Collection[str]) -> Plugin | None:
    """The plug-in that a setting names; None for what is built in, whatever else has its name. Raises ValueError for
    what is neither, with a list of what there is, and for a name that more than one package has."""
    if name in built_in:
        return None
    found = installed(kind).get(name, ())
    if not found:
        known = dict.fromkeys((*built_in, *installed(kind)))
        raise ValueError(f"{key} {name!r}: there are " + ", ".join(f'"{each}"' for each in known))
    if len(found) > 1:
        packages = " and ".join(each.package for each in found)
        raise ValueError(f"{key} {name!r}: {packages} have a {kind.value} of this name; uninstall all but one")
    return found[0]


def options_for(chosen: Plugin | None, options: Options) -> None:
    """Raises ValueError for options of something that is built in."""
    if chosen is None and options:
        raise ValueError("options: they are for what comes from another package")
