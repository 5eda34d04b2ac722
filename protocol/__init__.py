"""What both processes agree on: MAVLink framing and messages, transports, frames of reference, the flight log."""

import gc
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""numpy's library starts a thread for each core, which spins for 0.1 s at the start of each process. No matrix here is
large enough for a second one."""
gc.set_threshold(50_000, 20, 100)
"""Imports and the compiler make objects to stay: collected as often as usual, they take a tenth of a start more."""
