"""Logs to work on: flown ones, and a small one with many chunks."""

import random
from pathlib import Path

import pytest

from protocol.flightlog import DATAGRAM
from protocol.flightlog.mcap_file import McapFile
from protocol.flightlog.mcap_format import message_record
from tests.companion.logs.changed_logs import Flyer
from tests.flights.processes import run
from tests.flights.shared import once

HOVER = Path(__file__).resolve().parents[2] / "data" / "hover.toml"


@pytest.fixture(scope="session")
def fly(tmp_path_factory: pytest.TempPathFactory) -> Flyer:
    """Flies a short hover in two processes, once for each set of options; the log."""

    def flyer(*options: str) -> Path:
        options = options or ("--output", "rates", "--pace", "lockstep")

        def make(folder: Path) -> None:
            done = run("companion", "demo", str(HOVER), "--no-report", "--log", str(folder), *options)
            assert done.returncode in (0, 1), done.stderr  # 1: in real time on a machine that is too busy

        (log,) = once(tmp_path_factory, "_".join(("hover", *options)), make).glob("*/flight.mcap")
        return log

    return flyer


@pytest.fixture(scope="session")
def many_chunks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished log of 40 chunks: 2000 datagrams of noise with their sequence, metadata, an attachment."""
    path = tmp_path_factory.mktemp("chunks") / "flight.mcap"
    generator = random.Random(1)
    file = McapFile(path)
    file.add_metadata("flightlog", {"version": "1", "epoch_ns": "1000000000"})
    file.add_metadata("flight", {"mission": "none", "output": "rates"})
    file.add_attachment("mission.toml", 1, b'name = "none"')
    channel = file.add_channel(DATAGRAM)
    for number in range(2000):
        data = DATAGRAM.pack(number % 2, "a:1", generator.randbytes(generator.randrange(40)))
        time_ns = 1_000_000_000 + number * 4_000_000
        file.add_message(channel, time_ns, message_record(channel, number, time_ns, data))
        if number % 50 == 49:
            file.end_chunk()
    file.add_metadata("flightlog end", {"reason": "closed", "dropped": "0"})
    file.finish()
    return path
