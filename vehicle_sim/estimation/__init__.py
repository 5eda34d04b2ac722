"""What the vehicle believes of its own motion."""
