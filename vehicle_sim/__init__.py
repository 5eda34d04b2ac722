"""The vehicle: dynamics, world, sensors and an autopilot that speaks MAVLink as PX4 does."""
