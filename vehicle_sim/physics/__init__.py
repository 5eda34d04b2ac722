"""The mechanics of the quadrotor: its equations of motion and their integration."""
