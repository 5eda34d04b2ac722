"""A whole flight from its plan to its log, with the simulated vehicle in memory."""

import codecs
import os
import subprocess
import time
from pathlib import Path

import pytest

from companion.logs.info import info
from companion.outcomes import Outcome, Testimony, Verdict
from companion.runtime import flight
from companion.runtime.files import load_body, load_settings
from companion.runtime.flight import Plan, Result, fly, new_folder
from companion.state import Output
from protocol import toml_files
from protocol.flightlog import TEXT, FlightLogError, LogReader
from tests.companion.runtime.hop import OVERRIDES, InMemory, hop_in
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World


class Falls(InMemory):
    """The vehicle hits something as soon as it lands."""

    def receive(self, timeout_s: float) -> bytes | None:
        if self._vehicle.flight.mode is Mode.LAND:
            self._vehicle.flight.collide("ground")
        return super().receive(timeout_s)


def flown(folder: Path, link: type[InMemory], testimony: Testimony | None = None) -> Result:
    mission = hop_in(folder)
    files = {
        "mission": folder / "hop.toml",
        "vehicle": toml_files.find("vehicles", mission.vehicle),
        "world": toml_files.find("worlds", mission.world),
    }
    vehicle = Vehicle(Airframe.load(files["vehicle"]), World.load(files["world"]), seed=1, lockstep=True)
    body, settings = load_body(mission.vehicle), load_settings(None, list(OVERRIDES))
    plan = Plan(settings, body, mission, Output.RATES, "lockstep", files)
    witness = None if testimony is None else lambda: testimony
    return fly(plan, link(vehicle), folder, console=False, witness=witness)


def said(log: Path) -> list[str]:
    return [TEXT.unpack(record.data)["message"] for record in LogReader(log).records((TEXT.topic,))]


def test_a_crash_that_the_vehicle_tells_of_is_no_landing(tmp_path: Path) -> None:
    before = time.time()
    result = flown(tmp_path, Falls)
    assert result.verdict == Verdict(Outcome.CRASHED, "hit ground")
    assert result.landed is False and result.delivered is None
    found = info(result.log)
    assert found.verdict == result.verdict and found.result["landed"] == "False" and "delivered" not in found.result
    assert said(result.log)[-1] == "outcome: crashed: hit ground"
    began = LogReader(result.log).epoch_ns * 1e-9
    assert before <= began <= time.time() and found.started_unix_s is not None, "a date, in lockstep too"
    assert abs(found.started_unix_s - began) < 1e-3


def test_what_the_simulator_saw_is_in_the_log(tmp_path: Path) -> None:
    result = flown(tmp_path, InMemory, Testimony("tree", 1, -0.0123))
    assert result.verdict.text == "crashed: hit tree" and result.landed is False
    found = info(result.log)
    assert found.verdict == result.verdict
    assert (found.result["contacts"], found.result["least_clearance_m"]) == ("1", "-0.012")
    assert said(result.log)[-2:] == ["landed and disarmed", "outcome: crashed: hit tree"]


def test_files_are_in_the_log_without_a_byte_order_mark(tmp_path: Path) -> None:
    """Replay, report and page read them there."""
    mission, path = hop_in(tmp_path), tmp_path / "hop.toml"
    plain = path.read_bytes()
    path.write_bytes(codecs.BOM_UTF8 + plain)
    files = {"mission": path, "vehicle": toml_files.find("vehicles", mission.vehicle)}
    plan = Plan(load_settings(None), load_body(mission.vehicle), mission, Output.RATES, "lockstep", files)
    assert flight._attachments(plan)["mission.toml"] == plain


def test_the_log_has_the_checkout_s_hash_and_its_index_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flight that is killed while it holds the lock of the index would keep its user from committing."""

    def git(*words: str) -> str:
        own = ("-c", "user.name=a", "-c", "user.email=a@b")
        return subprocess.run(("git", "-C", tmp_path, *own, *words), check=True, capture_output=True, text=True).stdout

    file, index = tmp_path / "file", tmp_path / ".git" / "index"
    monkeypatch.setattr(toml_files, "ROOT", tmp_path)
    assert flight.git_hash() == ""
    git("init")
    file.write_text("a")
    git("add", "file")
    git("commit", "-m", "a")
    os.utime(file, (1.0, 1.0))
    before = index.read_bytes()
    head = git("rev-parse", "HEAD").strip()
    assert flight.git_hash() == head and len(head) == 40
    assert index.read_bytes() == before
    file.write_text("b")
    assert flight.git_hash() == head + "+"


def test_flights_that_start_together_have_folders_of_their_own(tmp_path: Path) -> None:
    """Two companions of a machine, the second before the first one's log is there."""
    made = [new_folder(tmp_path / "logs", "hop", 1e9).name for _ in range(3)]
    assert len(set(made)) == 3 and all(name.startswith(made[0]) for name in made)
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere" / "at all")
    (tmp_path / "file").touch()
    for place in ("gone", "file"):
        assert new_folder(tmp_path / place, "hop", 1e9).name == made[0], "the log says what is wrong with that"


def test_a_log_that_can_not_be_made_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object, **options: object) -> None:
        raise FlightLogError("0 MB free")

    monkeypatch.setattr("companion.runtime.flight.FlightLog.open", full)
    (tmp_path / "plan").mkdir()
    with pytest.raises(FlightLogError):
        flown(tmp_path / "plan", InMemory)
    assert [path for path in (tmp_path / "plan").iterdir() if path.is_dir()] == []
