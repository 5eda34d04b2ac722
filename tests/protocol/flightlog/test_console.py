"""Texts and progress on standard error, with a terminal, without one, and with nobody who reads."""

import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from rich.text import Text

from protocol.flightlog import Status, read
from protocol.flightlog.panel import drawn

TALKER = """
import sys
from contextlib import suppress
from pathlib import Path
from protocol.flightlog import FlightLog, Status
log = FlightLog.open(Path(sys.argv[1]), metadata={}, attachments={}, types=[], on_full="wait",
                     console=sys.argv[2] == "1", minimum_free_bytes=0, buffer_bytes=1 << 16)
for number in range(20):
    log.status(Status(f"at {number} m", (("speed", "4 m/s"),), number / 20))
log.text(1_500_000_000, 30, "supervisor", "too late")
log.close()
"""


def test_console_without_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-c", TALKER]
    loud = subprocess.run([*command, str(tmp_path / "a"), "1"], stderr=subprocess.PIPE, check=True)
    assert loud.stderr.decode().splitlines() == ["at 0 m  0%  speed 4 m/s", "    1.500 WARNING supervisor: too late"]
    quiet = subprocess.run([*command, str(tmp_path / "b"), "0"], stderr=subprocess.PIPE, check=True)
    assert quiet.stderr.decode() == ""
    (record,) = read(tmp_path / "b" / "flight.mcap")
    assert record.topic == "/log"


def test_console_on_a_terminal(tmp_path: Path) -> None:
    """The panel is drawn over the last one and below the texts, and is gone at the end."""
    ours, theirs = os.openpty()
    command = [sys.executable, "-c", TALKER, str(tmp_path / "a"), "1"]
    with subprocess.Popen(command, stderr=theirs, env={**os.environ, "TERM": "xterm"}) as talker:
        os.close(theirs)
        parts = list[bytes]()
        with suppress(OSError):  # EIO: the other end is closed
            while part := os.read(ours, 1 << 16):
                parts.append(part)
    os.close(ours)
    assert talker.returncode == 0
    shown = b"".join(parts).decode().replace("\r\n", "\n")
    screen = list[str]()
    for chunk in shown.split("\x1b[J"):
        kept, _, up = chunk.partition("\r\x1b[")
        lines = Text.from_ansi(kept).plain.split("\n")
        screen[-1:] = [*screen[-1:], *lines] if not screen else [screen[-1] + lines[0], *lines[1:]]
        if up:
            del screen[-1 - int(up.removesuffix("A")) :]
            screen.append("")
    assert [line.rstrip() for line in screen if line.strip()] == ["    1.500 WARNING supervisor: too late"]
    assert "at 0 m" in shown and "at 19 m" in shown and "\x1b[33m" in shown


def test_the_panel_fits_a_terminal_and_one_write() -> None:
    figures = (("time to go", "1:05"), ("speed", "4.0 m/s"), ("height", "3.0 m"), ("battery", "87%"), ("link", "good"))
    for columns in (30, 80, 300):
        text = drawn(Status("courier: route, step 3 of 9", figures, 0.4, "Ctrl-C lands"), columns)
        plain = Text.from_ansi(text).plain
        assert all(len(line) < columns for line in plain.splitlines()) and len(text.encode()) < select.PIPE_BUF
    assert " 40%" in plain and "87%" in plain and "courier: route, step 3 of 9" in plain
    bars = [drawn(Status("", (), share), 80).count("\x1b[36m") for share in (0.0, 0.5)]
    assert bars[0] < bars[1]


def test_a_status_survives_its_bytes() -> None:
    for status in (Status("hover"), Status("hover", (("speed", "4 m/s"),), 0.5, "Ctrl-C lands")):
        assert Status.decode(status.encode()) == status
    assert status.line == "hover  50%  speed 4 m/s"


def test_console_that_nobody_reads_stops_nothing(tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    code = TALKER.replace("range(20)", "range(0)").replace("log.close()", "") + (
        "for number in range(3000): log.text(number, 30, 'chatter', 'x' * 100)\nlog.close()\nprint(log.fault)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a"), "1"], stdout=subprocess.PIPE, stderr=write_end, check=True
    )
    os.close(read_end)
    os.close(write_end)
    assert done.stdout == b"None\n"
    assert sum(1 for _ in read(tmp_path / "a" / "flight.mcap")) == 3001
