"""A companion made of unmodified pymavlink alone, joined to a vehicle in one thread: the tests' foreign oracle."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.toml_files import find
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.services.identity import FIRST, Identity
from vehicle_sim.timing import TICK_NS
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

AIRFRAME = Airframe.load(find("vehicles", "paper_quad"))
EMPTY = World.load(find("worlds", "empty"))
UNSET = math.nan
HEARTBEAT_TICKS = 250

TAKEOFF, HOLD, RETURN, LAND = (4 << 16 | sub << 24 for sub in (2, 3, 5, 6))
OFFBOARD = 6 << 16


def world_with(*overrides: str) -> World:
    return World.load(find("worlds", "empty"), overrides)


def airframe_with(*overrides: str) -> Airframe:
    return Airframe.load(find("vehicles", "paper_quad"), overrides)


def world_with_wall(north: float) -> World:
    """A wall across the way north, 10 m wide and 5 m high, 1 m thick."""
    wall = {"name": "wall", "center": [north, 0.0], "size": [1.0, 10.0], "height": [0.0, 5.0]}
    origin = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
    return World.from_tables({"name": "walled", "origin": origin, "box": [wall]}, "test")


class ForeignPilot:
    """Flies a vehicle tick by tick and keeps all that it says."""

    def __init__(
        self,
        world: World = EMPTY,
        *,
        seed: int = 0,
        lockstep: bool = False,
        component: int = 191,
        all_streams: bool = False,
        airframe: Airframe = AIRFRAME,
        identity: Identity = FIRST,
    ) -> None:
        self.vehicle = Vehicle(airframe, world, seed=seed, lockstep=lockstep, identity=identity)
        if not all_streams:  # fewer to decode: these tests are many
            for message_id in self.vehicle.telemetry.message_ids:
                if message_id not in (mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE):
                    self.vehicle.telemetry.set_interval(message_id, -1)
        self.present = True
        """Sends heartbeats."""
        self.datagrams: list[bytes] = []
        self.received: dict[str, list[tuple[float, Any]]] = {}
        self._out = mavlink.MAVLink(None, 1, component)
        self._in = mavlink.MAVLink(None)

    @property
    def time_s(self) -> float:
        return self.vehicle.time_ns * 1e-9

    def send(self, message: Any) -> None:
        self.vehicle.receive(message.pack(self._out))

    def fly(
        self, seconds: float, each: Callable[[], None] | None = None, until: Callable[[], bool] | None = None
    ) -> bool:
        """Let time pass, calling `each` before every tick; True as soon as `until` holds."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            if each is not None:
                each()
            if self.present and self.vehicle.tick % HEARTBEAT_TICKS == 0:
                self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
            for datagram in self.vehicle.advance():
                self.datagrams.append(datagram)
                for message in self._in.parse_buffer(datagram) or []:
                    self.received.setdefault(message.get_type(), []).append((self.time_s, message))
            if until is not None and until():
                return True
        return False

    # --- what it said ---

    def all(self, name: str, since_s: float = -1.0) -> list[Any]:
        return [message for time_s, message in self.received.get(name, ()) if time_s > since_s]

    def times(self, name: str) -> list[float]:
        """When each came (s)."""
        return [time_s for time_s, _ in self.received.get(name, ())]

    def last(self, name: str) -> Any:
        return self.received[name][-1][1]

    @property
    def texts(self) -> list[str]:
        return [message.text for message in self.all("STATUSTEXT")]

    @property
    def mode(self) -> int:
        return int(self.last("HEARTBEAT").custom_mode)

    @property
    def armed(self) -> bool:
        return bool(self.last("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def landed_state(self) -> int:
        return int(self.last("EXTENDED_SYS_STATE").landed_state)

    @property
    def height(self) -> float:
        return -self.vehicle.motion.position_ned[2]

    # --- what it asks ---

    def command(self, number: int, *params: float) -> int:
        """The result in the answer, which must come with the next tick."""
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *(0.0,) * (7 - len(params))))
        before = self.time_s
        self.fly(0.004)
        (ack,) = [ack for ack in self.all("COMMAND_ACK", before) if ack.command == number]
        return int(ack.result)

    def set_mode(self, custom_mode: int) -> int:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, custom_mode >> 16 & 255, custom_mode >> 24)

    def arm(self) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def disarm(self, force: float = 0.0) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, force)

    def interval(self, message_id: int, interval_us: float) -> int:
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)

    def take_off(self) -> None:
        """Into hold at the vehicle's own take-off height."""
        self.fly(1.2)
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7) == mavlink.MAV_RESULT_ACCEPTED
        assert self.arm() == mavlink.MAV_RESULT_ACCEPTED
        assert self.fly(10.0, until=lambda: self.mode == HOLD and self.vehicle.motion.speed < 0.02)

    def attitude(self, q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0), thrust: float | None = None, mask: int = 7) -> None:
        """SET_ATTITUDE_TARGET; by default level, at the thrust that hovers."""
        hover = self.vehicle.flight.mass_kg * GRAVITY / self.vehicle.airframe.body.max_thrust_n
        thrust = hover if thrust is None else thrust
        self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, list(q), 0.0, 0.0, 0.0, thrust))

    def rates(self, rates_frd: tuple[float, float, float], thrust: float | None = None) -> None:
        hover = self.vehicle.flight.mass_kg * GRAVITY / self.vehicle.airframe.body.max_thrust_n
        thrust = hover if thrust is None else thrust
        unit = [1.0, 0.0, 0.0, 0.0]
        self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 128, unit, *rates_frd, thrust))

    def go_offboard(self, each: Callable[[], None] | None = None) -> None:
        """Stream, then switch."""
        self.fly(1.1, each or self.attitude)
        assert self.set_mode(OFFBOARD) == mavlink.MAV_RESULT_ACCEPTED
        assert self.mode == OFFBOARD


def tilted(angle: float, axis: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Quaternion of a rotation by an angle (rad) about an axis."""
    x, y, z = np.array(axis) / np.linalg.norm(axis) * math.sin(0.5 * angle)
    return math.cos(0.5 * angle), float(x), float(y), float(z)
