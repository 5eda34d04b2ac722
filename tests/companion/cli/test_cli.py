"""What the command line says: at an interrupt, of a log's result, and of a file that can't be used."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.flights import _exit_by
from companion.cli.shell import exit_on_interrupt
from companion.outcomes import Outcome, Verdict
from companion.runtime.side_links import Security, open_side_links, open_vehicle_link
from protocol.guarded_link import inmost
from protocol.transport import TransportError, Udp
from tests.companion.view.made_logs import make


@pytest.mark.parametrize(
    ("function", "command", "flies"),
    [
        ("companion.runtime.demo.prepare", ["demo", "hover"], False),
        ("companion.runtime.flight.prepare", ["fly", "hover", "--connect", "udpin:127.0.0.1:0"], False),
        ("companion.runtime.flight.fly", ["fly", "hover", "--connect", "udpin:127.0.0.1:0"], True),
    ],
)
def test_of_a_vehicle_in_the_air_only_a_flight_speaks(
    function: str, command: list[str], flies: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.runtime.flight.prepare", lambda plan: plan)
    monkeypatch.setattr(function, interrupted)
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 130 and "companion: abandoned" in done.output
    assert ("in the air" in done.output) == flies


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_a_destructor_swallows_is_one() -> None:
    """Python goes on after an exception in it; a flight must not."""

    class Library:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    reached, before = [], signal.signal(signal.SIGINT, signal.default_int_handler)  # which the tests' own may ignore
    try:
        with pytest.raises(typer.Exit) as ended, exit_on_interrupt("companion: abandoned"):
            Library()
            reached.append("what is left of the block")
        assert ended.value.exit_code == 130 and reached
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_interrupt_that_is_ignored_stays_so() -> None:
    """A job in the background of a script."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with exit_on_interrupt("companion: abandoned"):
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_after_a_flight_a_full_disk_behind_standard_output_ends_nothing() -> None:
    program = """
import typer
from companion.cli.shell import say, told_if_there_is_room
with told_if_there_is_room():
    typer.echo("the result")
typer.echo("the report")
say("the outcome")
"""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", program], stdout=full, stderr=subprocess.PIPE, text=True)
        assert subprocess.run([sys.executable, "-c", program], stdout=subprocess.DEVNULL, stderr=full).returncode == 0
    assert done.returncode == 0
    assert done.stderr == "companion: standard output: No space left on device\nthe outcome\n"


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_program_may_be_started_without_standard_files(closed: str, tmp_path: Path) -> None:
    """The first files that it opens do not get their numbers."""
    log, out = make(tmp_path, 0.2), tmp_path / "numbers"
    command = shlex.join([sys.executable, "-m", "companion", "info", str(log)])
    assert subprocess.run(["sh", "-c", f"exec {command} {closed}"], stdout=subprocess.DEVNULL).returncode == 0
    program = f"""
from protocol.standard_files import open_closed
open_closed()
with open({str(out)!r}, "w") as file:
    print(file.fileno(), file=file)
print("nowhere")
"""
    command = shlex.join([sys.executable, "-c", program])
    assert subprocess.run(["sh", "-c", f"exec {command} {closed}"], stdout=subprocess.DEVNULL).returncode == 0
    assert int(out.read_text()) > 2


@pytest.mark.parametrize(
    "command", [["view", "udpin:0.0.0.0:1", "--no-open"], ["play", "LOG", "--to", "tcpin:0.0.0.0:1"]]
)
def test_no_command_listens_beyond_this_machine_unless_told_to(command: list[str], tmp_path: Path) -> None:
    log = str(make(tmp_path, 0.2))
    done = CliRunner().invoke(app, [log if word == "LOG" else word for word in command])
    assert done.exit_code == 2 and "who can reach this machine could command the vehicle" in done.output


def test_an_interrupted_flight_says_where_its_log_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: Any, opened: Callable[[Path], None], **options: Any) -> None:
        opened(Path("logs/this/flight.mcap"))
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.runtime.flight.prepare", lambda plan: plan)
    monkeypatch.setattr("companion.runtime.flight.fly", interrupted)
    monkeypatch.setattr("companion.runtime.demo.demo", interrupted)
    for command in (["fly", "hover", "--connect", "udpin:127.0.0.1:0"], ["demo", "hover"]):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 130 and done.output.endswith("log, as far as it got: logs/this/flight.mcap\n")


def test_the_link_s_rare_faults_are_listed_only_where_there_were_any(tmp_path: Path) -> None:
    result = {"landed": "True", "messages_lost": "0", "frames_bad": "0", "duplicates": "3", "reboots": "0"}
    result |= {"signing_forged": "2", "signing_ahead": "0"}
    log = make(tmp_path, 0.2, result=result)
    shown = CliRunner().invoke(app, ["info", str(log)])
    assert shown.exit_code == 0
    listed = {" ".join(line.split()[:-1]): line.split()[-1] for line in shown.output.splitlines() if line.strip()}
    assert (listed["messages lost"], listed["duplicates"]) == ("0", "3")
    assert "frames bad" not in listed and "reboots" not in listed
    assert listed["signing forged"] == "2" and "signing ahead" not in listed
    whole = json.loads(CliRunner().invoke(app, ["info", "--json", str(log)]).output)
    assert whole["result"] == result


def test_a_log_that_can_t_be_used_does_not_load_the_autopilot(tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"nothing of the kind")
    code = (
        "import sys; from companion.cli.app import app; sys.argv = ['companion', 'info', sys.argv[1]]\n"
        "try: app()\n"
        "except SystemExit as ended: assert ended.code == 2\n"
        "assert 'companion.autopilot' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code, str(broken)], capture_output=True, text=True, check=True)
    assert done.stderr.startswith(f"companion: {broken}: ") and done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", [["check"], ["fly", "hover", "--connect", "udpin:127.0.0.1:0"]])
def test_an_address_beyond_this_machine_is_refused_without_a_key(command: list[str]) -> None:
    """The address may be the vehicle's, a ground station's or a scanner's."""
    url = "udpin:0.0.0.0:0"
    for option in ("--connect", "--gcs", "--lidar") if command[0] == "fly" else ("--connect",):
        done = CliRunner().invoke(app, [*command, option, url])
        assert done.exit_code == 2
        assert url in done.output and "--signing-key" in done.output and "--insecure" in done.output


def test_a_key_is_made_and_a_bad_one_refused(tmp_path: Path) -> None:
    file = tmp_path / "key"
    assert CliRunner().invoke(app, ["key", str(file)]).exit_code == 0
    assert file.stat().st_mode & 0o777 == 0o600 and len(file.read_bytes()) == 32
    again = CliRunner().invoke(app, ["key", str(file)])
    assert again.exit_code == 2 and str(file) in again.output
    file.chmod(0o644)
    for command in (["fly", "hover"], ["check"]):
        done = CliRunner().invoke(app, [*command, "--connect", "udpin:127.0.0.1:0", "--signing-key", str(file)])
        assert done.exit_code == 2 and "0644" in done.output


@pytest.mark.parametrize("kind", [os.openpty, os.pipe])
def test_whoever_has_gone_does_not_end_what_follows(kind: Callable[[], tuple[int, int]]) -> None:
    """A terminal that hangs up, and a pipe that nobody reads: what is said meets no error, and so the work goes on."""
    far, near = kind()
    os.close(far)
    code = (
        "import typer; from companion.cli.shell import leave_gone_readers, say\n"
        "leave_gone_readers(); typer.echo('the end'); say('the log')"
    )
    done = subprocess.run([sys.executable, "-c", code], stdout=near, stderr=near, timeout=60)
    os.close(near)
    assert done.returncode == 0


def test_a_terminal_obeys_no_text_of_a_log() -> None:
    far, near = os.openpty()
    code = r"from companion.cli.logs import table; table(None, [('mission', '\x1b]0;owned\x07\x9b2J')])"
    subprocess.run([sys.executable, "-c", code], stdout=near, check=True, timeout=60)
    os.close(near)
    shown = os.read(far, 4096)
    os.close(far)
    assert b"]0;owned" in shown and b"\x1b]" not in shown and b"\x07" not in shown and "\x9b".encode() not in shown


def test_what_is_wrong_with_an_option_names_it() -> None:
    done = CliRunner().invoke(app, ["demo", "hover", "--avoid", "a-star"])
    assert done.exit_code == 2 and done.stderr.startswith("companion: --avoid: method 'a-star': there are \"astar\", ")


def test_two_links_at_one_port_are_both_named() -> None:
    vehicle = open_vehicle_link("udpin:127.0.0.1:0", Security(), None)
    waits, url = inmost(vehicle), "udpin:127.0.0.1:"
    assert isinstance(waits, Udp)
    place = f"{url}{waits.port}"
    with closing(vehicle):
        for stations, sensor, both in (((), place, "--lidar X: --connect"), ((place,), None, "--gcs X: --connect")):
            with pytest.raises(TransportError, match=f"^{both.replace('X', place)} has this port$"):
                open_side_links(vehicle, stations, sensor)
        free = Udp("127.0.0.1", 0, bind=True)
        other = f"{url}{free.port}"
        free.close()
        with pytest.raises(TransportError, match=f"^--lidar {other}: --gcs has this port$"):
            open_side_links(vehicle, (other,), other)
        with pytest.raises(TransportError, match=r"^--lidar bogus: neither a URL"):
            open_side_links(vehicle, (), "bogus")


def test_a_flight_that_failed_is_said_to_have_failed_once(capsys: pytest.CaptureFixture[str]) -> None:
    for outcome, cause, said in (
        (Outcome.FAILED, "the link is gone: unplugged", "failed: the link is gone: unplugged\n"),
        (Outcome.CRASHED, "hit tree", "failed: crashed: hit tree\n"),
    ):
        with pytest.raises(typer.Exit) as ended:
            _exit_by(Verdict(outcome, cause))
        assert ended.value.exit_code == 1 and capsys.readouterr().err == said


def test_orders_need_an_input_that_is_open(tmp_path: Path) -> None:
    options = f"--connect udpin:127.0.0.1:0 --orders --log {shlex.quote(str(tmp_path))}"
    flight = f"{shlex.quote(sys.executable)} -m companion fly hover {options} <&-"
    done = subprocess.run(["sh", "-c", flight], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "companion: --orders: standard input is closed\n")
