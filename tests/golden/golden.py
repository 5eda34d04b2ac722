"""Golden flights: `python tests/golden/golden.py update` says what the software would send otherwise today, and flies
and records them anew."""

import subprocess
import sys
import tempfile
from pathlib import Path

from companion.logs.replay import Replay, replay
from companion.logs.writer import Writer
from companion.records import LEGACY_REQUEST, OPERATION, PLANNED, TICK
from protocol.flightlog import DATAGRAM, LogReader

FOLDER = Path(__file__).resolve().parent
FLIGHTS = {
    "rates_lockstep": ("--output", "rates", "--sensors", "perfect"),
    "attitude_realtime": ("--output", "attitude", "--pace", "realtime", "--sensors", "perfect"),
}
"""By name, the options of `companion demo`."""
_EVENTS = (DATAGRAM.topic, TICK.topic, OPERATION.topic, LEGACY_REQUEST.topic, PLANNED.topic)


def path_of(name: str) -> Path:
    """A golden flight's log."""
    return FOLDER / f"{name}.mcap"


def record(name: str) -> Path:
    """Fly it and keep its events alone. Raises RuntimeError if it does not land or does not come out the same."""
    with tempfile.TemporaryDirectory() as folder:
        mission = str(FOLDER / "short.toml")
        command = [sys.executable, "-m", "companion", "demo", mission, "--no-report", "--log", folder, *FLIGHTS[name]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{name}: the flight failed\n{done.stderr}")
        (flown,) = Path(folder).glob("*/flight.mcap")
        events = Path(folder) / "events.mcap"
        _keep_events(flown, events)
        if replay(events).differences:
            raise RuntimeError(f"{name}: the flight does not come out the same when it is flown again")
        path_of(name).write_bytes(events.read_bytes())
    return path_of(name)


def _keep_events(source: Path, target: Path) -> None:
    """Everything that the autopilot consumed and sent, and nothing that it thought: a few hundred kB."""
    log = LogReader(source)
    kinds = log.topics
    metadata = {name: table for name, table in log.metadata.items() if name != "flightlog"}
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        for sequence, each in enumerate(log.records(_EVENTS)):
            writer.record(kinds[each.topic], each.time_ns, sequence, each.data)


def difference(result: Replay) -> str:
    """A line for each field that differs."""
    if not result.differences:
        return "  the same to the bit"
    return "\n".join(
        f"  {each.message}.{each.field}: from {each.first_ns * 1e-9:.3f} s, {each.count} times"
        + ("" if each.largest is None else f", by up to {each.largest:.6g}")
        for each in result.differences
    )


def update() -> None:
    """Say what differs, and record all of them anew."""
    for name in FLIGHTS:
        if path_of(name).exists():
            sys.stdout.write(f"{name}, sent today beside what is recorded:\n{difference(replay(path_of(name)))}\n")
        new = record(name)
        sys.stdout.write(f"{name}: recorded, {new.stat().st_size / 1e3:.0f} kB\n")


if __name__ == "__main__":
    if sys.argv[1:] != ["update"]:
        raise SystemExit(__doc__)
    update()
