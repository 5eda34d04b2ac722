"""Campaigns' files: what is wrong in one is said with its name."""

from pathlib import Path

import pytest

from protocol.toml_files import TomlFileError
from studies.campaigns import files


@pytest.mark.parametrize("wrong", ['world = "swamp"', 'world = "forest"\noptions = {densty = 1}'])
def test_what_is_wrong_in_a_file_is_said_with_its_name(wrong: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'name = "mine"\n[[place]]\n{wrong}\n', encoding="utf-8")
    with pytest.raises(TomlFileError, match=r"mine\.toml: place (swamp|forest): no such"):
        files.load(file)
