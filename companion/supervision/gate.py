"""The last gate before the wire."""

import math

from companion.state import Setpoint


def unsound(setpoint: Setpoint) -> str | None:
    """Why a setpoint must not leave: what PX4 would turn into zero thrust, or ArduPilot into a stop. None if it may."""
    w, x, y, z = setpoint.attitude_ned_frd
    p, q, r = setpoint.rates_frd
    roll, pitch, yaw = setpoint.torque
    if not math.isfinite(w + x + y + z + p + q + r + roll + pitch + yaw + setpoint.thrust):
        return "not finite"
    if abs(w * w + x * x + y * y + z * z - 1.0) > 1e-3:
        return "quaternion not of length 1"
    if not 0.0 <= setpoint.thrust <= 1.0:
        return f"thrust {setpoint.thrust:g}"
    if not (-1.0 <= roll <= 1.0 and -1.0 <= pitch <= 1.0 and -1.0 <= yaw <= 1.0):
        return "torque above 1"
    return None
