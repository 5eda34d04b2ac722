"""The buttons of a page that was started with `--control`: hold, land, return, go to a place, and resume, which gives
the vehicle back to the companion that flew it. Each asks for confirmation.

The page sends a ground station's commands (DO_SET_MODE, DO_REPOSITION) to the vehicle's own autopilot until it answers.
A companion that flies at that time sees its mode changed by others, and waits to be given control back.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from companion.link.firmware import firmware_of
from companion.link.firmware.firmware import Firmware
from companion.state import FlightMode
from companion.view.batches import Batch, sender_and_name
from companion.view.lines import Floats
from companion.view.live_scene import FLAG
from companion.view.live_words import paragraphs
from companion.view.scene import in_the_way
from protocol.arrays import Array
from protocol.frames import enu_to_ned, to_geodetic
from protocol.messages import Encoder, dialect

SYSTEM, COMPONENT = 255, 190
"""The usual ids of a ground station."""
REQUESTS = {
    "hold": FlightMode.HOLD,
    "resume": FlightMode.EXTERNAL,
    "land": FlightMode.LAND,
    "return": FlightMode.RETURN,
}
GO_TO = "go to"
_CONFIRMATIONS = {
    "hold": "The vehicle stops, and stays where it is. A companion that flies it waits to be given control back.",
    "land": "The vehicle comes down where it is, whatever is below it.",
    "resume": "The vehicle obeys its companion again, which goes on with its mission. It is refused where no companion "
    "sends setpoints.",
    "return": "The vehicle flies home by itself. It looks out for nothing on its way.",
}
_SAFE = frozenset({"hold", "land", "return"})
"""What makes a flight safer. The others begin something."""
_HINT = "hold, land, return and resume ask for confirmation; go to takes the next click on the ground"
_HEARTBEAT_NS = 1_000_000_000
_STREAMS = {
    "LOCAL_POSITION_NED": dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    "ATTITUDE_QUATERNION": dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
}
"""What moves the picture, by name and number of the message."""
_SLOW_HZ, _SMOOTH_HZ = 5, 30
_COUNTED_NS = 2_000_000_000
_RETRY_NS = 500_000_000
_TRIES = 6
_FARTHEST_M = 1000.0
"""A click farther than this (m) from the vehicle, near the horizon, is not taken for a place."""
_FARTHEST_TOLD_M = 1e5
_LOWEST_M, _HIGHEST_M = 0.5, 120.0
_RESULTS = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "rejected for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "not supported",
    dialect.MAV_RESULT_FAILED: "failed",
    dialect.MAV_RESULT_IN_PROGRESS: "in progress",
}


_Place = tuple[Array, tuple[float, float, float]]
"""(3,) in the vehicle's NED (m), and latitude, longitude (rad) and altitude (m)."""


@dataclass(slots=True)
class _Request:
    """A command that is sent until it is answered."""

    text: str
    command: int
    target: tuple[int, int]
    """System and component."""
    encode: Callable[[tuple[int, int], int], bytes]
    """Makes the datagram from the target, and how often the command was sent before."""
    sent: int = 0
    retry_ns: int = 0
    answered: bool = False


@dataclass(slots=True)
class _Vehicle:
    """One that is heard, and where it says that it is."""

    firmware: Firmware
    home: _Place | None = None
    here: _Place | None = None
    position_ned: Array | None = None
    counted_from_ns: int | None = None
    heard: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_STREAMS, 0))
    """How many of _STREAMS have come since then."""
    times_asked: int = 0
    """For more of them."""


class Control:
    """The ground station of the vehicles of a link, for one of them at a time. `send` takes a datagram to all, `now_ns`
    is any monotonic clock."""

    def __init__(self, send: Callable[[bytes], None], now_ns: Callable[[], int]) -> None:
        self._send = send
        self._now_ns = now_ns
        self._encoder = Encoder(SYSTEM, COMPONENT)
        self._vehicles: dict[tuple[int, int], _Vehicle] = {}
        self._target: tuple[int, int] | None = None
        """Whom requests go to: the first that was heard, unless another one was chosen."""
        self._heartbeat_due_ns = 0
        self._request: _Request | None = None
        self.answer = ""
        """What became of the last request, in words."""

    def take(self, batch: Batch) -> None:
        """Learn from what the vehicle says."""
        topic, _, _, table = batch
        message = sender_and_name(topic)
        if message is None:
            return
        sender, name = _ids(message[0]), message[1]
        if name == "HEARTBEAT" and sender not in self._vehicles:
            firmware = firmware_of(int(table[-1]["autopilot"]))
            if firmware is not None and int(table[-1]["autopilot"]) != dialect.MAV_AUTOPILOT_INVALID:
                self._vehicles[sender] = _Vehicle(firmware)
                self._target = self._target or sender
        vehicle = self._vehicles.get(sender)
        if vehicle is None:
            return
        if name in _STREAMS:
            vehicle.heard[name] += len(table)
        if name == "COMMAND_ACK":
            self._answered(sender, table)
        elif name == "HOME_POSITION":
            vehicle.home = _place(_ned(table[-1]), table[-1], "latitude", "longitude", "altitude") or vehicle.home
        elif name == "LOCAL_POSITION_NED":
            vehicle.position_ned = _ned(table[-1])
        elif name == "GLOBAL_POSITION_INT":
            vehicle.here = _place(vehicle.position_ned, table[-1], "lat", "lon", "alt") or vehicle.here

    def choose(self, sender: str) -> None:
        """Send what is asked from now on to this vehicle ("system/component"), once it is heard."""
        self._target = _ids(sender)

    def _answered(self, sender: tuple[int, int], table: Any) -> None:
        """The last answer counts: PX4 answers twice."""
        request = self._request
        if request is None or not request.sent or sender != request.target:
            return
        mine = table[(table["command"] == request.command) & _for_us(table)]
        if not len(mine):
            return
        result = int(mine[-1]["result"])
        request.answered = True
        self.answer = f"{request.text}: {_RESULTS.get(result, f'result {result}')}"

    def ask(self, request: str) -> None:
        """Ask for one of REQUESTS. Why it can't be asked for, and every answer, is in `answer`."""
        if self._target is None or self._target not in self._vehicles:
            self.answer = f"{request}: no vehicle was heard yet"
            return
        firmware = self._vehicles[self._target].firmware
        command, mode = dialect.MAV_CMD_DO_SET_MODE, firmware.mode_command(REQUESTS[request])

        def encode(target: tuple[int, int], sent: int) -> bytes:
            fields = (*target, command, sent, *mode, 0.0, 0.0, 0.0, 0.0)
            return self._encoder.encode_fields(dialect.MAVLink_command_long_message, *fields)

        self._begin(_Request(request, command, self._target, encode))

    def send_to(self, target_ned: Floats) -> None:
        """Ask the vehicle to fly to a place (3,) in its own NED (m).

        The place is sent in latitude and longitude, relative to the vehicle's home, which PX4 and ArduPilot tell in
        both kinds of coordinates, or else to its present position.
        """
        vehicle = None if self._target is None else self._vehicles.get(self._target)
        known = None if vehicle is None else vehicle.home or vehicle.here
        if self._target is None or known is None:
            self.answer = f"{GO_TO}: the vehicle has not said where on earth it is"
            return
        if refused := out_of_bounds(target_ned):
            self.answer = f"{GO_TO}: {refused}"
            return
        latitude, longitude, altitude = to_geodetic(np.asarray(target_ned, np.float64) - known[0], known[1])
        degrees_e7 = round(math.degrees(latitude) * 1e7), round(math.degrees(longitude) * 1e7)
        command, frame = dialect.MAV_CMD_DO_REPOSITION, dialect.MAV_FRAME_GLOBAL_INT
        at_its_speed, change_mode, keep_heading = -1.0, float(dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE), math.nan
        wanted = (at_its_speed, change_mode, 0.0, keep_heading, *degrees_e7, altitude)

        def encode(target: tuple[int, int], sent: int) -> bytes:
            fields = (*target, frame, command, 0, 0, *wanted)
            return self._encoder.encode_fields(dialect.MAVLink_command_int_message, *fields)

        self._begin(_Request(f"{GO_TO} {place_words(target_ned)}", command, self._target, encode))

    def _begin(self, request: _Request) -> None:
        self.answer = f"{request.text}: sent"
        self._request = request

    def step(self) -> None:
        """Send what is due: a heartbeat each second, and a command until it is answered."""
        now, request = self._now_ns(), self._request
        if now >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now + _HEARTBEAT_NS
            heartbeat = (dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3)
            self._send(self._encoder.encode_fields(dialect.MAVLink_heartbeat_message, *heartbeat))
            for target, vehicle in self._vehicles.items():
                self._ask_for_streams(target, vehicle, now)
        if request is None or request.answered or now < request.retry_ns:
            return
        if request.sent == _TRIES:
            self._request, self.answer = None, f"{request.text}: no answer"
            return
        self._send(request.encode(request.target, request.sent))
        request.sent += 1
        request.retry_ns = now + _RETRY_NS

    def _ask_for_streams(self, target: tuple[int, int], vehicle: _Vehicle, now_ns: int) -> None:
        """Ask for position and attitude where they come seldom: PX4 tells a ground station its place once a second.
        Streams that are fast enough are left alone, as they may be those of a companion on the same link."""
        since = vehicle.counted_from_ns
        if since is not None and now_ns - since < _COUNTED_NS:
            return
        command, interval_us = dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 1e6 / _SMOOTH_HZ
        for name, number in _STREAMS.items():
            if (
                since is not None
                and vehicle.times_asked < 2 * _TRIES
                and vehicle.heard[name] * 1e9 < _SLOW_HZ * (now_ns - since)
            ):
                fields = (*target, command, 0, number, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0)
                self._send(self._encoder.encode_fields(dialect.MAVLink_command_long_message, *fields))
                vehicle.times_asked += 1
        vehicle.counted_from_ns, vehicle.heard = now_ns, dict.fromkeys(_STREAMS, 0)


class Panel:
    """The buttons, each with a confirmation. `here` gives the vehicle's position (3,) NED (m), `world` the world's
    file."""

    def __init__(
        self, server: Any, control: Control, here: Callable[[], Floats | None], world: Callable[[], bytes]
    ) -> None:
        self._server, self._control, self._here, self._world = server, control, here, world
        self._aim_says = ""
        """What to click; empty unless a click is expected."""
        with server.gui.add_folder("Control"):
            buttons = server.gui.add_button_group("ask to", (*REQUESTS, f"{GO_TO} …"), hint=_HINT)
            buttons.on_click(lambda event: self._press(event.target.value))
            self._answer = server.gui.add_html("")
        self._flag = server.scene.add_line_segments(
            "/asked", np.zeros((1, 2, 3)), FLAG, thickness=4.0, thickness_units="screen", visible=False
        )
        self._spot = server.scene.add_icosphere("/asked_spot", 0.25, color=FLAG, visible=False)
        self._name = server.scene.add_label("/asked_name", "", visible=False, anchor="bottom-center")

    def show(self) -> None:
        """Show the latest answer, and what to click."""
        self._answer.content = paragraphs(self._control.answer, self._aim_says)

    def _press(self, button: str) -> None:
        if button in REQUESTS:
            self._confirm(button)
        else:
            self._aim()

    def _confirm(self, request: str) -> None:
        self._stop_aiming()
        with self._dialog(f"Ask the vehicle to {request}?") as dialog:
            self._server.gui.add_html(paragraphs(_CONFIRMATIONS[request]))
            self._buttons(dialog, request, lambda: self._ask(request), lambda: None)

    def _ask(self, request: str) -> None:
        self._control.ask(request)
        self._mark(None)

    @contextlib.contextmanager
    def _dialog(self, title: str) -> Iterator[Any]:
        """A dialog that is sent once it is whole: what is pressed before a button has its function is lost."""
        with self._server.atomic(), self._server.gui.add_modal(title) as dialog:
            yield dialog

    def _buttons(self, dialog: Any, request: str, confirmed: Callable[[], None], cancelled: Callable[[], None]) -> None:
        yes = self._server.gui.add_button(f"yes, {request}", color="blue" if request in _SAFE else "orange")
        no = self._server.gui.add_button("no")

        def close(then: Callable[[], None]) -> None:
            dialog.close()
            then()

        yes.on_click(lambda _: close(confirmed))
        no.on_click(lambda _: close(cancelled))

    def _aim(self) -> None:
        """Take the next click on the ground for the place, or, while a click is expected, stop expecting it."""
        if self._aim_says:
            self._stop_aiming()
            return
        self._aim_says = "click on the ground, or on the button again for nowhere"
        self._server.scene.on_click()(self._clicked)

    def _stop_aiming(self) -> None:
        if self._aim_says:
            self._aim_says = ""
            self._server.scene.remove_click_callback(self._clicked)

    def _clicked(self, event: Any) -> None:
        here, place = self._here(), on_ground(event.ray_origin, event.ray_direction)
        if here is None:
            self._aim_says = "where the vehicle is is not known: click again later"
        elif place is None or math.dist(place[:2], here[:2]) > _FARTHEST_M:
            self._aim_says = f"that is the sky, or more than {_FARTHEST_M:.0f} m away: click on the ground"
        else:
            self._stop_aiming()
            self._ask_height(place, here)

    def _ask_height(self, place: Floats, here: Floats) -> None:
        """Ask for confirmation and height, with what is known to stand in the way."""
        gui = self._server.gui
        height = round(min(max(-float(here[2]), _LOWEST_M), _HIGHEST_M), 1)

        def target() -> Floats:
            return np.array([place[0], place[1], -float(number.value)])

        def describe(_: Any = None) -> None:
            text.content = go_to_words(here, target(), self._world())
            self._mark(target())

        with self._dialog(f"{GO_TO.capitalize()} {place_words(place)}?") as dialog:
            number = gui.add_number("height, m", height, min=_LOWEST_M, max=_HIGHEST_M, step=0.1)
            text = gui.add_html("")
            self._buttons(dialog, GO_TO, lambda: self._control.send_to(target()), lambda: self._mark(None))
            number.on_update(describe)
            describe()

    def _mark(self, target_ned: Floats | None) -> None:
        """Mark the place (3,) that the vehicle was asked to fly to; None removes the mark."""
        self._flag.visible = self._spot.visible = self._name.visible = target_ned is not None
        if target_ned is not None:
            top = enu_to_ned(np.asarray(target_ned, np.float64))
            self._flag.points = np.array([[[top[0], top[1], 0.0], top]])
            self._spot.position = self._name.position = top
            self._name.text = f"{GO_TO}: {place_words(target_ned)}"


def on_ground(origin_enu: tuple[float, ...], direction_enu: tuple[float, ...]) -> Floats | None:
    """Where a ray from a camera meets the ground, (3,) NED (m); None if it goes up.

    Origin (m) and direction of the ray are east, north, up.
    """
    if direction_enu[2] >= 0.0 or origin_enu[2] <= 0.0:
        return None
    reach = -origin_enu[2] / direction_enu[2]
    east, north, _ = (np.array(origin_enu) + reach * np.array(direction_enu)).tolist()
    return np.array([north, east, 0.0])


def place_words(place_ned: Floats) -> str:
    """A place (3,) in words, with its height unless it is on the ground."""
    north, east, down = place_ned.tolist()
    return f"north {north:.1f}, east {east:.1f}" + (f", {-down:.1f} m high" if down else "")


def out_of_bounds(target_ned: Floats) -> str:
    """Why the vehicle is not sent to a place (3,), in words; empty unless it is too high or too low."""
    height = -float(target_ned[2])
    return "" if _LOWEST_M <= height <= _HIGHEST_M else f"{height:.1f} m is not between {_LOWEST_M} and {_HIGHEST_M} m"


def go_to_words(here_ned: Floats, target_ned: Floats, world: bytes) -> str:
    """What asks for confirmation of a flight between two places (3,), as HTML; `world` is the world's file."""
    if refused := out_of_bounds(target_ned):
        return paragraphs(f"Not sent: {refused}.")
    distance = math.dist(here_ned, target_ned)
    text = f"To {place_words(target_ned)}: {distance:.0f} m, straight. Nothing is avoided on the way."
    standing = in_the_way(world, here_ned, target_ned)
    return paragraphs(text, f"In the way: {', '.join(standing)}." if standing else "")


def _ids(sender: str) -> tuple[int, int]:
    system, _, component = sender.partition("/")
    return int(system), int(component)


def _ned(row: Any) -> Array | None:
    """None for what is not a number or too far away to be true."""
    place = np.array([row["x"], row["y"], row["z"]], np.float64)
    return place if (abs(place) <= _FARTHEST_TOLD_M).all() else None


def _place(place_ned: Array | None, row: Any, latitude: str, longitude: str, altitude: str) -> _Place | None:
    """A place with its fields in 1e-7 degrees and mm; None where either is not known."""
    degrees = row[latitude] * 1e-7, row[longitude] * 1e-7
    unknown = degrees == (0.0, 0.0)  # as of a vehicle without a fix
    if place_ned is None or unknown or abs(degrees[0]) > 90.0 or abs(degrees[1]) > 180.0:
        return None
    return place_ned, (math.radians(degrees[0]), math.radians(degrees[1]), float(row[altitude]) * 1e-3)


def _for_us(table: Any) -> Any:
    """(n,) whether answers are for this ground station; those without an addressee (MAVLink 1) are for everybody."""
    return (table["target_system"] == 0) | (
        (table["target_system"] == SYSTEM) & (table["target_component"] == COMPONENT)
    )
