"""The settings of logs that were flown when some had other names."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from companion.config import Settings
from companion.logs.recorded import flown_overrides, open_flight
from companion.logs.settings import recorded_settings
from companion.renamed_settings import RENAMED_SETTINGS
from companion.runtime.files import load_settings
from companion.view.gather import GatheredFlight
from companion.view.mapping import avoidance_of
from companion.view.report import compose
from protocol.flightlog import FlightLogError, LogReader
from protocol.toml_files import TomlFileError, with_new_names
from tests.companion.logs.changed_logs import rewritten
from tests.golden.golden import path_of

ROOT = Path(__file__).resolve().parents[3]
OLD_NAMES = {new: old for old, new in RENAMED_SETTINGS.items()}
OVERRIDES = ["avoidance.plan.doubt = 120.0", "avoidance.heights.above=4", "mission.speed=3.0", "rates.scan=10"]


@pytest.fixture
def old_log(tmp_path: Path) -> Path:
    """A golden flight, with settings by their old names, one of them changed."""

    def attachment(name: str, content: bytes) -> bytes:
        if name != "settings.json":
            return content
        settings = with_new_names(json.loads(content), RENAMED_SETTINGS)
        settings["avoidance"]["plan"]["unconfirmed_cost"] = 120.0
        return msgspec.json.encode(with_new_names(settings, OLD_NAMES))

    flight = {"overrides": json.dumps(OVERRIDES)}
    return rewritten(path_of("rates_lockstep"), tmp_path / "old.mcap", flight=flight, attachment=attachment)


def old_settings(log: Path) -> dict[str, Any]:
    return json.loads(LogReader(log).attachments["settings.json"])  # type: ignore[no-any-return]


def test_an_old_log_is_read_by_the_new_names(old_log: Path) -> None:
    assert old_settings(old_log)["avoidance"]["plan"]["doubt"] == 120.0
    flight = open_flight(old_log)
    plain = open_flight(path_of("rates_lockstep")).settings
    plan = msgspec.structs.replace(plain.avoidance.plan, unconfirmed_cost=120.0)
    avoidance = msgspec.structs.replace(plain.avoidance, plan=plan)
    assert flight.settings == msgspec.structs.replace(plain, avoidance=avoidance)
    assert flight.mission.speed == 3.0
    assert flown_overrides(flight.log) == [
        "avoidance.plan.unconfirmed_cost= 120.0",
        "avoidance.altitude_search.max_climb=4",
        *OVERRIDES[2:],
    ]
    assert open_flight(old_log, overrides=["avoidance.plan.tight_cost=70.0"]).settings.avoidance.plan.tight_cost == 70.0


def test_an_old_name_for_what_if_is_refused(old_log: Path) -> None:
    with pytest.raises(TomlFileError, match=r"avoidance\.plan\.doubt is now avoidance\.plan\.unconfirmed_cost"):
        open_flight(old_log, overrides=["avoidance.plan.doubt=100.0"])


def test_an_old_log_is_shown_by_the_new_names(old_log: Path) -> None:
    changed = {key: value for key, value, _ in compose(GatheredFlight(old_log)).changed}
    assert changed["avoidance.plan.unconfirmed_cost"] == "120.0" and not changed.keys() & RENAMED_SETTINGS.keys()
    settings = LogReader(old_log).attachments["settings.json"]
    assert avoidance_of(settings).plan.unconfirmed_cost == 120.0


def test_every_new_name_is_a_setting_and_no_old_one_is() -> None:
    tables = msgspec.to_builtins(Settings())

    def there(key: str) -> bool:
        found: Any = tables
        for part in key.split("."):
            if not isinstance(found, dict) or part not in found:
                return False
            found = found[part]
        return True

    for old, new in RENAMED_SETTINGS.items():
        assert there(new) and not there(old), old
        assert new not in RENAMED_SETTINGS
    assert with_new_names(tables, RENAMED_SETTINGS) == tables
    assert len(OLD_NAMES) == len(RENAMED_SETTINGS)


def test_a_log_of_before_a_setting_is_flown_again_as_without_it(tmp_path: Path) -> None:
    """Its vehicle sent ODOMETRY, which nobody listened to, and nobody made up for a torque."""

    def attachment(name: str, content: bytes) -> bytes:
        if name != "settings.json":
            return content
        settings = json.loads(content)
        settings["rates"].pop("odometry", None)
        for name in ("torque_bandwidth", "velocity_settling", "climb_uncertainty"):
            settings["control"]["estimation"].pop(name, None)
        return msgspec.json.encode(settings)

    log = rewritten(path_of("rates_lockstep"), tmp_path / "before.mcap", attachment=attachment)
    before, today = open_flight(log).settings, load_settings(None, [])
    assert before.rates.odometry == before.control.estimation.torque_bandwidth == 0.0
    assert before.control.estimation.velocity_settling == before.control.estimation.climb_uncertainty == 0.0
    assert before.control.estimation.velocity_noise == today.control.estimation.velocity_noise
    assert open_flight(log, overrides=["rates.odometry=20"]).settings.rates.odometry == 20.0
    assert today.rates.odometry > 0.0 and today.control.estimation.torque_bandwidth > 0.0


def test_the_first_logs_are_flown_again_without_all_that_came_later() -> None:
    flown, today = recorded_settings({}, "a log"), load_settings(None, [])
    assert flown.supervision.stray_distance > 1e6 > today.supervision.stray_distance
    assert flown.trajectory.max_lead > 1e6 > today.trajectory.max_lead
    maps = flown.avoidance.map, today.avoidance.map
    assert [(each.keeps_free, each.beyond_window) for each in maps] == [(False, False), (True, True)]
    assert flown.avoidance.altitude_search.edge_distance > 1e6 > today.avoidance.altitude_search.edge_distance
    assert flown.avoidance.tracks.hidden_scans == 0 < today.avoidance.tracks.hidden_scans
    assert flown.avoidance.guard.emergency_braking == 0.0 < today.avoidance.guard.emergency_braking


@pytest.mark.parametrize(("content", "words"), [(b"", "an empty file"), (b"hello", "neither a flight log")])
def test_what_is_no_log_is_no_flight(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(FlightLogError, match=words):
        open_flight(path)


def test_a_telemetry_log_is_no_flight_that_could_be_flown_again() -> None:
    with pytest.raises(FlightLogError, match=r"px4_offboard\.tlog: a telemetry log"):
        open_flight(ROOT / "tests" / "data" / "px4_offboard.tlog")


@pytest.mark.parametrize("depth", [400, 950, 3000])
@pytest.mark.parametrize(("opened", "closed"), [(b'{"a":', b"}"), (b"[", b"]")])
def test_settings_without_end_are_none(tmp_path: Path, depth: int, opened: bytes, closed: bytes) -> None:
    """A report shows the flight without them; they are not flown again."""
    settings = b'{"avoidance": ' + opened * depth + b"1" + closed * depth + b"}"
    log = rewritten(
        path_of("rates_lockstep"),
        tmp_path / "deep.mcap",
        lambda record: [record] if record.time_ns < 10**8 else [],
        attachment=lambda name, content: settings if name == "settings.json" else content,
    )
    assert GatheredFlight(log).settings == Settings() and avoidance_of(settings) == Settings().avoidance
    assert compose(GatheredFlight(log)).title
    with pytest.raises((FlightLogError, TomlFileError), match=r"deep\.mcap, settings\.json: "):
        open_flight(log)


@pytest.mark.parametrize("name", ["mission.toml", "vehicle.toml"])
@pytest.mark.parametrize("text", [b"a = " + b"[" * 3000 + b"]" * 3000, b"a" + b".a" * 3000 + b" = 1"])
def test_tables_without_end_are_refused_with_their_name(tmp_path: Path, name: str, text: bytes) -> None:
    def attachment(each: str, content: bytes) -> bytes:
        return text if each == name else content

    log = rewritten(path_of("rates_lockstep"), tmp_path / "deep.mcap", lambda record: [], attachment=attachment)
    with pytest.raises((FlightLogError, TomlFileError), match=rf"deep\.mcap, {name}: "):
        open_flight(log)
