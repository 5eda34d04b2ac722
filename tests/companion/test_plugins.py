"""Laws and planners of other packages."""

import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

import msgspec
import numpy as np
import pytest

from companion import plugins
from companion.avoidance.methods import path_planner
from companion.control.controller import RATES, TORQUE, Controller
from companion.entering import follow_output
from companion.link.vehicle_link import VehicleLink
from companion.logs.info import info
from companion.logs.recorded import open_flight
from companion.logs.replay import replay
from companion.outcomes import Outcome
from companion.outputs import encoders
from companion.perception.map_view import MapView
from companion.plugins import Options, PluginError
from companion.reports import LinkDelay
from companion.runtime import flight
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.flight import Pace, Plan, Result, fly, planner_to_rehearse_with, prepare
from companion.runtime.planning import InProcessPlanner, PlannerProcess
from companion.runtime.plugin_time import refuse_slow_plugins
from companion.runtime.rehearsal import OpenField, rehearse
from companion.state import Output, Reference, Setpoint, VehicleState
from protocol import toml_files
from protocol.framing import Framer
from protocol.messages import Encoder, decode
from protocol.toml_files import TomlFileError
from protocol.vehicle_parameters import GRAVITY
from tests.companion.broken_package import broken_package
from tests.companion.installed import EXAMPLE, installed
from tests.companion.runtime.hop import InMemory
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

ALL = (
    "control.position.law=saturated",
    "control.attitude.law=cascade",
    "control.output.message=both",
    "avoidance.method=detour",
)
SMALL_MAP = ("avoidance.map.cells=160", "avoidance.map.cell=0.25")
READY_S = 60.0
PACKAGE = "courier-example 0.1.0"


def flown(folder: Path, overrides: tuple[str, ...]) -> Result:
    """The errand, with the vehicle in memory."""
    mission, file = load_mission("errand")
    files = {
        "mission": file,
        "vehicle": toml_files.find("vehicles", mission.vehicle),
        "world": toml_files.find("worlds", mission.world),
    }
    vehicle = Vehicle(Airframe.load(files["vehicle"]), World.load(files["world"]), seed=1, lockstep=True)
    settings = load_settings(None, [*overrides, *SMALL_MAP])
    plan = Plan(settings, load_body(mission.vehicle), mission, Output.RATES, "lockstep", files, overrides=overrides)
    return fly(plan, InMemory(vehicle), folder, console=False)


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed(EXAMPLE, tmp_path_factory.mktemp("site")):
        yield


@pytest.fixture(scope="module")
def delivery(example: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a delivery by the example's laws, planner and output."""
    result = flown(tmp_path_factory.mktemp("flight"), ALL)
    assert result.verdict.outcome is Outcome.DELIVERED
    return result.log


def test_a_foreign_law_and_a_foreign_planner_deliver_and_fly_again_to_the_byte(delivery: Path) -> None:
    again = replay(delivery)
    assert again.differences == [] and again.datagrams > 1000 and again.notes == []
    flight = info(delivery).flight
    assert flight["position law"] == f'"saturated" of {PACKAGE}' and flight["planner"] == f'"detour" of {PACKAGE}'
    assert flight["attitude law"] == f'"cascade" of {PACKAGE}' and flight["output message"] == f'"both" of {PACKAGE}'
    assert flight["output"] == "rates"


def test_what_a_plugin_prints_leaves_standard_output_to_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    talks = EntryPoint("talks", "builtins:print", plugins.Kind.PLANNER.group)
    with pytest.raises(PluginError, match="has no method"):
        plugins.Plugin(plugins.Kind.PLANNER, "talks", "talkative 1", talks).make("made", {})
    assert capsys.readouterr() == ("", "made\n")


def test_a_replay_without_the_package_says_what_is_missing(delivery: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugins.installed.cache_clear()
    monkeypatch.setattr(plugins, "entry_points", lambda group: ())
    with pytest.raises(TomlFileError) as refused:
        open_flight(delivery)
    flew = ('position law "saturated"', 'attitude law "cascade"', 'planner "detour"', 'output message "both"')
    assert str(refused.value).endswith(" and the ".join(f"{each} of {PACKAGE}" for each in flew))
    overrides = ["control.position.law=pid", "control.attitude.law=lqr", "avoidance.method=none"]
    overrides += ["control.output.message=standard"]
    assert open_flight(delivery, overrides=overrides).settings.plugins == ()
    plugins.installed.cache_clear()


def test_an_unknown_name_is_refused_with_what_is_installed(example: None) -> None:
    for override, names in (
        ("control.position.law=saturate", ("pid", "saturated")),
        ("control.attitude.law=cascades", ("lqr", "cascade")),
        ("control.output.message=bot", ("standard", "both")),
        ("avoidance.method=detours", ("astar", "detour")),
    ):
        with pytest.raises(TomlFileError) as refused:
            load_settings(None, [override])
        assert all(f'"{name}"' in str(refused.value) for name in names)


def test_an_attitude_law_turns_the_vehicle_within_the_limits(example: None) -> None:
    """The position law wants the vehicle to tilt; the example asks for `angle_gain` times the angle."""
    sideways = np.zeros((6, 3))
    sideways[2, 1] = 1.0
    upright = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    rolls, pushes = {}, {}
    for gain in (3.0, 6.0, 600.0):
        flies = controller(
            "control.attitude.law=cascade",
            f"control.attitude.options.angle_gain={gain}",
            "control.attitude.feedforward=false",
            "control.attitude.options.rate_gain=2.0",
        )
        flies.acceleration_command(upright, 4_000_000, 0, Reference(sideways), 1.0, airborne=False)
        control, _ = flies.attitude_command(np.array([0.0, 1.0, 0.0]), 4_000_000, Reference(sideways), 1.0)
        rolls[gain] = control[RATES][0]
        assert flies._memory["commands"][0, 0]["input"] == pytest.approx(control[RATES]), "predicted with"
        flies.use(Output.ACTUATORS)
        control, _ = flies.attitude_command(np.array([0.0, 1.0, 0.0]), 8_000_000, Reference(sideways), 1.0)
        pushes[gain] = flies._memory["commands"][0, 1]["input"][0]
        assert control[TORQUE][0] > 0.0
    angle = np.arctan2(1.0, GRAVITY)
    assert rolls[3.0] == pytest.approx(3.0 * angle) and rolls[6.0] == pytest.approx(6.0 * angle)
    assert pushes[3.0] == pytest.approx(2.0 * rolls[3.0]) and pushes[6.0] == pytest.approx(2.0 * rolls[6.0])
    assert rolls[600.0] <= np.radians(load_settings(None).limits.roll_pitch_rate_deg) + 1e-9


def test_options_are_the_factorys(example: None) -> None:
    far = np.zeros((6, 3))
    far[0, 0], far[2] = 100.0, (0.0, 0.5, 0.0)
    here = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    for limit in (2.0, 4.0):
        flies = controller("control.position.law=saturated", f"control.position.options.limit={limit}")
        command = flies.acceleration_command(here, 4_000_000, 0, Reference(far), 1.0, airborne=False)
        assert command == pytest.approx([limit, 0.5, 0.0]), "its own command, and nothing else's"
    with pytest.raises(PluginError, match=f'position law "saturated" of {PACKAGE}: .*gain'):
        controller("control.position.law=saturated", "control.position.options.gain=1")
    with pytest.raises(TomlFileError, match="options"):
        load_settings(None, ["control.position.options.gain=1"])


@pytest.fixture
def broken(tmp_path: Path) -> Iterator[None]:
    with broken_package(tmp_path):
        yield


def controller(*overrides: str) -> Controller:
    return Controller(load_settings(None, list(overrides)), load_body("paper_quad"), Output.RATES)


def test_a_broken_law_is_named_and_stops_no_flight_but_its_own(broken: None) -> None:
    for name, options, words in (
        ("not_there", "", "AttributeError"),
        ("broken", "", "ZeroDivisionError"),
        ("broken", "control.position.options.answer=exit", r"SystemExit\(3\) at broken:\d+$"),
        ("broken", "control.position.options.answer=panic", r"BaseException\('panic'\) at broken:\d+$"),
        ("broken", 'control.position.options.answer="nan"', r"an acceleration of \[nan nan nan\] m/s2$"),
        (
            "broken",
            'control.position.options.answer="huge"',
            r"an acceleration of \[-1\.e\+300 .*\] m/s2$",
        ),
        ("broken", "control.position.options.answer=1.0", r"shape \(\) in place of \(3,\)"),
    ):
        with pytest.raises(PluginError, match=f'^position law "{name}" of broken 1: .*{words}'):
            asked = [f"control.position.law={name}", *filter(None, [options])]
            controller(*asked).follow(LinkDelay(command=0.1))
    controller("control.position.law=pid").follow(LinkDelay(command=0.1))


@pytest.mark.parametrize("kind", ["position", "attitude"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("forgetful", r"Forgetful has no method reset\(\)$"),
        ("stuck", r"RuntimeError\('stuck'\) at broken:\d+$"),
        ("leaves", r"SystemExit\('leaves'\) at broken:\d+$"),
    ],
)
def test_a_law_that_can_not_be_begun_is_named(kind: str, name: str, words: str, broken: None) -> None:
    with pytest.raises(PluginError, match=f'^{kind} law "{name}" of broken 1: {words}'):
        controller(f"control.{kind}.law={name}").reset()


@pytest.mark.parametrize(
    ("kind", "table", "key"),
    [
        ("position law", "control.position", "law"),
        ("attitude law", "control.attitude", "law"),
        ("output message", "control.output", "message"),
    ],
)
def test_what_takes_longer_than_a_tick_is_refused_in_real_time(kind: str, table: str, key: str, broken: None) -> None:
    def refuse(takes: float, most_s: float) -> None:
        overrides = [f"{table}.{key}=slow", f"{table}.options.takes={takes}"]
        refuse_slow_plugins(load_settings(None, overrides).control, (Output.RATES,), most_s)

    with pytest.raises(PluginError, match=rf'^{kind} "slow" of broken 1: a step takes \d+\.\d ms, and .* has 4 ms$'):
        refuse(0.005, 0.004)
    refuse(0.001, 1.0)


def test_a_flight_in_real_time_measures_its_plugins(broken: None, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = load_settings(None, ["control.position.law=slow", "avoidance.method=none"])
    monkeypatch.setattr(flight, "rehearse", lambda *arguments: None)
    monkeypatch.setattr(flight, "RecorderProcess", lambda: None)
    plan = Plan(settings, load_body("paper_quad"), load_mission("hover")[0], Output.RATES, 0.5, {})
    measured = []
    monkeypatch.setattr(flight, "refuse_slow_plugins", lambda *arguments: measured.append(arguments))
    paces: tuple[Pace, Pace] = "lockstep", 0.5
    for pace in paces:
        prepare(replace(plan, pace=pace))
    assert measured == [(settings.control, (Output.RATES,), 0.008)]


def test_an_output_without_a_message_is_refused_at_the_start(broken: None) -> None:
    control = load_settings(None, ["control.output.message=forgetful"]).control
    with pytest.raises(PluginError, match=r'^output message "forgetful" of broken 1: Forgetful has no method message'):
        encoders(control)


def test_a_name_that_two_packages_have_is_refused_with_both(broken: None, tmp_path: Path) -> None:
    """Which of them would fly hangs on the order of the path."""
    package, site = tmp_path / "other", tmp_path / "beside"
    package.mkdir()
    site.mkdir()
    (package / "pyproject.toml").write_text(
        '[project]\nname = "other"\nversion = "2"\n'
        '[project.entry-points."courier.position_laws"]\nbroken = "broken:law"\npid = "broken:law"\n'
    )
    with installed(package, site):
        with pytest.raises(TomlFileError, match="'broken': other 2 and broken 1 have a position law of this name"):
            load_settings(None, ["control.position.law=broken"])
        assert load_settings(None, ["control.position.law=stuck"]).control.position.plugin is not None
        assert load_settings(None, ["control.position.law=pid"]).control.position.plugin is None, "it is built in"


def test_a_broken_attitude_law_is_named(broken: None) -> None:
    level = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    still = Reference(np.zeros((6, 3)))
    for options, words in (
        (["control.attitude.law=broken"], "ZeroDivisionError"),
        (["control.attitude.law=broken", "control.attitude.options.answer=exit"], "SystemExit"),
        (["control.attitude.law=broken", "control.attitude.options.answer=1.0"], r"\(3,\) and \(\) in place of"),
        (["control.attitude.law=broken", 'control.attitude.options.answer="nan"'], r"and \[nan nan nan\] rad/s2$"),
        (["control.attitude.law=broken", 'control.attitude.options.answer="huge"'], r"and \[-1\.e\+300 .*\] rad/s2$"),
    ):
        flies = controller(*options)
        acceleration = flies.acceleration_command(level, 4_000_000, 0, still, 1.0, airborne=False)
        with pytest.raises(PluginError, match=f'^attitude law "broken" of broken 1: .*{words}'):
            flies.attitude_command(acceleration, 4_000_000, still, 1.0)
    with pytest.raises(TomlFileError, match="options"):
        load_settings(None, ["control.attitude.options.angle_gain=1"])


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("sys.exit(3)", "SystemExit"),
        ("[1.0]", "list in place of a Path"),
        ("Path([['a', 'b']], ['c'])", "TypeError"),
        ("Path(np.zeros((2, 3)), np.zeros(2))", "vertices"),
        ("Path(np.zeros((2, 2)), np.zeros(3))", "vertices"),
        ("Path(np.full((2, 2), np.nan), np.zeros(2))", "not finite"),
        ("Path(np.zeros((0, 2)), np.zeros(0), math.inf)", "not finite"),
        ("Path(np.zeros((2, 2)), np.array([speed, 2 * speed]))", "from 0 to 2 m/s"),
        ("Path(np.zeros((2, 2)), np.array([speed, -0.1]))", "from 0 to 2 m/s"),
        ("Path(np.zeros((100_000, 2)), np.zeros(100_000))", "a path of 100000 vertices, where 1365 are the most"),
        ("Path(np.full((2, 2), 1e6), np.zeros(2))", "begins 1414214 m from the vehicle, beyond the map"),
    ],
)
def test_a_path_that_can_not_be_flown_is_refused(answer: str, words: str, broken: None) -> None:
    lines = "import math, sys, numpy as np; from companion.avoidance.path import Path"
    code = f"(exec({lines!r}, globals()), {answer})[1]"
    settings = load_settings(None, ["avoidance.method=broken"]).avoidance
    planner = path_planner("broken", msgspec.structs.replace(settings, options={"answer": code}))
    with pytest.raises(PluginError, match=f'^planner "broken" of broken 1: .*{words}'):
        planner.plan(cast(MapView, None), np.zeros(3), np.zeros(3), np.ones(3), 2.0)


def test_a_planner_of_a_package_is_rehearsed_where_its_fault_can_be_said(broken: None) -> None:
    body, mission = load_body("paper_quad"), load_mission("hover")[0]

    def planner(method: str, pace: Pace) -> object:
        settings = load_settings(None, [f"avoidance.method={method}"])
        return planner_to_rehearse_with(Plan(settings, body, mission, Output.RATES, pace, {}))

    assert planner("astar", 1.0) is OpenField and planner("astar", "lockstep") is InProcessPlanner
    assert planner("broken", 1.0) is InProcessPlanner
    settings = load_settings(None, ["avoidance.method=broken", "avoidance.map.cells=128"])
    with pytest.raises(PluginError, match=r'^planner "broken" of broken 1: SyntaxError'):
        rehearse(settings, body, load_mission("errand")[0], Output.RATES)


SETPOINT = Setpoint([1.0, 0.0, 0.0, 0.0], [0.2, -0.1, 0.4], [0.0, 0.0, 0.0], 0.4)


@pytest.mark.parametrize(("message", "output"), [("standard", Output.ATTITUDE), ("both", Output.RATES)])
def test_over_a_late_link_an_output_of_a_package_stays_what_it_is(example: None, message: str, output: Output) -> None:
    """Its message may be made for that output alone."""
    settings = load_settings(None, [f"control.output.message={message}"])
    link = VehicleLink(settings, Output.RATES)
    controller = Controller(settings, load_body("paper_quad"), Output.RATES)
    link.delays.known = LinkDelay(age=0.1, command=0.1)
    follow_output(link, controller, 0, airborne=True)
    assert controller.output is link.outbox.output is output


def test_an_output_makes_the_message(example: None) -> None:
    control = load_settings(None, ["control.output.message=both", "control.output.options.share=0.5"]).control
    message, fields = encoders(control)(Output.ATTITUDE)(SETPOINT, 7, (1, 1))
    sent = decode(Framer().datagram(Encoder(1, 191).encode_fields(message, *fields))[0])
    assert sent is not None and sent.type_mask == 0 and sent.time_boot_ms == 7 and sent.q == [1.0, 0.0, 0.0, 0.0]
    rates = sent.body_roll_rate, sent.body_pitch_rate, sent.body_yaw_rate
    assert rates == pytest.approx((0.1, -0.05, 0.2)) and sent.thrust == pytest.approx(0.4)
    with pytest.raises(PluginError, match=f'^output message "both" of {PACKAGE}: .*not for --output actuators'):
        encoders(control)(Output.ACTUATORS)(SETPOINT, 7, (1, 1))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("7", "TypeError"),
        ("exit(3)", "SystemExit"),
        ("(dialect.MAVLink_command_long_message, (1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))", "COMMAND_LONG is no setpoint"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 0, [1, 0, 0, nan], 0, 0, 0, 0))", "nan"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 0, [1, 0, 0, 0], 0, 0, nan, 0))", "nan"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0))", "TypeError"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 0, [1, 0, 0], 0, 0, 0, 0))", "q"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 256, [1, 0, 0, 0], 0, 0, 0, 0))", "type_mask"),
        ("(dialect.MAVLink_set_attitude_target_message, (0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 1e39))", "thrust"),
    ],
)
def test_what_is_no_sound_setpoint_is_not_sent(answer: str, words: str, broken: None) -> None:
    control = load_settings(
        None, ["control.output.message=broken", f"control.output.options.answer={answer!r}"]
    ).control
    with pytest.raises(PluginError, match=f'^output message "broken" of broken 1: .*{words}'):
        encoders(control)(Output.ATTITUDE)(SETPOINT, 0, (1, 1))


def test_the_planners_process_has_it_too(example: None) -> None:
    planner = PlannerProcess(load_settings(None, ["avoidance.method=detour", *SMALL_MAP]).avoidance)
    with closing(planner):
        assert planner.take(READY_S) is None and planner.ready and planner.fault is None


@pytest.mark.parametrize("answer", ["[[0, 0], [2, 1]], [2, 0]", "np.array([[0, 0], [2, 1]]), np.array([2, 0])"])
def test_a_path_of_a_package_comes_in_the_arrays_that_the_loop_is_compiled_for(answer: str, broken: None) -> None:
    """What follows a path would be compiled anew in the air, or fails."""
    lines = "import numpy as np; from companion.avoidance.path import Path"
    options: Options = {"answer": f"(exec({lines!r}, globals()), Path({answer}))[1]"}
    settings = load_settings(None, ["avoidance.method=broken"]).avoidance
    planner = path_planner("broken", msgspec.structs.replace(settings, options=options))
    path = planner.plan(cast(MapView, None), np.zeros(3), np.zeros(3), np.ones(3), 2.0)
    assert path is not None and path.vertices.tolist() == [[0.0, 0.0], [2.0, 1.0]]
    for array in (path.vertices, path.speeds):
        assert array.dtype == np.float64 and array.flags.c_contiguous
    assert path.speeds.tolist() == [2.0, 0.0]


def test_the_page_shows_the_example_as_it_is_flown() -> None:
    page = (EXAMPLE.parents[1] / "docs" / "extend.md").read_text()
    blocks = re.findall(r"^```(?:toml|python)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    files = ["pyproject.toml", *(f"courier_example/{name}.py" for name in ("law", "attitude", "planner", "output"))]
    assert blocks == [(EXAMPLE / file).read_text() for file in files]
