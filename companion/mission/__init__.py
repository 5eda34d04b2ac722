"""The mission: its file, its steps, and the flight along them."""
