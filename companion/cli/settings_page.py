"""All settings with their defaults and meanings, as the page docs/settings.md: `companion settings`."""

import ast
import inspect
from collections.abc import Iterator

import msgspec

from companion import config
from companion.avoidance_methods import METHODS

HEAD = """# Settings

For `--settings FILE` (TOML) and `--set table.key=value`; these are the defaults, from `companion/config*.py`.
Printed by `companion settings`.
"""


def page() -> str:
    """Markdown."""
    return HEAD + "".join(_section(name, table) for name, table in _tables(config.Settings())) + _methods()


def _methods() -> str:
    """The methods of avoidance, of which `avoidance.method` is one."""
    lines = ["\n## Methods of avoidance\n", "| method | | mapped | its settings |", "| --- | --- | --- | --- |"]
    for method in METHODS.values():
        table = "" if method.table is None else f"[avoidance.{method.table}]"
        lines.append(f"| `{method.name}` | {method.summary} | {'yes' if method.mapped else ''} | {table} |")
    return "\n".join(lines) + "\n"


def _tables(table: msgspec.Struct, prefix: str = "") -> Iterator[tuple[str, msgspec.Struct]]:
    """Every table that holds values, with its dotted name."""
    parts = {name: getattr(table, name) for name in table.__struct_fields__}
    if any(not isinstance(value, msgspec.Struct) for value in parts.values()):
        yield prefix, table
    for name, value in parts.items():
        if isinstance(value, msgspec.Struct):
            yield from _tables(value, f"{prefix}.{name}" if prefix else name)


def _section(name: str, table: msgspec.Struct) -> str:
    meanings = _meanings(type(table))
    lines = [f"\n## [{name}]\n", meanings[""], "", "| key | default | |", "| --- | --- | --- |"]
    for key in table.__struct_fields__:
        value = getattr(table, key)
        if not isinstance(value, msgspec.Struct):
            lines.append(f"| `{key}` | {_shown(value)} | {meanings.get(key, '')} |")
    return "\n".join(lines) + "\n"


def _shown(value: object) -> str:
    match value:
        case None:
            return "not set"
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case tuple():
            return str(list(value))
    return str(value)


def _meanings(table: type) -> dict[str, str]:
    """The strings below the fields of a class, by field; the class's own under the empty name."""
    (tree,) = ast.parse(inspect.getsource(table)).body
    assert isinstance(tree, ast.ClassDef)
    found = {"": _line(ast.get_docstring(tree) or "")}
    field = ""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            field = node.target.id
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and field:
            found[field] = _line(str(node.value.value))
            field = ""
        else:
            field = ""
    return found


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
