"""Avoidance of obstacles: the methods, the motion along a path, and the guard."""
