"""`companion check`: the vehicle's parameters and the verdict, without a flight."""

import json

import pytest
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.shell import FAILED, UNUSABLE
from companion.runtime import side_links
from companion.runtime.check import Examination, examine
from companion.runtime.files import load_settings
from companion.state import Output, Safety
from protocol import toml_files
from protocol.framing import Framer
from protocol.messages import dialect
from tests.companion.runtime.hop import InMemory
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

SETTINGS = load_settings(None, [])
IMPATIENT = "supervision.find_timeout=0.05"
NEVER_SENT = {
    dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    dialect.MAVLINK_MSG_ID_PARAM_SET,
}


class Listened(InMemory):
    """The simulated vehicle in memory; what it was sent."""

    def __init__(self) -> None:
        airframe = Airframe.load(toml_files.find("vehicles", "paper_quad"), ())
        self.vehicle = Vehicle(airframe, World.load(toml_files.find("worlds", "empty"), ()), lockstep=True)
        super().__init__(self.vehicle, None)
        self.sent: set[int] = set()

    def send(self, data: bytes) -> None:
        self.sent |= {frame.message_id for frame in Framer().datagram(data)}
        super().send(data)


class Nobody:
    peer = ""
    preserves_datagrams = True

    def receive(self, timeout_s: float) -> bytes | None:
        return None

    def send(self, data: bytes) -> None:
        raise AssertionError("nobody is there")

    def lock(self) -> None: ...

    def close(self) -> None: ...


def test_a_vehicle_is_examined_and_nothing_else_is_done_to_it() -> None:
    link = Listened()
    found = examine(SETTINGS, None, link)
    assert found.vehicle == "PX4 1.16.0" and found.refusal is None and found.output is Output.ATTITUDE
    assert {each.parameter: each.safety for each in found.findings}["COM_OF_LOSS_T"] is Safety.SAFE
    assert dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ in link.sent and not link.sent & NEVER_SENT
    assert not link.vehicle.flight.armed


class Deaf(Listened):
    """A line of which one way alone is whole."""

    def send(self, data: bytes) -> None: ...


class Nameless(Listened):
    """It does not tell its version."""

    def receive(self, timeout_s: float) -> bytes | None:
        data = super().receive(timeout_s)
        frames = [] if data is None else Framer().datagram(data)
        version = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        return None if data is None else b"".join([frame.raw for frame in frames if frame.message_id != version])


@pytest.mark.parametrize(("link", "why"), [(Deaf, "has answered nothing"), (Nameless, "does not say its version")])
def test_a_vehicle_that_would_not_be_flown_for_what_it_does_not_answer_is_refused(
    monkeypatch: pytest.MonkeyPatch, link: type[Listened], why: str
) -> None:
    monkeypatch.setattr(side_links, "open_link", lambda url: link())
    said = CliRunner().invoke(app, ["check", "--set", "supervision.command_interval=0.01"])
    assert said.exit_code == FAILED and why in said.output


def test_nobody_answers() -> None:
    found = examine(load_settings(None, [IMPATIENT]), None, Nobody())
    assert found == Examination("", (), Output.ATTITUDE, "no vehicle within 0.05 s")


def test_the_command_prints_a_table_or_json(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_links, "open_link", lambda url: Listened())
    shown = CliRunner().invoke(app, ["check"], env={"COLUMNS": "200"})
    assert shown.exit_code == 0
    for words in ("PX4 1.16.0", "COM_OF_LOSS_T", "at most 1 s", "safe"):
        assert words in shown.output
    whole = json.loads(CliRunner().invoke(app, ["check", "--json", "--output", "rates"]).output)
    assert whole["output"] == "rates" and whole["refusal"] is None
    assert {"parameter", "value", "wanted", "why", "verdict"} == set(whole["findings"][0])


def test_the_command_fails_without_a_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_links, "open_link", lambda url: Nobody())
    failed = CliRunner().invoke(app, ["check", "--set", IMPATIENT])
    assert failed.exit_code == FAILED and "no vehicle within" in failed.output and "is the vehicle on" in failed.output
    alone = CliRunner().invoke(app, ["check", "--set", IMPATIENT, "--vehicle", "7"])
    assert "is the vehicle on" in alone.output and "only system 7 is waited for (--vehicle" in alone.output
    assert "only system" not in failed.output


def test_the_command_knows_the_names_of_links() -> None:
    failed = CliRunner().invoke(app, ["check", "--connect", "px5"])
    assert failed.exit_code == UNUSABLE and "px4" in failed.output and "ardupilot" in failed.output
