"""The autopilot: from telemetry to setpoints, one direction of flow."""
