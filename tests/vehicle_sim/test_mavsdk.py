"""An unmodified MAVSDK flies the vehicle, at five times the speed of real time, and in real time."""

import json
import math
import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pyulog import ULog

from tests.vehicle_sim.served import HOST, PATIENCE_S, served

pytest.importorskip("mavsdk")
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.action.action import OrbitYawBehavior
from mavsdk.plugins.component_metadata import ComponentMetadata
from mavsdk.plugins.component_metadata.component_metadata import MetadataType
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.geofence import Geofence
from mavsdk.plugins.geofence.geofence import FenceType, GeofenceData, Point, Polygon
from mavsdk.plugins.info import Info
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.log_files.log_files import LogFilesResult
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mission import Mission
from mavsdk.plugins.mission.mission import MissionItem, MissionPlan
from mavsdk.plugins.offboard import Offboard
from mavsdk.plugins.offboard.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.param import Param
from mavsdk.plugins.shell import Shell
from mavsdk.plugins.telemetry import Telemetry
from mavsdk.plugins.telemetry.telemetry import FlightMode, TelemetryError, TelemetryResult

NAN = math.nan
Point3 = tuple[float, float, float]


class User:
    """Its program: the plug-ins, and what telemetry said last."""

    def __init__(self, mavsdk: Any, system: Any, port: int) -> None:
        self.mavsdk, self.system, self.port = mavsdk, system, port
        self.action, self.telemetry = Action(system), Telemetry(system)
        self.said: dict[str, Any] = {}
        self._news = threading.Condition()
        for name in ("armed", "flight_mode", "health_all_ok", "home", "in_air", "position_velocity_ned"):
            getattr(self.telemetry, f"subscribe_{name}")(lambda value, _=None, name=name: self._hear(name, value))

    def _hear(self, name: str, value: Any) -> None:
        with self._news:
            self.said[name] = value
            self._news.notify_all()

    def wait(self, holds: Callable[[], bool], each: Callable[[], object] = lambda: None) -> None:
        """Until something holds; `each` at every news."""
        with self._news:
            in_time = self._news.wait_for(lambda: (each(), holds())[1], PATIENCE_S)
            assert in_time, "\n".join(f"{name}: {value}" for name, value in self.said.items())

    @property
    def position(self) -> Point3:
        p = self.said["position_velocity_ned"].position
        return p.north_m, p.east_m, p.down_m

    @property
    def velocity(self) -> Point3:
        v = self.said["position_velocity_ned"].velocity
        return v.north_m_s, v.east_m_s, v.down_m_s

    @property
    def speed(self) -> float:
        return math.hypot(*self.velocity)

    def wait_for_mode(self, mode: FlightMode) -> None:
        self.wait(lambda: self.said["flight_mode"] == mode)

    def fly(self) -> None:
        """Into hold in the air, from wherever it is."""
        if not self.said["in_air"]:
            self.action.set_takeoff_altitude(4.0)
            self.action.arm()
            self.action.takeoff()
            self.wait(lambda: self.position[2] < -3.8)
        self.action.hold()
        self.wait_for_mode(FlightMode.HOLD)
        self.wait(lambda: self.speed < 0.3)


@pytest.fixture(scope="module", params=[5.0, 1.0], ids=lambda pace: f"{pace:g}x")
def user(request: pytest.FixtureRequest) -> Iterator[User]:
    """At each pace a vehicle of its own."""
    with served(request.param) as vehicle:
        mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        mavsdk.add_any_connection(f"udpout://{HOST}:{vehicle.port}")
        system = mavsdk.first_autopilot(PATIENCE_S)
        assert system is not None
        user = User(mavsdk, system, vehicle.port)
        user.wait(lambda: bool(user.said.get("health_all_ok")) and len(user.said) == 6)
        yield user
        mavsdk.destroy()


def test_it_is_known_and_its_parameters_are_read_and_set(user: User) -> None:
    version = Info(user.system).get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 16)
    param = Param(user.system)
    every = param.get_all_params()
    integers = {each.name: each.value for each in every.int_params}
    assert integers["SYS_AUTOSTART"] == 10040 and len(integers) + len(every.float_params) > 150
    param.set_param_float("MPC_XY_CRUISE", 4.0)
    param.set_param_int("COM_OBL_RC_ACT", 3)
    assert param.get_param_float("MPC_XY_CRUISE") == 4.0 and param.get_param_int("COM_OBL_RC_ACT") == 3


def test_its_shell_answers_and_its_parameters_are_described(user: User) -> None:
    heard: queue.Queue[Any] = queue.Queue()
    shell = Shell(user.system)
    shell.subscribe_receive(lambda answer, _=None: heard.put(answer))
    shell.send("param show NAV_ACC_RAD\n", 10)
    assert heard.get(timeout=PATIENCE_S).data == "NAV_ACC_RAD : 2\npxh> "
    metadata = ComponentMetadata(user.system)
    metadata.subscribe_metadata_available(lambda update, _=None: heard.put(update))
    metadata.request_autopilot_component()
    update = heard.get(timeout=PATIENCE_S)
    assert update.type == MetadataType.PARAMETER
    assert len(json.loads(update.json_metadata)["parameters"]) > 150


UNMEASURED = {"imu", "raw_imu", "scaled_imu", "scaled_pressure"}
"""A vehicle without sensors has none of these."""
NEVER = {"actuator_control_target", "actuator_output_status", "wind"}
"""Nor has it a wind sensor; and its rotors are in SERVO_OUTPUT_RAW, which MAVSDK does not read."""


def test_all_telemetry_comes_but_what_is_not_measured(user: User) -> None:
    """A rate for what does not come is refused at once, so that nobody waits for it."""
    kinds = {name.removeprefix("subscribe_") for name in dir(Telemetry) if name.startswith("subscribe_")}
    heard: set[str] = set()
    telemetry = Telemetry(user.system)
    for kind in kinds:
        getattr(telemetry, f"subscribe_{kind}")(lambda value, _=None, kind=kind: heard.add(kind))
    user.wait(lambda: kinds - heard <= UNMEASURED | NEVER | {"status_text"})
    assert not heard & (UNMEASURED | NEVER)
    refused = {}
    for kind in kinds:
        try:
            getattr(telemetry, f"set_rate_{kind}", lambda rate_hz: None)(10.0)
        except TelemetryError as error:
            refused[kind] = error.args[0]
    assert set(refused.values()) == {TelemetryResult.COMMAND_DENIED}
    assert refused.keys() == (UNMEASURED | NEVER | {"rc_status"}) - {"scaled_pressure", "wind"}, "these have no rate"
    assert telemetry.get_gps_global_origin().latitude_deg == pytest.approx(user.said["home"].latitude_deg)


def test_files_are_listed_and_there_are_no_logs_yet(user: User) -> None:
    listed = Ftp(user.system).list_directory("/")
    assert [each.name for each in listed.entries] == ["general.json", "parameters.json", "parameters.params"]
    with pytest.raises(Exception, match=r"(?i)no.?log"):
        LogFiles(user.system).get_entries()


def test_a_mission_is_uploaded_flown_paused_and_cleared(user: User) -> None:
    mission, fence, home = Mission(user.system), Geofence(user.system), user.said["home"]
    east_m = 111_200.0 * math.cos(math.radians(home.latitude_deg))

    def place(north: float, east: float) -> tuple[float, float]:
        return home.latitude_deg + north / 111_200.0, home.longitude_deg + east / east_m

    def item(north: float, east: float) -> MissionItem:
        """With a gimbal turned and a picture taken, as MAVSDK's own example has them."""
        return MissionItem(*place(north, east), 4.0, NAN, True, 20.0, 60.0, 1, NAN, NAN, 1.0, NAN, NAN)

    corners = [Point(*place(*corner)) for corner in ((50, 50), (-50, 50), (-50, -50), (50, -50))]
    fence.upload_geofence(GeofenceData([Polygon(corners, FenceType.INCLUSION)], []))
    mission.set_return_to_launch_after_mission(True)
    mission.upload_mission(MissionPlan([item(8.0, 0.0), item(8.0, 8.0), item(0.0, 8.0)]))
    assert len(mission.download_mission().mission_items) == 3
    user.action.arm()
    mission.start_mission()
    user.wait(lambda: mission.mission_progress().current >= 1)
    mission.pause_mission()
    user.wait_for_mode(FlightMode.HOLD)
    user.wait(lambda: user.speed < 0.3)
    assert not mission.is_mission_finished()
    mission.start_mission()
    user.wait(lambda: mission.mission_progress().current == 3)
    user.wait_for_mode(FlightMode.RETURN_TO_LAUNCH)
    mission.clear_mission()
    fence.clear_geofence()


SETPOINTS: tuple[tuple[str, Any, Callable[[User], bool]], ...] = (
    ("position_ned", PositionNedYaw(3.0, 2.0, -20.0, 45.0), lambda u: math.dist(u.position, (3.0, 2.0, -20.0)) < 0.3),
    ("velocity_ned", VelocityNedYaw(2.0, 0.0, 0.0, 0.0), lambda u: math.dist(u.velocity, (2.0, 0.0, 0.0)) < 0.2),
    ("velocity_body", VelocityBodyYawspeed(0.0, 1.0, 0.0, 10.0), lambda u: abs(u.speed - 1.0) < 0.1),
    ("acceleration_ned", AccelerationNed(1.0, 0.0, 0.0), lambda u: u.velocity[0] > 1.0),
    ("attitude", Attitude(0.0, -5.0, 0.0, 0.475), lambda u: u.velocity[0] > 1.5),
    ("attitude_rate", AttitudeRate(0.0, 5.0, 0.0, 0.475), lambda u: u.velocity[0] < 1.0),
    ("position_ned", PositionNedYaw(0.0, 0.0, -15.0, 0.0), lambda u: math.dist(u.position, (0.0, 0.0, -15.0)) < 0.3),
)


def test_offboard_is_flown_by_every_kind_of_setpoint(user: User) -> None:
    user.fly()
    offboard = Offboard(user.system)
    # So high that the vehicle does not sink to the ground under an attitude while this process waits for its turn.
    for number, (name, setpoint, flown) in enumerate(SETPOINTS):
        getattr(offboard, f"set_{name}")(setpoint)
        if number == 0:
            offboard.start()
        user.wait(lambda flown=flown: flown(user))  # type: ignore[misc]
        assert user.said["flight_mode"] == FlightMode.OFFBOARD, name
    offboard.stop()
    user.wait_for_mode(FlightMode.HOLD)


def test_it_goes_round_goes_to_a_place_and_obeys_sticks(user: User) -> None:
    user.fly()
    home, manual = user.said["home"], ManualControl(user.system)
    over_sea = home.absolute_altitude_m + 5.0
    front = OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER
    user.action.do_orbit(5.0, 2.0, front, home.latitude_deg, home.longitude_deg, over_sea)
    user.wait(lambda: abs(math.hypot(*user.position[:2]) - 5.0) < 0.3 and abs(user.speed - 2.0) < 0.1)
    user.action.goto_location(home.latitude_deg, home.longitude_deg, over_sea, 0.0)
    user.wait(lambda: math.dist(user.position, (0.0, 0.0, -5.0)) < 0.3)
    manual.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
    manual.start_position_control()
    user.wait(lambda: user.speed > 1.5, lambda: manual.set_manual_control_input(0.5, 0.0, 0.5, 0.0))
    user.wait(lambda: user.speed < 0.3, lambda: manual.set_manual_control_input(0.0, 0.0, 0.5, 0.0))


def script(port: int) -> Any:
    """Another program, at a port of its own, which has told the vehicle of itself."""
    connection = mavutil.mavlink_connection(f"udpout:{HOST}:{port}", source_system=77)
    connection.mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS, 8, 0, 0, 4)
    heard: set[int] = set()
    while len(heard) < 2:  # the vehicle, and MAVSDK
        beat = connection.recv_match(type="HEARTBEAT", blocking=True, timeout=PATIENCE_S)
        assert beat is not None, heard
        heard.add(beat.get_srcSystem())
    return connection


def test_another_program_is_seen_obeyed_killed_and_back_at_another_port(user: User) -> None:
    """The flight goes on meanwhile."""
    user.fly()
    first = script(user.port)
    first.set_mode_px4(1, 4, 5)
    user.wait_for_mode(FlightMode.RETURN_TO_LAUNCH)
    assert 77 in [each.get_system_id() for each in user.mavsdk.get_systems()]
    first.close()
    user.action.hold()
    user.wait_for_mode(FlightMode.HOLD)
    second = script(user.port)
    second.set_mode_px4(1, 4, 6)
    user.wait_for_mode(FlightMode.LAND)
    second.close()


def test_it_returns_lands_disarms_and_gives_its_log(user: User, tmp_path: Path) -> None:
    user.fly()
    user.action.return_to_launch()
    user.wait_for_mode(FlightMode.RETURN_TO_LAUNCH)
    user.action.land()
    user.wait(lambda: not user.said["armed"])
    assert not user.said["in_air"]
    logs, ended = LogFiles(user.system), threading.Event()
    entry, path = logs.get_entries()[-1], tmp_path / "flight.ulg"

    def hear(result: Any, progress: Any, _: Any) -> None:
        if result != LogFilesResult.NEXT:
            ended.set()

    logs.download_log_file_async(entry, str(path), hear)
    assert ended.wait(PATIENCE_S)
    assert path.stat().st_size == entry.size_bytes
    assert "Landing detected" in [each.message for each in ULog(str(path)).logged_messages]


def test_its_motors_are_stopped_in_the_air_when_it_is_told_to(user: User) -> None:
    """Last: it has crashed then."""
    user.fly()
    user.action.kill()
    user.wait(lambda: not user.said["armed"])
