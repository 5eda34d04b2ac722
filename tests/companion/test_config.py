"""Settings: what the page in docs says is what there is."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from companion import config
from companion.cli.settings_page import page
from companion.config import Settings
from companion.mission.plan import Mission, Waypoint
from companion.runtime.feasibility import check_curves, out_of_reach, within_reach
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.flight import Plan, PlanError, check
from companion.state import Output
from protocol.toml_files import TomlFileError
from protocol.vehicle_parameters import GRAVITY

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "settings.md").read_text(encoding="utf-8")


def test_the_page_is_what_the_command_prints() -> None:
    assert page() == PAGE, "companion settings > docs/settings.md"
    assert "| `c1` | [2.5, 2.5, 2.5] |" in PAGE and "## [control.position]" in PAGE


def test_overrides_reach_their_place() -> None:
    settings = load_settings(None, ["control.position.c1=[1.0, 2.0, 3.0]", "avoidance.method=none"])
    assert settings.control.position.c1 == (1.0, 2.0, 3.0)
    assert settings.avoidance.method == "none"
    assert settings.control.attitude == config.AttitudeControl()


def test_a_method_flies_with_another_one_without_what_it_does_not_go_with() -> None:
    """On the very first start all that is compiled is flown with "none" first."""
    asked = load_settings(None, ["avoidance.guard.enabled=true", "avoidance.ground_slope=0.2"]).avoidance
    assert asked.guarded and asked.by("vfh").guarded and not asked.by("none").guarded
    assert asked.by("vfh").ground_slope == 0.2 and asked.by("none").ground_slope == 0.0


@pytest.mark.parametrize("method", ["none", "paper", "paper-literal"])
def test_heights_follow_the_ground_over_the_map_alone(method: str) -> None:
    """The straight way to a goal that rises would lead into the hill."""
    with pytest.raises(TomlFileError, match=f'ground_slope: with method "{method}"'):
        load_settings(None, ["avoidance.ground_slope=0.2", f"avoidance.method={method}"])


@pytest.mark.parametrize(
    "override",
    [
        "supervision.land_after=-1",
        "supervision.land_after=1.0",
        "limits.tilt_deg=nan",
        "limits.tilt_deg=90",
        "identity.component=300",
        "rates.least_share=1.5",
        "avoidance.map.cells=17",
        "avoidance.map.cells=1000000000",
        "avoidance.rrt.seed=4294967296",
        "avoidance.rrt.iterations=9223372036854775807",
        "avoidance.map.cell=1e10",
        "rates.attitude=5e-324",
        "rates.position=1e308",
        "supervision.command_interval=1e308",
        "control.prediction.command_delay=1e308",
        "control.attitude.input_weight=[2.8e7, 1e-9, 4e-7]",
        "control.attitude.bandwidth=[1e6, 1.0, 1.0]",
        "geofence.north=[-1e308, 1e308]",
    ],
)
def test_impossible_values(override: str) -> None:
    with pytest.raises(TomlFileError, match=override.split("=")[0].split(".")[1]):
        load_settings(None, [override])


def test_the_papers_vehicle_turns_at_once() -> None:
    """docs/paper.md flies it so."""
    keys = "trajectory.yaw_rate_deg", "trajectory.yaw_acceleration_deg"
    assert load_settings(None, [f"{key}=1e12" for key in keys]).trajectory.yaw_rate_deg == 1e12


def test_an_old_name_is_refused_with_the_new_one(tmp_path: Path) -> None:
    path = tmp_path / "old.toml"
    path.write_text("[avoidance.plan]\ndoubt = 120.0\n[avoidance.heights]\nabove = 4.0\nmargin = 1.0\n")
    with pytest.raises(TomlFileError) as refused:
        load_settings(path, [])
    assert str(refused.value) == (
        f"{path}: avoidance.plan.doubt is now avoidance.plan.unconfirmed_cost, "
        "avoidance.heights.above is now avoidance.altitude_search.max_climb, "
        "avoidance.heights.margin is now avoidance.altitude_search.margin"
    )
    with pytest.raises(TomlFileError, match=r"--set: avoidance\.course\.leash is now avoidance\.course\.max_lead"):
        load_settings(None, ["avoidance.course.leash=0.5"])


def test_a_loop_needs_a_vehicle_that_may_be_inverted() -> None:
    mission, _ = load_mission("loop")
    free_to_turn = ["limits.tilt_deg=180", "limits.roll_pitch_rate_deg=340"]
    body, free = load_body(mission.vehicle), load_settings(None, free_to_turn)
    for output in (Output.RATES, Output.ACTUATORS):
        check(Plan(free, body, mission, output, 1.0, {}))
    with pytest.raises(PlanError, match="a loop needs 180"):
        check(Plan(load_settings(None, []), body, mission, Output.RATES, 1.0, {}))
    with pytest.raises(PlanError, match="roll_pitch_rate_deg 220: the loop needs 334"):
        check(Plan(load_settings(None, free_to_turn[:1]), body, mission, Output.RATES, 1.0, {}))
    with pytest.raises(PlanError, match=r"highest_thrust 0\.9: the loop needs 1\.66"):
        check(Plan(free, load_body("paper_quad"), mission, Output.RATES, 1.0, {}))
    for chosen in (None, Output.ATTITUDE):
        with pytest.raises(PlanError, match="choose --output rates or actuators"):
            check(Plan(free, body, mission, chosen, 1.0, {}))


def test_a_vehicle_that_can_not_hover_within_the_limits_is_refused() -> None:
    mission, _ = load_mission("hover")
    plan = Plan(load_settings(None, []), load_body("paper_quad"), mission, Output.RATES, 1.0, {})
    check(plan)
    heavy = msgspec.structs.replace(plan.body, mass_kg=3.5)
    with pytest.raises(PlanError, match="hovers at 1"):
        check(Plan(plan.settings, heavy, mission, Output.RATES, 1.0, {}))


def test_no_speed_is_chosen_by_a_braking_that_the_limits_do_not_allow() -> None:
    """With a tilt of 15 degrees, 2.6 m/s2, a vehicle at 12 m/s hit a wall: its speed was chosen by a braking of 5.5."""
    body = load_body("paper_quad")

    def soft(*overrides: str) -> tuple[Settings, str]:
        return within_reach(load_settings(None, overrides), body)

    assert soft() == (load_settings(None), "")
    found, note = soft("limits.tilt_deg=15.0")
    course, guard, most = found.avoidance.course, found.avoidance.guard, GRAVITY * math.tan(math.radians(15.0))
    assert "limits.tilt_deg 15" in note and "2.6 m/s2" in note
    keys = course.acceleration, course.braking, guard.braking, guard.emergency_braking, guard.evasion
    assert keys == pytest.approx((most,) * 5) and found.trajectory.acceleration == pytest.approx(most)
    assert found.limits == load_settings(None, ["limits.tilt_deg=15.0"]).limits
    found, note = soft("limits.tilt_deg=25.0", "avoidance.method=none", "trajectory.acceleration=2.0")
    assert not note and found.avoidance.course == Settings().avoidance.course, "what is not used changes nothing"
    assert soft("limits.tilt_deg=25.0", "avoidance.method=none", "trajectory.acceleration=9.0")[1]
    found, note = soft("limits.highest_thrust=0.53")
    assert note and found.avoidance.guard.braking < 5.5, "at 0.47 it hovers"
    loose = "limits.tilt_deg=180.0", "limits.roll_pitch_rate_deg=400.0"
    assert soft(*loose) == (load_settings(None, loose), "")


@pytest.mark.parametrize(
    ("name", "keys", "settings", "needed"),
    [
        ("circle", ["speed=8", "radius=6"], [], 8.0**2 / 6.0),
        ("circle", ["speed=8", "radius=6"], ["limits.tilt_deg=60.0"], None),
        ("lemniscate", ["speed=8", "radius=3"], [], 17.0 / 16.0 * 8.0**2 / 3.0),
        ("circle", ["speed=8", "radius=6", "laps=0.1"], [], None),
        ("square", ["speed=30"], [], None),
        ("hover", [], ["limits.tilt_deg=1.0"], None),
        *((name, [], [], None) for name in ("circle", "helix", "lemniscate", "ellipse", "curve")),
    ],
)
def test_a_shape_that_needs_more_than_the_limits_is_named(
    name: str, keys: list[str], settings: list[str], needed: float | None
) -> None:
    """A circle at 8 m/s was flown up to 8.7 m beside its path without a word."""
    mission, _ = load_mission(name)
    if mission.trajectory is not None:
        changes = {key: float(value) for key, _, value in (each.partition("=") for each in keys)}
        mission = replace(mission, trajectory=replace(mission.trajectory, **changes))
    note = out_of_reach(load_settings(None, settings), load_body("paper_quad"), mission)
    if needed is None:
        assert note == ""
    else:
        assert f"the {name} needs {needed:.1f} m/s2 at 8 m/s" in note and "limits.tilt_deg 45" in note


@pytest.mark.parametrize(
    ("speed", "legs", "usable"),
    [
        (4.0, (300.0,), True),
        (4.0, (300.0, 0.01), True),
        (15.0, (3.0, 3000.0, 0.1, 0.1, 0.1, 200.0), True),
        (4.0, (300.0, 1e-9), False),
        (4.0, (1e-9, 1e-9, 1e-9, 3000.0), False),
        (1.0, (*[1e-3] * 12, 10000.0, 10000.0), False),
    ],
)
def test_waypoints_through_which_no_usable_curve_leads_are_refused(
    speed: float, legs: tuple[float, ...], usable: bool
) -> None:
    """A leg of 1e-9 m after 300 m gave a curve of 588 km, and no word of it. Three before 3 km have none."""
    ends = np.cumsum([length * np.array([0.8, 0.6 * (-1) ** k]) for k, length in enumerate(legs)], axis=0)
    waypoints = [Waypoint(north, east, 3.0) for north, east in ends.tolist()]
    mission = Mission("legs", waypoints=waypoints, profile="minimum_snap", speed=speed, return_home=False)
    if usable:
        check_curves(load_settings(None, []), mission)
    else:
        with pytest.raises(PlanError, match=rf"^waypoints: .* shortest leg has {min(legs):.2g} m"):
            check_curves(load_settings(None, []), mission)


def test_a_vehicle_that_turns_too_slowly_for_its_tilt_is_refused() -> None:
    """At 60 deg/s it swung by 45 degrees to either side from the first waypoint on, and never came to rest there."""
    mission, body, slow = load_mission("hover")[0], load_body("paper_quad"), "limits.roll_pitch_rate_deg=60.0"
    for output in (None, Output.RATES):
        with pytest.raises(PlanError, match=r"roll_pitch_rate_deg 60: on output rates at least 90, as"):
            check(Plan(load_settings(None, [slow]), body, mission, output, 1.0, {}))
    for output in (Output.ATTITUDE, Output.ACTUATORS):
        check(Plan(load_settings(None, [slow]), body, mission, output, 1.0, {}))
    check(Plan(load_settings(None, [slow, "limits.tilt_deg=30.0"]), body, mission, Output.RATES, 1.0, {}))


@pytest.mark.parametrize(
    ("override", "error"),
    [
        ("rates.scan=1", r"scan_timeout 0.5: must be above 1.02 s, as rates.scan is 1 Hz and avoidance.answer_delay"),
        ("rates.position=2", r"supervision.telemetry_timeout 0.5: must be above 0.5 s, as rates.position is 2 Hz"),
        (
            "supervision.scan_timeout=0.07",
            r"above 0.0866667 s, as rates.scan is 15 Hz and avoidance.answer_delay 0.02 s",
        ),
        ("supervision.telemetry_timeout=0.004", r"must be above 0.004 s, as rates.attitude is 250 Hz"),
    ],
)
def test_no_timeout_is_over_before_the_next_message_comes(override: str, error: str) -> None:
    """With one ring a second the vehicle held and went on on the ground, until it disarmed itself."""
    mission, _ = load_mission("errand")
    body = load_body(mission.vehicle)
    with pytest.raises(PlanError, match=error):
        check(Plan(load_settings(None, [override]), body, mission, Output.RATES, 1.0, {}))
    blind = load_settings(None, ["rates.scan=1", "avoidance.method=none"])
    check(Plan(blind, body, mission, Output.RATES, 1.0, {}))


RADIUS = "avoidance.vehicle_radius=0.7"
KEPT = [f"avoidance.guard.keep_out{of}=0.72" for of in ("", "_unseen", "_tight", "_unseen_tight", "_moving")]


@pytest.mark.parametrize(
    ("overrides", "error"),
    [
        ([RADIUS], r"plan.tight_inflation 0.38, .*_moving 0.5: less than avoidance.vehicle_radius 0.7"),
        (["avoidance.guard.keep_out_tight=0.3"], r"keep_out_tight 0.3: less than avoidance.vehicle_radius 0.36"),
        ([RADIUS, "avoidance.plan.inflation=0.9", "avoidance.plan.tight_inflation=0.72", *KEPT], None),
        ([RADIUS, "avoidance.method=paper"], None),
        ([RADIUS, "avoidance.method=none"], None),
        (["avoidance.method=paper", "avoidance.lateral_margin=1.5"], r"lateral_margin 1.5: .* safe_distance, 1.56"),
        (["avoidance.lateral_margin=1.5"], None),
        (["avoidance.guard.keep_out=2.5"], r"guard.keep_out 2.5: .*plan.inflation 0.6 .*plan.proximity_radius 2 "),
        (["avoidance.guard.keep_out=2.5", "avoidance.plan.proximity_radius=2.6"], None),
        (["avoidance.guard.keep_out=2.5", "avoidance.guard.enabled=false"], None),
        (["avoidance.vfh.low_threshold=0.2"], r"low_threshold 0.2: above high_threshold 0.1"),
    ],
)
def test_distances_that_leave_no_room_are_refused(overrides: list[str], error: str | None) -> None:
    """A larger vehicle flew the ways of a small one; the paper's rule hovered before the first lamp."""
    mission, _ = load_mission("errand")
    plan = Plan(load_settings(None, overrides), load_body(mission.vehicle), mission, Output.RATES, 1.0, {})
    if error is None:
        check(plan)
        return
    with pytest.raises(PlanError, match=error):
        check(plan)


def test_a_route_below_what_counts_as_ground_is_refused() -> None:
    """With 5 m the errand's vehicle, 3 m high, saw no obstacle and hit the street lamp."""
    mission, body, high = load_mission("errand")[0], load_body("paper_quad"), "avoidance.ground_height=5.0"
    with pytest.raises(PlanError, match=r"avoidance\.ground_height 5: .* no higher than 3 m"):
        check(Plan(load_settings(None, [high]), body, mission, Output.RATES, 1.0, {}))
    check(Plan(load_settings(None, ["avoidance.ground_height=2.9"]), body, mission, Output.RATES, 1.0, {}))
    check(Plan(load_settings(None, [high, "avoidance.method=none"]), body, mission, Output.RATES, 1.0, {}))


def test_a_vehicle_that_can_not_sink_once_its_parcel_is_gone_is_refused() -> None:
    """The paper's hovers at 0.47 with its parcel, at 0.40 without: with 0.45 at the least it rose to 139 m."""
    mission, _ = load_mission("errand")
    body, high, low = load_body("paper_quad"), "limits.lowest_thrust=0.45", "limits.lowest_thrust=0.35"
    check(Plan(load_settings(None, [low]), body, mission, Output.RATES, 1.0, {}))
    with pytest.raises(PlanError, match=r"lowest_thrust 0\.45: .* 0\.40 once its parcel is gone, .* 0\.36 or less"):
        check(Plan(load_settings(None, [high]), body, mission, Output.RATES, 1.0, {}))
