"""The map of a mission: each place where it is, at its scale, and no text of a file as markup."""

import re
from pathlib import Path

import numpy as np
import pytest

from companion.mission.plan import Mission, Waypoint, steps
from companion.runtime.files import load_mission
from companion.view.mission_map import marks, page, round_length, sketch, way
from protocol import toml_files
from tests.companion.cli.test_mission import ran
from tests.companion.mission.test_files import HOME, UP, A, B, at, plan

START = np.zeros(3)
CORNERS = [Waypoint(20.0, 0.0, 3.0), Waypoint(20.0, 40.0, 5.5)]
L_SHAPE = Mission("corner", waypoints=CORNERS, description="<b>&", return_home=False)
BOX = b"""[[box]]\nname = "<i>shed"\ncenter = [10.0, 20.0]\nsize = [4.0, 8.0]\nheight = 3.0\n"""


def test_the_sketch_has_its_places_north_up_and_to_scale() -> None:
    *rows, _, scale = sketch(steps(L_SHAPE, START)).splitlines()
    top, bottom = rows[0], rows[-1]
    assert top.index("2") == 0 and bottom.startswith("1"), "20 m north is up"
    per_row, per_column = 20.0 / (len(rows) - 1), 40.0 / top.index("3")
    assert per_row == pytest.approx(2.0 * per_column, rel=0.1)
    assert scale.endswith("10 m, north is up") and len(scale.split()[0]) * per_column == pytest.approx(10.0, abs=1.0)


def test_the_page_has_route_places_heights_obstacles_and_fence() -> None:
    html = page(L_SHAPE, steps(L_SHAPE, START), BOX, 60.0)
    assert "3 · 5.5 m" in html and "2 · 3 m" in html
    assert "&lt;b&gt;&amp;" in html and "&lt;i&gt;shed, 0 to 3 m" in html and "<b>" not in html and "<i>" not in html
    assert not re.search(r"https?:|src=|@import|url\(", html)
    spots = [tuple(map(float, each)) for each in re.findall(r'"place" transform="translate\((.+?),(.+?)\)', html)]
    (x1, y1), (x2, y2), (x3, y3) = spots
    assert x2 == x1 and y3 == y2 and x3 - x2 == pytest.approx(2.0 * (y1 - y2), abs=0.3) and y1 > y2
    route = re.search(r'class="route" points="(.+?)"', html)
    assert route is not None and route[1].split()[-1] == f"{x3},{y3}"
    fence = re.search(r'class="fence" transform="translate\((.+?),(.+?)\)" r="(.+?)"', html)
    assert fence is not None and (float(fence[1]), float(fence[2])) == (x1, y1)
    assert float(fence[3]) == pytest.approx(60.0 / 20.0 * (y1 - y2), abs=0.5)
    box = re.search(r'class="obstacle" points="(.+?)"', html)
    assert box is not None
    assert np.mean([list(map(float, each.split(","))) for each in box[1].split()], axis=0) == pytest.approx(
        [(x1 + x3) / 2.0, (y1 + y2) / 2.0], abs=0.2
    )
    assert "fence" not in page(L_SHAPE, steps(L_SHAPE, START), b"", None)


def test_a_place_that_is_passed_twice_has_both_numbers_and_a_curve_its_bends() -> None:
    there_and_back = Mission("back", waypoints=CORNERS)
    assert [mark.numbers for mark in marks(steps(there_and_back, START))] == [[1, 5], [2, 4], [3]]
    circle = load_mission("circle")[0]
    assert circle.trajectory is not None
    east = way(steps(circle, START))[:, 1]
    assert np.ptp(east) == pytest.approx(2.0 * circle.trajectory.size, rel=0.01)


@pytest.mark.parametrize(("most", "length"), [(1.0, 1.0), (19.0, 10.0), (20.0, 20.0), (730.0, 500.0), (0.3, 0.2)])
def test_a_scale_has_a_round_length(most: float, length: float) -> None:
    assert round_length(most) == pytest.approx(length)


def test_the_command_draws_and_writes_the_page(tmp_path: Path) -> None:
    file, target = tmp_path / "trip.plan", tmp_path / "map.html"
    file.write_text(plan([UP, at(*A, 2.0), at(*B), HOME]))
    code, shown = ran("mission", "show", file, "--html", target)
    assert code == 0 and "north is up" in shown and target.read_text().count('class="place"') == 3
    assert ran("mission", "show", file, "--html", target)[0] == 2, "an old file is not replaced"
    for name in sorted(path.stem for path in (toml_files.ROOT / "missions").glob("*.toml")):
        assert sketch(steps(load_mission(name)[0], START)).endswith("north is up")
