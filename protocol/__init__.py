"""What both processes agree on: MAVLink framing and messages, transports, frames of reference, the flight log."""
