"""What both processes agree on: MAVLink framing and messages, transports, frames of reference, clocks, the flight log."""
