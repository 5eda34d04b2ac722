"""A user's program for MAVSDK-Python 3, whose interface is not that of version 4: it flies a vehicle through what the
package offers, and says each part that is done. `python mavsdk_3_user.py ADDRESS GRPC_PORT FOLDER`.

It has a process of its own, with that version on the path, and imports nothing of this project."""

import asyncio
import inspect
import math
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from mavsdk import System
from mavsdk.action import OrbitYawBehavior
from mavsdk.ftp import FtpError
from mavsdk.geofence import FenceType, GeofenceData, Point, Polygon
from mavsdk.log_files import LogFilesError
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.telemetry import FlightMode, TelemetryError

NAN = math.nan
M_PER_DEG = 111_200.0
NOT_MEASURED = {"imu", "raw_imu", "scaled_imu", "scaled_pressure"}
"""A vehicle without sensors has none of these."""
NEVER = {"actuator_control_target", "actuator_output_status", "status_text", "wind"}
"""What the vehicle does not have, or says only when there is something to say."""


async def until(values: AsyncIterator[Any], holds: Callable[[Any], bool] = lambda value: True) -> Any:
    """The first of them for which it holds."""
    async for value in values:
        if holds(value):
            return value
    raise AssertionError("the stream has ended")


async def in_mode(drone: System, mode: FlightMode) -> None:
    await until(drone.telemetry.flight_mode(), lambda now: now == mode)


async def moves(drone: System, holds: Callable[[float], bool]) -> None:
    """Until that holds of its speed over ground."""
    await until(drone.telemetry.velocity_ned(), lambda v: holds(math.hypot(v.north_m_s, v.east_m_s)))


async def steered(drone: System, forward: float, holds: Callable[[float], bool]) -> None:
    """By a stick held forward, until that holds of its speed."""
    async for v in drone.telemetry.velocity_ned():
        if holds(math.hypot(v.north_m_s, v.east_m_s)):
            return
        await drone.manual_control.set_manual_control_input(forward, 0.0, 0.5, 0.0)


async def is_at(drone: System, north: float, east: float, down: float) -> None:
    def near(state: Any) -> bool:
        p = state.position
        return math.dist((p.north_m, p.east_m, p.down_m), (north, east, down)) < 0.3

    await until(drone.telemetry.position_velocity_ned(), near)


async def hold_in_the_air(drone: System) -> None:
    if not await until(drone.telemetry.in_air()):
        await drone.action.set_takeoff_altitude(4.0)
        await drone.action.arm()
        await drone.action.takeoff()
        await until(drone.telemetry.position_velocity_ned(), lambda state: state.position.down_m < -3.8)
    await drone.action.hold()
    await in_mode(drone, FlightMode.HOLD)
    await moves(drone, lambda speed: speed < 0.3)


async def refused(answer: Any, error: type[Exception]) -> bool:
    try:
        await answer
    except error:
        return True
    return False


async def version_and_parameters(drone: System, folder: Path) -> None:
    version = await drone.info.get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 16)
    every = await drone.param.get_all_params()
    assert len(every.int_params) + len(every.float_params) > 150
    await drone.param.set_param_float("MPC_XY_CRUISE", 4.0)
    await drone.param.set_param_int("COM_OBL_RC_ACT", 3)
    assert await drone.param.get_param_float("MPC_XY_CRUISE") == 4.0
    assert await drone.param.get_param_int("COM_OBL_RC_ACT") == 3


async def all_telemetry(drone: System, folder: Path) -> None:
    """Rates of what the vehicle lacks are refused."""
    streams = {name for name, _ in inspect.getmembers(drone.telemetry, inspect.isasyncgenfunction) if name[0] != "_"}
    assert len(streams) > 30
    await asyncio.gather(*(until(getattr(drone.telemetry, name)()) for name in streams - NOT_MEASURED - NEVER))
    assert await refused(drone.telemetry.set_rate_imu(10.0), TelemetryError)
    await drone.telemetry.set_rate_position_velocity_ned(50.0)


async def files(drone: System, folder: Path) -> None:
    listed = await drone.ftp.list_directory("/")
    assert "parameters.json" in listed.files
    async for _ in drone.ftp.download("/parameters.json", str(folder), False):
        pass
    assert (folder / "parameters.json").stat().st_size > 1000
    assert await refused(drone.ftp.list_directory("/nowhere"), FtpError)
    assert await refused(drone.log_files.get_entries(), LogFilesError), "there are no logs yet"


async def mission_and_fence(drone: System, folder: Path) -> None:
    home = await until(drone.telemetry.home())
    metres = M_PER_DEG, M_PER_DEG * math.cos(math.radians(home.latitude_deg))

    def place(north: float, east: float) -> tuple[float, float]:
        return home.latitude_deg + north / metres[0], home.longitude_deg + east / metres[1]

    def item(north: float, east: float) -> MissionItem:
        camera, vehicle = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
        return MissionItem(*place(north, east), 4.0, NAN, True, NAN, NAN, camera, NAN, NAN, 1.0, NAN, NAN, vehicle)

    corners = [Point(*place(*corner)) for corner in ((50, 50), (-50, 50), (-50, -50), (50, -50))]
    await drone.geofence.upload_geofence(GeofenceData([Polygon(corners, FenceType.INCLUSION)], []))
    await drone.mission.set_return_to_launch_after_mission(True)
    await drone.mission.upload_mission(MissionPlan([item(8.0, 0.0), item(8.0, 8.0), item(0.0, 8.0)]))
    assert len((await drone.mission.download_mission()).mission_items) == 3
    await drone.action.arm()
    await drone.mission.start_mission()
    await until(drone.mission.mission_progress(), lambda progress: progress.current >= 1)
    await drone.mission.pause_mission()
    await in_mode(drone, FlightMode.HOLD)
    assert not await drone.mission.is_mission_finished()
    await drone.mission.start_mission()
    await until(drone.mission.mission_progress(), lambda progress: progress.current == 3)
    await in_mode(drone, FlightMode.RETURN_TO_LAUNCH)
    await drone.mission.clear_mission()
    await drone.geofence.clear_geofence()


async def offboard(drone: System, folder: Path) -> None:
    await hold_in_the_air(drone)
    await drone.offboard.set_position_ned(PositionNedYaw(3.0, 2.0, -6.0, 45.0))
    await drone.offboard.start()
    await is_at(drone, 3.0, 2.0, -6.0)
    await drone.offboard.set_velocity_ned(VelocityNedYaw(2.0, 0.0, 0.0, 0.0))
    await moves(drone, lambda speed: abs(speed - 2.0) < 0.2)
    await drone.offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 1.0, 0.0, 10.0))
    await moves(drone, lambda speed: abs(speed - 1.0) < 0.1)
    await drone.offboard.set_acceleration_ned(AccelerationNed(1.0, 0.0, 0.0))
    await until(drone.telemetry.velocity_ned(), lambda v: v.north_m_s > 1.0)
    await drone.offboard.set_attitude(Attitude(0.0, -5.0, 0.0, 0.475))
    await until(drone.telemetry.velocity_ned(), lambda v: v.north_m_s > 1.5)
    await drone.offboard.set_attitude_rate(AttitudeRate(0.0, 5.0, 0.0, 0.475))
    await until(drone.telemetry.velocity_ned(), lambda v: v.north_m_s < 1.0)
    await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
    await is_at(drone, 0.0, 0.0, -5.0)
    await in_mode(drone, FlightMode.OFFBOARD)
    await drone.offboard.stop()
    await in_mode(drone, FlightMode.HOLD)


async def orbit_place_and_sticks(drone: System, folder: Path) -> None:
    home = await until(drone.telemetry.home())
    place, over_sea = (home.latitude_deg, home.longitude_deg), home.absolute_altitude_m + 5.0
    await drone.action.do_orbit(5.0, 2.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *place, over_sea)
    await moves(drone, lambda speed: abs(speed - 2.0) < 0.1)
    await drone.action.goto_location(*place, over_sea, 0.0)
    await is_at(drone, 0.0, 0.0, -5.0)
    await drone.manual_control.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    await drone.manual_control.start_position_control()
    await steered(drone, 0.5, lambda speed: speed > 1.5)
    await steered(drone, 0.0, lambda speed: speed < 0.3)


async def return_landing_and_log(drone: System, folder: Path) -> None:
    await drone.action.return_to_launch()
    await in_mode(drone, FlightMode.RETURN_TO_LAUNCH)
    await drone.action.land()
    await until(drone.telemetry.armed(), lambda armed: not armed)
    entry, path = (await drone.log_files.get_entries())[-1], folder / "flight.ulg"
    async for _ in drone.log_files.download_log_file(entry, str(path)):
        pass
    assert path.stat().st_size == entry.size_bytes


async def kill(drone: System, folder: Path) -> None:
    """Last: it has crashed then."""
    await hold_in_the_air(drone)
    await drone.action.kill()
    await until(drone.telemetry.armed(), lambda armed: not armed)


PARTS = (
    version_and_parameters,
    all_telemetry,
    files,
    mission_and_fence,
    offboard,
    orbit_place_and_sticks,
    return_landing_and_log,
    kill,
)


async def main(address: str, port: int, folder: Path) -> None:
    drone = System(port=port)
    await drone.connect(system_address=address)
    await until(drone.core.connection_state(), lambda state: state.is_connected)
    await until(drone.telemetry.health_all_ok(), bool)
    for part in PARTS:
        await part(drone, folder)
        sys.stdout.write(f"{part.__name__}\n")


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])))
