"""What a person can get wrong: one clear line that names the thing and the place, and an exit code that is not 0."""

import socket
from pathlib import Path

import pytest

from tests.flights.processes import run


def refused(*arguments: str) -> str:
    """The one line on stderr of a command that can't be carried out."""
    done = run(*arguments)
    assert done.returncode == 2, (done.returncode, done.stderr)
    assert done.stdout == ""
    expected = ("getting ready", "companion: waiting at ")
    lines = [line for line in done.stderr.splitlines() if not line.startswith(expected)]
    assert len(lines) == 1, done.stderr
    return lines[0]


NO_MAP = ("--set", "avoidance.method=none")
"""Where it gets ready first: with less to compile and to try."""
FLY = ("companion", "fly", "hover", "--connect", "udpin:127.0.0.1:0")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("control.position.c3=[1.0,1.0,1.0]", ["c3", "control.position"]),
        ("control.position.c1=[1.0,-1.0,1.0]", ["control.position.c1"]),
        ("limits.tilt_deg=120", ["limits.tilt_deg"]),
        ("limits.lowest_thrust=0.6", ["limits.lowest_thrust", "hovers at"]),
        ("avoidance.method=magic", ["magic", "paper"]),
        ("nonsense", ["nonsense", "key=value"]),
    ],
)
def test_settings_on_the_command_line(setting: str, words: list[str], tmp_path: Path) -> None:
    line = refused(*FLY, "--log", str(tmp_path), "--set", setting)
    assert all(word in line for word in words), line


def test_a_method_that_there_is_not(tmp_path: Path) -> None:
    line = refused(*FLY, "--log", str(tmp_path), "--avoid", 'side"ways')
    assert 'side"ways' in line and "vfh" in line, line


def test_settings_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[avoidance]\nlateral_margn = 2.0\n")
    line = refused(*FLY, "--settings", str(path))
    assert "mine.toml" in line and "lateral_margn" in line
    path.write_text("[avoidance\n")
    assert "mine.toml" in refused(*FLY, "--settings", str(path))
    assert "other.toml" in refused(*FLY, "--settings", str(tmp_path / "other.toml"))


def test_mission_and_its_files(tmp_path: Path) -> None:
    line = refused("companion", "fly", "atlantis")
    assert "atlantis" in line and "courier" in line
    path = tmp_path / "mine.toml"
    path.write_text('name = "x"\nworld = "nowhere"\n[[waypoints]]\nnorth = 1.0\neast = 0.0\nheight = 2.0\n')
    assert "nowhere" in refused("companion", "fly", str(path))
    path.write_text('name = "x"\n[[waypoints]]\nnorth = 1.0\neast = 0.0\nheight = -2.0\n')
    line = refused("companion", "fly", str(path))
    assert "mine.toml" in line and "height" in line
    path.write_text('name = "x"\nwaypoints = []\n')
    assert "waypoints" in refused("companion", "fly", str(path))


@pytest.mark.parametrize(
    "option", [("--output", "thoughts"), ("--pace", "slow"), ("--pace", "-1"), ("--pace", "1e-300")]
)
def test_options(option: tuple[str, str]) -> None:
    assert option[1] in refused(*FLY, *option)


def test_a_demo_in_lockstep_shows_itself_to_nobody() -> None:
    assert "--pace realtime" in refused("companion", "demo", "--gcs", "qgc", "--pace", "lockstep")


@pytest.mark.parametrize(
    "url", ["udpin:127.0.0.1", "carrier-pigeon:home:1", "udpin:127.0.0.1:99999", "serial:/dev/nothing:57600"]
)
def test_urls(url: str) -> None:
    assert url in refused("companion", "fly", "hover", "--connect", url)


def test_port_in_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{other.getsockname()[1]}"
        assert url in refused("companion", "fly", "hover", "--connect", url)
        line = refused("vehicle_sim", "--bind", url)
        assert url in line


def test_no_vehicle(tmp_path: Path) -> None:
    done = run(*FLY, "--log", str(tmp_path), "--set", "supervision.find_timeout=1.0", *NO_MAP)
    assert done.returncode == 1
    assert "no vehicle within 1 s at udpin:127.0.0.1:0: is the vehicle on" in done.stderr


def test_log_folder_that_is_a_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    assert str(path) in refused(*FLY, "--log", str(path), *NO_MAP)


def test_log_folder_that_is_read_only() -> None:
    assert "/proc" in refused(*FLY, "--log", "/proc", *NO_MAP)


def test_log_that_can_not_be_read(tmp_path: Path) -> None:
    assert "missing.mcap" in refused("companion", "digest", str(tmp_path / "missing.mcap"))
    path = tmp_path / "broken.mcap"
    path.write_bytes(b"nothing of the kind" * 10)
    assert "broken.mcap" in refused("companion", "digest", str(path))


def test_simulator() -> None:
    assert "atlantis" in refused("vehicle_sim", "--world", "atlantis")
    assert "saucer" in refused("vehicle_sim", "--vehicle", "saucer")
    assert "slow" in refused("vehicle_sim", "--pace", "slow")


def test_help_reads_well() -> None:
    for arguments in (("companion", "--help"), ("companion", "demo", "--help"), ("vehicle_sim", "--help")):
        done = run(*arguments)
        assert done.returncode == 0 and "Usage" in done.stdout
