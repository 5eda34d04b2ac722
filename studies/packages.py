"""What flies of other packages (docs/extend.md), as a digest: Courier's own does not know their files."""

from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

from companion.plugins import Plugin
from companion.runtime.files import load_settings
from protocol.toml_files import TomlFileError


@cache
def digest(overrides: tuple[str, ...]) -> str:
    """A digest of the packages whose laws, planners and outputs these settings name, with their versions; empty without
    any. A process asks once: it has loaded them by then, or does so soon."""
    try:
        chosen = load_settings(None, overrides).plugins
    except TomlFileError:  # nothing can be flown by these
        return ""
    found = sha256()
    for each in chosen:
        found.update(f"{each.kind.value} {each.text} {each.entry.value}".encode())
        for path in sorted(_sources(each)):
            found.update(path.name.encode() + sha256(path.read_bytes()).digest())
    return found.hexdigest()[:16] if chosen else ""


def _sources(plugin: Plugin) -> Iterator[Path]:
    """The Python files of its package, which is not imported for that; none where there is no such package."""
    spec = find_spec(plugin.entry.module.partition(".")[0])
    if spec is None:
        return
    if spec.submodule_search_locations is not None:
        for folder in spec.submodule_search_locations:
            yield from Path(folder).rglob("*.py")
    elif spec.has_location and spec.origin is not None:
        yield Path(spec.origin)
