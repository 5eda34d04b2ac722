"""Settings: what the page in docs says is what there is."""

import typing
from pathlib import Path

import msgspec
import pytest

from companion import config
from companion.config import Settings, load_body, load_settings
from companion.flight import Plan, PlanError, check
from companion.mission import load
from companion.state import Output
from protocol.datafile import DataFileError

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "settings.md").read_text(encoding="utf-8")


def rows(table: msgspec.Struct, prefix: str = "") -> typing.Iterator[tuple[str, str, object]]:
    """Table, key and default of every setting."""
    for name in table.__struct_fields__:
        value = getattr(table, name)
        if isinstance(value, msgspec.Struct):
            yield from rows(value, f"{prefix}.{name}" if prefix else name)
        else:
            yield prefix, name, value


def test_the_page_names_every_setting_with_its_default() -> None:
    count = 0
    for prefix, name, value in rows(Settings()):
        section = PAGE.partition(f"## [{prefix}]\n")[2].partition("\n## ")[0]
        shown = "not set" if value is None else str(list(value)) if isinstance(value, tuple) else str(value).lower()
        assert f"| `{name}` | {shown} |" in section.replace('"', ""), (prefix, name)
        count += 1
    assert PAGE.count("\n| `") == count


def test_overrides_reach_their_place() -> None:
    settings = load_settings(None, ["control.position.c1=[1.0, 2.0, 3.0]", "avoidance.method=none"])
    assert settings.control.position.c1 == (1.0, 2.0, 3.0)
    assert settings.avoidance.method == "none"
    assert settings.control.attitude == config.AttitudeControl()


@pytest.mark.parametrize(
    "override", ["supervision.land_after=-1", "limits.tilt_deg=nan", "identity.component=300", "rates.least_share=1.5"]
)
def test_impossible_values(override: str) -> None:
    with pytest.raises(DataFileError, match=override.split("=")[0].split(".")[1]):
        load_settings(None, [override])


def test_a_vehicle_that_can_not_hover_within_the_limits_is_refused() -> None:
    mission, _ = load("hover")
    plan = Plan(load_settings(None, []), load_body("paper_quad"), mission, Output.RATES, 1.0, {})
    check(plan)
    heavy = msgspec.structs.replace(plan.body, mass_kg=3.5)
    with pytest.raises(PlanError, match="hovers at 1"):
        check(Plan(plan.settings, heavy, mission, Output.RATES, 1.0, {}))
