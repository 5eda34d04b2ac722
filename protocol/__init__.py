"""What both processes agree on: MAVLink framing and messages, transports, frames of reference, the flight log."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""numpy's library starts a thread for each core, which spins for 0.1 s at the start of each process. No matrix here is
large enough for a second one."""
