"""What the live page shows of senders that tell the same twice, have several batteries, or are gone."""

import math
import os
import socket
from pathlib import Path

import numpy as np
import pytest

from companion.logs.writer import Writer
from companion.view.control import Control
from companion.view.history import History
from companion.view.live import Page
from companion.view.sources import FinishedLog, Link, open_log
from protocol.flightlog import Direction, LogReader
from protocol.frames import from_euler
from protocol.messages import Encoder, dialect
from protocol.transport import Memory, open_url
from tests.companion.view.made_logs import make, telemetry
from tests.companion.view.test_live import filled, wait_for


def test_the_charts_show_their_time_alone_where_two_messages_tell_the_attitude(tmp_path: Path) -> None:
    """PX4 tells it by both; a log is read message by message."""
    vehicle, path = Encoder(1, 1), tmp_path / "both.mcap"
    with Writer(path, 0, {}) as writer:
        for number in range(6000):
            turn = from_euler(0.1, 0.0, 0.0).tolist()
            told = vehicle.encode_fields(dialect.MAVLink_attitude_message, 20 * number, 0.1, 0, 0, 0, 0, 0)
            told += vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, 20 * number, *turn, 0, 0, 0)
            writer.datagram(20_000_000 * number, number, Direction.IN, "", told)
    history = filled(FinishedLog(LogReader(path)))
    for until in range(31, 119):
        times, angles = history.attitude_deg(until - 30.0, float(until))
        assert until - 30.1 < times.min() and times.max() < until + 0.1 and len(times) > 1400
        assert np.allclose(angles[:, 0], np.degrees(0.1), atol=1e-4)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e30])
def test_a_position_or_velocity_with_one_number_that_is_none_is_not_shown(
    axis: int, value: float, tmp_path: Path
) -> None:
    vehicle, path, sound = Encoder(1, 1), tmp_path / "odd.mcap", [1.0, 2.0, -3.0, 0.1, 0.2, 0.3]
    odd = [value if number == axis else 4.0 for number in range(6)]
    with Writer(path, 0, {}) as writer:
        for number, motion in enumerate((sound, odd)):
            told = vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, 100 * number, *motion)
            writer.datagram(100_000_000 * number, number, Direction.IN, "", told)
    moment = filled(FinishedLog(LogReader(path))).at(0.2)
    assert moment.position_ned is not None and moment.velocity_ned is not None
    assert [*moment.position_ned, *moment.velocity_ned] == pytest.approx(sound)


def test_of_several_batteries_the_emptiest_is_shown() -> None:
    """Whichever was told last."""
    ours, theirs = Memory.pair()
    source, history, vehicle = Link("memory", ours, b""), History(), Encoder(1, 1)
    for number, left in ((0, 90), (1, 15), (0, 89)):
        cells = (0, 0, 0, [65535] * 10, -1, -1, -1, left)
        theirs.send(vehicle.encode_fields(dialect.MAVLink_battery_status_message, number, *cells))
        for batch in source.poll():
            history.take(batch)
    assert history.at(history.end).battery == 15.0


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1e38])
def test_what_is_no_number_is_not_shown(wrong: float) -> None:
    """A position, an attitude and a ring of a broken estimator or sensor: the page goes on with all else."""
    ours, theirs = Memory.pair()
    vehicle, station = Encoder(1, 1), Control(theirs.send, lambda: 0)
    live = Page(Link("memory", ours, b""), 0, control=station)
    ring = (0, [200] * 72, 5, 20, 1500, wrong, wrong, 12)
    try:
        for number in range(40):
            theirs.send(telemetry(vehicle, 0, 1.0))
            strange = (
                vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, 10, wrong, 1.0, wrong, 0, wrong, 0),
                vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, 10, wrong, 0, 0, 0, 0, 0, 0),
                vehicle.encode_fields(dialect.MAVLink_attitude_message, 10, wrong, 0, 0, 0, 0, 0),
                vehicle.encode_fields(dialect.MAVLink_obstacle_distance_message, number, *ring),
                vehicle.encode_fields(
                    dialect.MAVLink_home_position_message, 2**31 - 1, 0, 0, wrong, 0, 0, [1, 0, 0, 0], 0, 0, 0
                ),
            )
            theirs.send(b"".join(strange))
            station.send_to(np.array([1.0, 0.0, -2.0]))
            live.step(0.03)
        place = live.position_ned()
        assert place is not None and np.isfinite(place).all() and live._trouble is None
        assert "has not said where on earth it is" in station.answer
    finally:
        live.stop()


def test_names_of_files_may_be_any_bytes(tmp_path: Path) -> None:
    """Each text of the page can be sent, those about a damaged log, too."""
    path = tmp_path / os.fsdecode(b"l\xe9.mcap")
    path.write_bytes(make(tmp_path / "made", 1.0).read_bytes()[:-5])
    os.utime(path, (0.0, 0.0))  # nobody writes to it any more
    live = Page(open_log(path), 0)
    try:
        for _ in range(12):
            live.step(0.01)
        for text in (live.hud.content, live.words.content):
            assert "l\\udce9.mcap" in text.encode().decode()
    finally:
        live.stop()


@pytest.mark.parametrize("controlled", [False, True])
def test_a_link_that_is_gone_is_said_and_what_was_heard_is_still_shown(controlled: bool) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_url(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        theirs, _ = server.accept()
    control = Control(link.send, lambda: 0) if controlled else None
    live = Page(Link("tcp", link, b""), 0, control=control)

    def step() -> Page:
        live.step(0.01)
        return live

    try:
        theirs.send(telemetry(Encoder(1, 1), 0, 1.0))
        wait_for(step, lambda page: page.position_ned() is not None)
        theirs.close()
        wait_for(step, lambda page: page._trouble is not None)
        for _ in range(12):
            live.step(0.01)
        assert "closed by the other end" in live.hud.content and "closed by the other end" in live.words.content
        assert live.position_ned() is not None
    finally:
        live.stop()
        link.close()
