"""Accumulators: each takes the arrays of a log, batch by batch, and answers one question about the flight."""
