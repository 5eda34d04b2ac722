"""The MAVLink side of the vehicle: telemetry, and the services that answer requests."""
