"""What both processes agree on: MAVLink framing and messages, transports, frames of reference, clocks and the flight log."""
