"""Orders on a pipe, and what becomes of the flight when the pipe ends."""

import os
import socket

import msgspec
import pytest

from companion.mission.orders import Order
from companion.mission.plan import Mission, Waypoint
from companion.runtime.orders import MOST_BYTES, Orders
from companion.supervision.operations import LandRequest, OrderRequest


def test_lines_are_orders_whole_or_in_pieces_and_the_end_lands() -> None:
    end, pipe = os.pipe()
    orders = Orders(end)
    assert orders.take(1) == []
    os.write(pipe, b'{"do": "hold"}\n\n{"do"')
    assert orders.take(2) == [OrderRequest(2, '{"do": "hold"}')]
    os.write(pipe, b': "land"}\n')
    assert orders.take(3) == [OrderRequest(3, '{"do": "land"}')]
    os.close(pipe)
    assert orders.take(4) == [LandRequest(4)]
    assert orders.take(5) == []
    os.close(end)


def test_a_socket_whose_other_end_was_killed_lands() -> None:
    ours, theirs = socket.socketpair()
    ours.send(b"never read: so its end is a reset, and no end of file")
    theirs.send(b"part of an order")
    theirs.close()
    orders = Orders(ours.fileno())
    found = [event for _ in range(3) for event in orders.take(7)]
    assert found == [LandRequest(7)]
    ours.close()


def sent(line: bytes) -> list[OrderRequest | LandRequest]:
    """What has come of a line, and of an order behind it, that are written as the pipe takes them."""
    end, pipe = os.pipe()
    os.set_blocking(pipe, False)
    orders, found, rest = Orders(end), list[OrderRequest | LandRequest](), line + b'\n{"do": "hold"}\n'
    for _ in range(1000):
        rest = rest[os.write(pipe, rest) :] if rest else rest
        found += orders.take(1)
    os.close(pipe)
    os.close(end)
    assert not rest
    return found


def test_a_long_mission_is_one_order() -> None:
    places = [Waypoint(float(number), 2.5, 5.0) for number in range(1500)]
    text = msgspec.json.encode(Order("fly", Mission("long", waypoints=places, waits=True)))
    assert 1 << 16 < len(text) < MOST_BYTES
    assert sent(text) == [OrderRequest(1, text.decode()), OrderRequest(1, '{"do": "hold"}')]


def test_an_order_that_is_too_long_is_refused_and_the_next_is_read() -> None:
    first, second = sent(b'{"do": "fly", "mission": "' + b"x" * 3 * MOST_BYTES + b'"}')
    assert second == OrderRequest(1, '{"do": "hold"}')
    assert isinstance(first, OrderRequest) and len(first.text) == 200
    with pytest.raises(msgspec.DecodeError, match="truncated"):
        msgspec.json.decode(first.text, type=Order)
