"""Logs that are opened in a test's folder, and a finished one."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    Direction,
    FlightLog,
)
from tests.protocol.flightlog.made_logs import (
    COUNT,
    EPOCH_NS,
    TRACE,
    Opener,
    frame_of,
    noise,
)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Opener]:
    """Opens logs in the test's folder, small and without a console unless told, and closes them at the end."""
    logs: list[FlightLog] = []

    def opener(name: str = "log", **options: Any) -> FlightLog:
        defaults: dict[str, Any] = {
            "metadata": {},
            "attachments": {},
            "types": [COUNT, TRACE],
            "on_full": "wait",
            "console": False,
            "minimum_free_bytes": 0,
            "epoch_ns": EPOCH_NS,
            "buffer_bytes": 1 << 20,
        }
        logs.append(FlightLog.open(tmp_path / name, **(defaults | options)))
        return logs[-1]

    yield opener
    for log in logs:
        log.close()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file of many chunks with something of everything."""
    log = FlightLog.open(
        tmp_path_factory.mktemp("finished"),
        metadata={"m": {"k": "v"}},
        attachments={"a": bytes(range(256))},
        types=[COUNT, TRACE],
        on_full="wait",
        console=False,
        minimum_free_bytes=0,
        buffer_bytes=1 << 20,
    )
    heartbeat = frame_of(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3))
    fill = noise(9)
    for number in range(1500):
        log.record(COUNT, number, COUNT.pack(number, fill(number)))
        log.datagram(number, Direction.IN, "a:1", heartbeat)
    log.close({"outcome": {"delivered": "yes"}})
    return log.path.read_bytes()
