"""Avoidance: one file a method. What they share: the returns of a ring as points in the world, and the braking
distance."""
