"""A position law and a planner for Courier."""
