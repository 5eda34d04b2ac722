"""Reports, the pages made of them, and the command line."""

import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from protocol.toml_files import TomlFileError
from studies import __main__ as command_line
from studies import style
from studies.report import Page, Report, keep, kept, markdown, write_page


def full_report(folder: Path) -> Report:
    report = Report("swing", "A swing: how it goes", folder)
    report.text("It swings.")
    report.table(("c", "rise / s"), [(1, 1.23456), ("none", math.nan)], "How fast:")
    figure, axes = style.sheet(height=1.5)
    axes.plot([0.0, 1.0], [1.0, 0.0])
    report.figure(figure, "swing", "A line.")
    report.check("rise", "<= 2 s", 1.23456, True)
    report.check("error", "<= 1 m", 2.0, False)
    return report


def test_section_as_markdown(tmp_path: Path) -> None:
    text = markdown(full_report(tmp_path).section(), "paper")
    assert text.startswith("## A swing: how it goes\n\n`python -m studies swing`\n\nIt swings.\n")
    assert "| c | rise / s |\n| --- | --- |\n| 1 | 1.235 |\n| none | - |" in text
    assert "![A line.](paper/swing.png)" in text
    assert "- met: rise: 1.235 (asked: <= 2 s)\n- **NOT MET**: error: 2 (asked: <= 1 m)\n" in text


def test_figures_are_the_same_bytes_again_and_name_their_command(tmp_path: Path) -> None:
    for name in ("first", "second"):
        full_report(tmp_path / name)
    for suffix in (".png", ".svg"):
        first, second = ((tmp_path / name / f"swing{suffix}").read_bytes() for name in ("first", "second"))
        assert first == second and len(first) < 40_000
    assert "python -m studies swing" in (tmp_path / "first" / "swing.svg").read_text()


def test_a_long_command_is_in_the_picture_from_its_first_word_to_its_last(tmp_path: Path) -> None:
    figure, _ = style.sheet()
    style.save(figure, tmp_path / "long", "companion demo " + " ".join(f"--set 'a.setting={k}'" for k in range(30)))
    (said,) = figure.texts
    extent, whole = said.get_window_extent(), figure.bbox
    assert whole.x0 <= extent.x0 and extent.x1 <= whole.x1 and whole.y0 <= extent.y0
    axes = figure.axes[0].get_tightbbox()
    assert axes.y0 >= extent.y1 - 1.0
    assert said.get_text().startswith("companion demo") and said.get_text().rstrip().endswith("--set 'a.setting=29'")


def test_page_is_written_from_what_is_kept(tmp_path: Path) -> None:
    section = full_report(tmp_path / "book").section()
    keep(section, tmp_path / "book")
    assert kept("swing", tmp_path / "book") == section
    page = Page("book", "# A book", ("studies.never_imported",))
    text = write_page(page, ["swing", "never run"], tmp_path).read_text()
    assert text.startswith("# A book\n\n## All checks\n")
    assert "| [swing](#a-swing-how-it-goes) | rise | <= 2 s | 1.235 | met |" in text
    assert text.endswith(markdown(section, "book"))


def test_a_damaged_section_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "swing.json").write_text('{"name": 3}')
    with pytest.raises(TomlFileError, match=r"swing\.json"):
        kept("swing", tmp_path)


def test_progress_passes_everything_on(tmp_path: Path) -> None:
    assert list(Report("swing", "", tmp_path).progress(iter("abc"), "letters")) == ["a", "b", "c"]


def test_list_has_every_study_once() -> None:
    result = CliRunner().invoke(command_line.app, ["--list"])
    assert result.exit_code == 0
    names = [line.split()[0] for line in result.stdout.splitlines()]
    assert len(names) == len(set(names))
    assert {"attitude-loop", "paper"} <= set(names)


def test_an_unknown_name_is_one_clear_line() -> None:
    result = CliRunner().invoke(command_line.app, ["attitude-loop", "nonesuch"])
    assert result.exit_code == command_line.UNUSABLE
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1 and "nonesuch: no such study" in result.stderr
