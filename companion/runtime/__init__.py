"""Clocks, sockets, processes: what runs the autopilot."""
