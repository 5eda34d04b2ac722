"""Reports of studies: blocks of text, tables, figures and checks, stored as JSON and shown as Markdown.

A page (docs/NAME.md) consists of its introduction, a table of all checks and the sections of its studies in order. The
sections are stored beside the figures in docs/NAME/, so that the page can be written again after one study alone.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import msgspec

from protocol import toml_files
from studies import style

T = TypeVar("T")
Cell = str | int | float

DOCS = toml_files.ROOT / "docs"


class Text(msgspec.Struct, frozen=True, tag="text"):
    markdown: str


class Table(msgspec.Struct, frozen=True, tag="table"):
    headers: list[str]
    rows: list[list[Cell]]
    caption: str


class Figure(msgspec.Struct, frozen=True, tag="figure"):
    file: str
    """Without its suffix: there is a .png and a .svg."""
    caption: str


class Check(msgspec.Struct, frozen=True, tag="check"):
    what: str
    floor: str
    measured: str
    ok: bool


class Section(msgspec.Struct, frozen=True):
    """The report of one study."""

    name: str
    title: str
    blocks: list[Text | Table | Figure | Check]

    @property
    def checks(self) -> list[Check]:
        return [block for block in self.blocks if isinstance(block, Check)]


class Study(Protocol):
    """A module of this package."""

    NAME: str
    TITLE: str

    def run(self, report: "Report") -> None: ...


@dataclass(frozen=True)
class Page:
    """`name` is that of its file in docs/; `studies` are modules, in the order of their sections."""

    name: str
    introduction: str
    studies: tuple[str, ...]


Track = Callable[[Iterable[Any], str], Iterable[Any]]
"""An iterable and a label -> the same iterable, with its progress shown."""


def untracked(iterable: Iterable[Any], label: str) -> Iterable[Any]:
    """Shows nothing."""
    return iterable


@dataclass(frozen=True, slots=True)
class Choice:
    """Options of the command line for campaigns; other studies have none."""

    seeds: int = 3
    """Flights of each case, at most; 0: report what was flown before."""
    methods: tuple[str, ...] = ()
    """Methods of avoidance; none: all."""
    overrides: tuple[str, ...] = ()
    """Overrides of the companion's settings."""
    logs: Path = toml_files.ROOT / "logs" / "avoidance"
    """Folder for tables, and for logs and pictures of failures."""


class Report:
    """Collects a section; figures go to `folder`."""

    def __init__(
        self, name: str, title: str, folder: Path, track: Track = untracked, choice: Choice | None = None
    ) -> None:
        self.name = name
        self.title = title
        self.choice = choice or Choice()
        self._folder = folder
        self._track = track
        self._blocks: list[Text | Table | Figure | Check] = []

    def progress(self, iterable: Iterable[T], label: str) -> Iterator[T]:
        """Iterate, with a progress bar where one is shown."""
        yield from self._track(iterable, label)

    def text(self, markdown: str) -> None:
        self._blocks.append(Text(markdown.strip()))

    def table(self, headers: Sequence[str], rows: Iterable[Sequence[Cell]], caption: str = "") -> None:
        """Floats are kept with six digits and shown with four; NaN is shown as a dash."""
        self._blocks.append(Table(list(headers), [[_kept(cell) for cell in row] for row in rows], caption))

    def figure(self, figure: Any, name: str, caption: str = "") -> None:
        """Write a matplotlib figure as NAME.png and NAME.svg."""
        self._folder.mkdir(parents=True, exist_ok=True)
        style.save(figure, self._folder / name, f"python -m studies {self.name}")
        self._blocks.append(Figure(name, caption))

    def check(self, what: str, floor: str, measured: Cell, ok: bool) -> None:
        """Add a check of a `measured` value against the required `floor`."""
        self._blocks.append(Check(what, floor, _shown(_kept(measured)), bool(ok)))

    def section(self) -> Section:
        return Section(self.name, self.title, list(self._blocks))


def _kept(cell: Cell) -> Cell:
    """A plain number that is the same on every machine: the last digits of a float are not."""
    if isinstance(cell, str | int):
        return cell
    return float(f"{cell:.6g}") if math.isfinite(cell) else "-"


def _shown(cell: Cell) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _rows(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headers, ["---"] * len(headers), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _block(block: Text | Table | Figure | Check, folder: str) -> str:
    match block:
        case Text():
            return block.markdown
        case Table():
            table = _rows(block.headers, [[_shown(cell) for cell in row] for row in block.rows])
            return f"{block.caption}\n\n{table}" if block.caption else table
        case Figure():
            shown = f"![{block.caption or block.file}]({folder}/{block.file}.png)"
            return f"{shown}\n\n*{block.caption}* ([SVG]({folder}/{block.file}.svg))" if block.caption else shown
        case Check():
            return f"- {'met' if block.ok else '**NOT MET**'}: {block.what}: {block.measured} (asked: {block.floor})"


def markdown(section: Section, folder: str) -> str:
    """A section; checks that follow each other make one list. `folder`: of the figures, as seen from the page."""
    parts = [f"## {section.title}", f"`python -m studies {section.name}`"]
    before: object = None
    for block in section.blocks:
        text = _block(block, folder)
        if isinstance(block, Check) and isinstance(before, Check):
            parts[-1] += "\n" + text
        else:
            parts.append(text)
        before = block
    return "\n\n".join(parts) + "\n"


def keep(section: Section, folder: Path) -> None:
    """Store a section as JSON beside its figures."""
    folder.mkdir(parents=True, exist_ok=True)
    data = msgspec.json.format(msgspec.json.encode(section), indent=1)
    (folder / f"{section.name}.json").write_bytes(data + b"\n")


def kept(name: str, folder: Path) -> Section | None:
    """The section of a study's last run; None if it never ran. Raises TomlFileError for a damaged file."""
    path = folder / f"{name}.json"
    if not path.is_file():
        return None
    try:
        return msgspec.json.decode(path.read_bytes(), type=Section)
    except msgspec.DecodeError as error:
        raise toml_files.TomlFileError(f"{path}: {error}") from error


def write_page(page: Page, names: Sequence[str], docs: Path = DOCS) -> Path:
    """Write docs/PAGE.md from the sections that are kept of the studies `names`."""
    folder = docs / page.name
    sections = [section for name in names if (section := kept(name, folder)) is not None]
    rows = [
        (f"[{section.name}](#{_anchor(section.title)})", check.what, check.floor, check.measured, _verdict(check.ok))
        for section in sections
        for check in section.checks
    ]
    parts = [page.introduction.strip() + "\n"]
    if rows:
        parts.append("## All checks\n\n" + _rows(("study", "what", "asked", "measured", ""), rows) + "\n")
    parts += [markdown(section, page.name) for section in sections]
    path = docs / f"{page.name}.md"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def _verdict(ok: bool) -> str:
    return "met" if ok else "**not met**"


def _anchor(title: str) -> str:
    """The anchor that hosts of Markdown give a heading."""
    kept_letters = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -_")
    return kept_letters.replace(" ", "-")
