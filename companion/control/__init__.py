"""The control laws: backstepping for position, inversion of the thrust vector, LQR for attitude."""
