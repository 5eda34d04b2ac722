"""The sensors that look at the world."""
