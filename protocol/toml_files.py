"""TOML files (worlds, vehicles, missions, settings): found by name or path, read into frozen and checked records."""

import codecs
import copy
import errno
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar, get_args

import msgspec

T = TypeVar("T")

_MOST_BYTES = 64 << 20
_NOTHING: Mapping[str, str] = MappingProxyType({})
_UNKNOWN = re.compile(r"unknown field `(.+?)`(?: - at `(.*)`)?$")
_INDEX = re.compile(r"\[.*?\]")
_NEAR = 0.75
"""Likeness of two keys, of 1, from which on one may be a slip of the other."""
ROOT = Path(__file__).resolve().parent.parent


class TomlFileError(Exception):
    """A file that is missing or holds an impossible value; the text names the file and the key."""


def find(kind: str, name: str) -> Path:
    """The file at the path `name`, or `{kind}/{name}.toml` in the current folder or in the project's folder.

    Kinds are worlds, vehicles and missions. Raises TomlFileError, which lists the names that exist, for any other.
    """
    candidates = [Path(name), Path(kind) / f"{name}.toml", ROOT / kind / f"{name}.toml"]
    for path in candidates:
        try:
            if path.is_file():
                return path
        except OSError as error:  # a folder that may not be looked into, a name that is too long
            raise TomlFileError(f"{path}: {error.strerror}") from error
    known = sorted({path.stem for folder in (Path(kind), ROOT / kind) for path in folder.glob("*.toml")})
    there = f"(there: {', '.join(known) or 'nothing'}){_suggestion(get_close_matches(name, known, 1))}"
    raise TomlFileError(f"{name}: no such file, and none of that name in {kind}/ {there}")


def load(path: Path, record: type[T], overrides: Sequence[str] = (), renamed: Mapping[str, str] = _NOTHING) -> T:
    """Read a file as a `record` (a msgspec.Struct). `overrides` are "table.key=value", with the value as in TOML;
    `renamed` maps dotted old names of keys and tables to the new ones.

    Raises TomlFileError for a file that can't be read, is not TOML, holds nan or inf, has old names, or does not fit
    the record.
    """
    return convert(read(path), record, str(path), overrides, renamed)


def content(path: Path) -> bytes:
    """A file's bytes, without the byte order mark that programs of Windows begin it with. Raises OSError, for one
    without end, too."""
    with path.open("rb") as file:
        found = file.read(_MOST_BYTES + 1)
    if len(found) > _MOST_BYTES:
        raise OSError(errno.EFBIG, f"more than {_MOST_BYTES >> 20} MB")
    return found.removeprefix(codecs.BOM_UTF8)


def read(path: Path) -> dict[str, Any]:
    """The tables of a file as they are written. Raises TomlFileError."""
    try:
        return tomllib.loads(content(path).decode())
    except OSError as error:
        raise TomlFileError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # not UTF-8, not TOML, a number or a nesting without end
        raise TomlFileError(f"{path}: {error}") from error


def convert(
    tables: dict[str, Any],
    record: type[T],
    source: str,
    overrides: Sequence[str] = (),
    renamed: Mapping[str, str] = _NOTHING,
) -> T:
    """The same for tables that are already read; errors name `source`."""
    if overrides:
        source = f"{source} with --set"
    try:
        return _converted(tables, record, source, overrides, renamed)
    except RecursionError as error:
        raise TomlFileError(f"{source}: {error}") from error


def _converted(
    tables: dict[str, Any], record: type[T], source: str, overrides: Sequence[str], renamed: Mapping[str, str]
) -> T:
    if overrides:
        tables = copy.deepcopy(tables)
        for override in overrides:
            _set(tables, override)
    old = [f"{key} is now {new}" for key, _ in _leaves(tables, "") if (new := new_name(key, renamed)) != key]
    if old:
        raise TomlFileError(f"{source}: {', '.join(old)}")
    for key, number in floats(tables):
        if not math.isfinite(number):
            raise TomlFileError(f"{source}: {number} is not a finite number - at `{key}`")
    try:
        return msgspec.convert(tables, record)
    except msgspec.ValidationError as error:
        text = str(error).replace("$.", "")
        raise TomlFileError(f"{source}: {text}{_suggestion(_meant(text, record))}") from error


def _suggestion(names: Sequence[str]) -> str:
    return f"; did you mean {' or '.join(names)}?" if names else ""


def _meant(text: str, record: Any) -> list[str]:
    """The keys that may have been meant by the one that msgspec's message calls unknown: the nearest in its letters, or
    those of that name in other tables."""
    unknown = _UNKNOWN.search(text)
    if unknown is None:
        return []
    name, table = unknown.groups()
    key, known = name if table is None else f"{re.sub(_INDEX, '', table)}.{name}", list(_keys(record))
    return get_close_matches(key, known, 1, _NEAR) or [each for each in known if each.endswith(f".{name}")][:3]


def _keys(kind: Any, prefix: str = "") -> Iterator[str]:
    """The dotted keys of a record, and of those in it."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        for field in msgspec.structs.fields(kind):
            yield f"{prefix}{field.encode_name}"
            yield from _keys(field.type, f"{prefix}{field.encode_name}.")
    for part in get_args(kind):
        yield from _keys(part, prefix)


def new_name(key: str, renamed: Mapping[str, str]) -> str:
    """The new name of a dotted key; `renamed`: old names of keys and tables. The longest that fits counts."""
    for old in sorted(renamed, key=len, reverse=True):
        if key == old or key.startswith(f"{old}."):
            return renamed[old] + key[len(old) :]
    return key


def with_new_names(tables: dict[str, Any], renamed: Mapping[str, str]) -> dict[str, Any]:
    """A copy of tables in which all keys have their new names."""
    result: dict[str, Any] = {}
    for key, value in _leaves(tables, ""):
        *parents, last = new_name(key, renamed).split(".")
        table = result
        for parent in parents:
            table = table.setdefault(parent, {})
        table[last] = value
    return result


def override_with_new_name(override: str, renamed: Mapping[str, str]) -> str:
    """The same "table.key=value" with the new name of its key."""
    key, separator, value = override.partition("=")
    return f"{new_name(key.strip(), renamed)}{separator}{value}"


def by_first_word(overrides: Sequence[str], words: Sequence[str]) -> dict[str, list[str]]:
    """Group overrides by their first word: under each of `words` those that start with it and a dot, which are removed;
    under "" all others, unchanged."""
    groups: dict[str, list[str]] = {word: [] for word in (*words, "")}
    for override in overrides:
        word, dot, rest = override.strip().partition(".")
        if dot and word.strip() in words and not rest.startswith("="):
            groups[word.strip()].append(rest)
        else:
            groups[""].append(override)
    return groups


def _leaves(table: dict[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """All values, and empty tables, with their dotted keys."""
    for name, value in table.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def floats(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    """All floats in tables, with their dotted keys. TOML can write nan and inf, which no quantity may be."""
    match value:
        case dict():
            for name, each in value.items():
                yield from floats(each, f"{key}.{name}" if key else name)
        case list() | tuple():
            for index, each in enumerate(value):
                yield from floats(each, f"{key}[{index}]")
        case float():
            yield key, value


def _set(tables: dict[str, Any], override: str) -> None:
    key, separator, text = override.partition("=")
    path = key.strip().split(".")
    if not separator or not all(path):
        raise TomlFileError(f"--set {override}: write it as table.key=value")
    try:
        value, *others = tomllib.loads(f"value = {text}").values()
    except (ValueError, RecursionError):
        value, others = text.strip(), []  # a bare word is a string, as on any command line
    if others:
        raise TomlFileError(f"--set {override!r}: it has several keys, write a --set for each")
    table = tables
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise TomlFileError(f"--set {override}: {part} is a value, not a table")
    table[path[-1]] = value
