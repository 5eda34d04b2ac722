"""Faults between the vehicle and its companion, and what comes of them: the flights of docs/faults.md."""
