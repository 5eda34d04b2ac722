"""Logs after the flight: flown again, played, described, mended, converted, listed."""
