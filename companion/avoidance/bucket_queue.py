"""A queue of the nodes of a search, in buckets by key: one is put in or taken out in constant time.

Dial 1969. The nodes of one bucket come out in any order. A key that is too low for the first bucket which is not empty
counts to that one.
"""

import numpy as np
from numpy.typing import NDArray

from protocol.jit import compiled

Nodes = NDArray[np.int32]
Queue = tuple[Nodes, Nodes, Nodes]
"""The uppermost entry of each bucket (-1: it is empty), what lies below each entry, and the node of each."""
QueueState = tuple[int, int, int, int]
"""The first bucket and the last that may hold any, the uppermost spare entry, the number of entries ever used."""

BUCKET_M = 0.02
"""m of cost in a bucket."""
LAST_BUCKET = (1 << 15) - 1
"""It holds all that costs more."""


def make_queue(entries: int) -> Queue:
    """A queue for so many entries at a time; a node for which there is no room is not put in."""
    return np.empty(LAST_BUCKET + 1, np.int32), np.empty(entries, np.int32), np.empty(entries, np.int32)


@compiled
def clear(queue: Queue) -> QueueState:
    """Empty a queue; returns its state."""
    queue[0][:] = -1
    return 0, 0, -1, 0


@compiled
def push(queue: Queue, state: QueueState, key: float, node: int) -> QueueState:
    """Put a node with a key (m, from 0 on) in; returns the queue's new state."""
    buckets, below, nodes = queue
    first, last, spare, used = state
    bucket = max(int(min(key * (1.0 / BUCKET_M), float(LAST_BUCKET))), first)
    entry = spare
    if spare >= 0:
        spare = below[spare]
    elif used < nodes.shape[0]:
        entry, used = used, used + 1
    else:
        return state
    nodes[entry], below[entry], buckets[bucket] = node, buckets[bucket], entry
    return first, max(last, bucket), spare, used


@compiled
def pop(queue: Queue, state: QueueState) -> tuple[int, QueueState]:
    """Take a node out of the first bucket that holds any; returns it (-1: there is none) and the queue's new state."""
    buckets, below, nodes = queue
    first, last, spare, used = state
    while first <= last and buckets[first] < 0:
        first += 1
    if first > last:
        return -1, (first, last, spare, used)
    entry = buckets[first]
    buckets[first], below[entry] = below[entry], spare
    return nodes[entry], (first, last, entry, used)
