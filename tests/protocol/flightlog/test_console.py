"""Texts and progress on standard error, with a terminal, without one, and with nobody who reads."""

import os
import subprocess
import sys
from pathlib import Path

from protocol.flightlog import (
    read,
)

TALKER = """
import sys
from pathlib import Path
from protocol.flightlog import FlightLog
log = FlightLog.open(Path(sys.argv[1]), metadata={}, attachments={}, types=[], on_full="wait",
                     console=sys.argv[2] == "1", minimum_free_bytes=0, buffer_bytes=1 << 16)
for number in range(20):
    log.status(f"at {number} m")
log.text(1_500_000_000, 30, "supervisor", "too late")
log.close()
"""


def test_console_without_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-c", TALKER]
    loud = subprocess.run([*command, str(tmp_path / "a"), "1"], stderr=subprocess.PIPE, check=True)
    assert loud.stderr.decode().splitlines() == ["at 0 m", "    1.500 WARNING supervisor: too late"]
    quiet = subprocess.run([*command, str(tmp_path / "b"), "0"], stderr=subprocess.PIPE, check=True)
    assert quiet.stderr.decode() == ""
    (record,) = read(tmp_path / "b" / "flight.mcap")
    assert record.topic == "/log"


def test_console_on_a_terminal(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    subprocess.run([sys.executable, "-c", TALKER, str(tmp_path / "a"), "1"], stderr=theirs, check=True)
    shown_bytes = os.read(ours, 1 << 16).decode()
    os.close(ours)
    os.close(theirs)
    assert "\rat 0 m" in shown_bytes.replace("\x1b[K", "")
    assert "\r\x1b[K    1.500 WARNING supervisor: too late\r\nat 19 m" in shown_bytes
    assert shown_bytes.endswith("at 19 m\r\n")


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
