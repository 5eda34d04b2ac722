"""Arrays that are kept on disk for the next process."""

from pathlib import Path

import numpy as np
import pytest

from protocol import disk_cache as module
from protocol.arrays import Array
from protocol.disk_cache import cached_on_disk

calls: list[tuple[object, ...]] = []


@cached_on_disk("numpy")
def computed(size: int, values: object) -> Array:
    calls.append((size, values))
    return np.full(size, float(np.sum(values))) / 3.0  # type: ignore[call-overload]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(module, "CACHE_FOLDER", tmp_path)
    calls.clear()
    return tmp_path


def test_the_second_time_it_is_read(folder: Path) -> None:
    first = computed(3, [1.0])
    assert len(calls) == 1 and len(list(folder.iterdir())) == 1
    assert (computed(3, [1.0]) == first).all() and len(calls) == 1


def test_other_arguments_are_told_apart_to_the_last_bit() -> None:
    near = np.array([1.0]), np.array([np.nextafter(1.0, 2.0)])
    assert computed(1, near[0])[0] != computed(1, near[1])[0] and len(calls) == 2


def test_another_version_of_a_package_computes_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    computed(1, [1.0])
    monkeypatch.setattr("importlib.metadata.version", lambda package: "0.0")
    computed(1, [1.0])
    assert len(calls) == 2


@pytest.mark.parametrize("damage", [b"", b"\x93NUMPY", b"nonsense"])
def test_a_damaged_file_is_computed_anew(folder: Path, damage: bytes) -> None:
    first = computed(2, [1.0])
    (path,) = folder.iterdir()
    path.write_bytes(damage)
    assert (computed(2, [1.0]) == first).all() and len(calls) == 2
    assert (computed(2, [1.0]) == first).all() and len(calls) == 2, "and is whole again"


def test_without_a_place_it_is_computed_each_time(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setattr(module, "CACHE_FOLDER", None)
    computed(2, [1.0])
    computed(2, [1.0])
    assert len(calls) == 2 and not list(folder.iterdir())
    monkeypatch.setattr(module, "CACHE_FOLDER", folder / "gone")
    assert len(computed(2, [1.0])) == 2
