"""Experiments and pictures; nothing imports this package."""
