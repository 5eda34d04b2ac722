"""Control laws, a planner and an output for Courier."""
