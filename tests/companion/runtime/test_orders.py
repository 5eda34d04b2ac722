"""Orders on a pipe, and what becomes of the flight when the pipe ends."""

import os
import socket

from companion.runtime.orders import Orders
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
