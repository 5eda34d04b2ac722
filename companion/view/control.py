"""What a page may ask of a vehicle when it was started with `--control`, each after a second look: hold, land, return,
go to a place, and resume, which gives it back to the companion that flew it.

A ground station's commands (DO_SET_MODE, DO_REPOSITION), sent to the vehicle's own autopilot until it answers. A
companion that flies at the moment sees its mode changed by others, and waits to be given control back.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.link.firmware import firmware_of
from companion.link.firmware.firmware import Firmware
from companion.state import FlightMode
from companion.view.batches import Batch
from companion.view.lines import Floats
from companion.view.scene import in_the_way
from protocol.arrays import Array
from protocol.frames import enu_to_ned, to_geodetic
from protocol.messages import Encoder, dialect

SYSTEM, COMPONENT = 255, 190
"""A ground station's usual ids."""
ASKED = {
    "hold": FlightMode.HOLD,
    "resume": FlightMode.EXTERNAL,
    "land": FlightMode.LAND,
    "return": FlightMode.RETURN,
}
GO_TO = "go to"
_QUESTIONS = {
    "hold": "The vehicle stops, and stays where it is. A companion that flies it waits to be given control back.",
    "land": "The vehicle comes down where it is, whatever is below it.",
    "resume": "The vehicle obeys its companion again, which goes on with its mission. It is refused where no companion "
    "sends setpoints.",
    "return": "The vehicle flies home by itself. It looks out for nothing on its way.",
}
_BEAT_NS = 1_000_000_000
_AGAIN_NS = 500_000_000
_TRIES = 6
_NOT_FLOWN = 8
_FARTHEST_M = 1000.0
"""From the vehicle to a click; one near the horizon is hardly meant."""
_LOWEST_M, _HIGHEST_M = 0.5, 120.0
_FLAG = (190, 60, 200)
_RESULTS = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "rejected for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "not supported",
    dialect.MAV_RESULT_FAILED: "failed",
    dialect.MAV_RESULT_IN_PROGRESS: "in progress",
}


@dataclass(slots=True)
class _Wish:
    """A command on its way."""

    text: str
    command: int
    encode: Callable[[tuple[int, int], int], bytes]
    """Of the target's system and component, and how often it was sent before."""
    sent: int = 0
    again_ns: int = 0
    answered: bool = False


class Control:
    """One vehicle's ground station; `send` takes a datagram to where the vehicle is, `now_ns` is any clock."""

    def __init__(self, send: Callable[[bytes], None], now_ns: Callable[[], int]) -> None:
        self._send = send
        self._now_ns = now_ns
        self._encoder = Encoder(SYSTEM, COMPONENT)
        self._vehicle: tuple[int, int, Firmware] | None = None
        self._beat_due_ns = 0
        self._wish: _Wish | None = None
        self._home: tuple[Array, tuple[float, float, float]] | None = None
        self._here: tuple[Array, tuple[float, float, float]] | None = None
        self._place = np.zeros(3)
        self.answer = ""
        """What became of the last wish, in words."""

    def take(self, batch: Batch) -> None:
        """Learn from what the vehicle says."""
        topic, _, _, table = batch
        parts = topic.split("/")
        if len(parts) != 5 or parts[1] != "mavlink":
            return
        sender, name = (int(parts[2]), int(parts[3])), parts[4]
        if name == "HEARTBEAT" and self._vehicle is None:
            firmware = firmware_of(int(table[-1]["autopilot"]))
            if firmware is not None and int(table[-1]["autopilot"]) != _NOT_FLOWN:
                self._vehicle = (*sender, firmware)
        if self._vehicle is None or sender != self._vehicle[:2]:
            return
        if name == "COMMAND_ACK":
            self._answered(table)
        elif name == "HOME_POSITION":
            self._home = _ned(table[-1]), _on_earth(table[-1], "latitude", "longitude", "altitude")
        elif name == "LOCAL_POSITION_NED":
            self._place = _ned(table[-1])
        elif name == "GLOBAL_POSITION_INT":
            self._here = self._place, _on_earth(table[-1], "lat", "lon", "alt")

    def _answered(self, table: Any) -> None:
        """PX4 answers twice, and what it says last is what it does."""
        wish = self._wish
        if wish is None or not wish.sent:
            return
        mine = table[(table["command"] == wish.command) & _for_us(table)]
        if not len(mine):
            return
        result = int(mine[-1]["result"])
        wish.answered = True
        self.answer = f"{wish.text}: {_RESULTS.get(result, f'result {result}')}"

    def ask(self, wish: str) -> None:
        """One of ASKED. What can't be asked, and every answer, is in `answer`."""
        if self._vehicle is None:
            self.answer = f"{wish}: no vehicle was heard yet"
            return
        command, mode = dialect.MAV_CMD_DO_SET_MODE, self._vehicle[2].mode_command(ASKED[wish])

        def encode(target: tuple[int, int], sent: int) -> bytes:
            fields = (*target, command, sent, *mode, 0.0, 0.0, 0.0, 0.0)
            return self._encoder.encode_fields(dialect.MAVLink_command_long_message, *fields)

        self._begin(_Wish(wish, command, encode))

    def send_to(self, target_ned: Floats) -> None:
        """To a place (3,) in the vehicle's own NED, by way of the earth's coordinates: those of its home, which PX4 and
        ArduPilot tell in both, or else its own of this moment."""
        known = self._home or self._here
        if self._vehicle is None or known is None:
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

        self._begin(_Wish(f"{GO_TO} {place_words(target_ned)}", command, encode))

    def _begin(self, wish: _Wish) -> None:
        self.answer = f"{wish.text}: sent"
        self._wish = wish

    def step(self) -> None:
        """Send what is due: a heartbeat each second, and a command until it is answered."""
        now, wish = self._now_ns(), self._wish
        if now >= self._beat_due_ns:
            self._beat_due_ns = now + _BEAT_NS
            beat = (dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3)
            self._send(self._encoder.encode_fields(dialect.MAVLink_heartbeat_message, *beat))
        if wish is None or self._vehicle is None or wish.answered or now < wish.again_ns:
            return
        if wish.sent == _TRIES:
            self._wish, self.answer = None, f"{wish.text}: no answer"
            return
        self._send(wish.encode(self._vehicle[:2], wish.sent))
        wish.sent += 1
        wish.again_ns = now + _AGAIN_NS


class Panel:
    """The buttons, each with a question behind it. `here`: where the vehicle is (3,) NED; `world`: what is drawn."""

    def __init__(
        self, server: Any, control: Control, here: Callable[[], Floats | None], world: Callable[[], bytes]
    ) -> None:
        self._server, self._control, self._here, self._world = server, control, here, world
        self._aim_says = ""
        """What to click, while a click is waited for."""
        with server.gui.add_folder("Control"):
            for wish in ASKED:
                button = server.gui.add_button(wish)
                button.on_click(lambda _, wish=wish: self._confirm(wish))
            aim = server.gui.add_button(f"{GO_TO} …", hint="a place on the ground, which is clicked next")
            aim.on_click(lambda _: self._aim())
            self._answer = server.gui.add_markdown("")
        self._flag = server.scene.add_line_segments(
            "/asked", np.zeros((1, 2, 3)), _FLAG, thickness=4.0, thickness_units="screen", visible=False
        )
        self._spot = server.scene.add_icosphere("/asked_spot", 0.25, color=_FLAG, visible=False)

    def show(self) -> None:
        """The latest answer."""
        self._answer.content = "\n\n".join(filter(None, (self._control.answer, self._aim_says)))

    def _confirm(self, wish: str) -> None:
        self._stop_aiming()
        with self._server.gui.add_modal(f"Ask the vehicle to {wish}?") as question:
            self._server.gui.add_markdown(_QUESTIONS[wish])
            self._buttons(question, wish, lambda: self._ask(wish), lambda: None)

    def _ask(self, wish: str) -> None:
        self._control.ask(wish)
        self._plant(None)

    def _buttons(self, question: Any, wish: str, wanted: Callable[[], None], not_wanted: Callable[[], None]) -> None:
        sure = self._server.gui.add_button(f"yes, {wish}", color="red")
        rather_not = self._server.gui.add_button("no")

        def close(then: Callable[[], None]) -> None:
            question.close()
            then()

        sure.on_click(lambda _: close(wanted))
        rather_not.on_click(lambda _: close(not_wanted))

    def _aim(self) -> None:
        """The next click on the ground is the place; asked once more, it is not."""
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
        """The question names place and height, and what is known to stand in the way."""
        gui = self._server.gui
        height = round(min(max(-float(here[2]), _LOWEST_M), _HIGHEST_M), 1)
        with gui.add_modal(f"{GO_TO.capitalize()} {place_words(place)}?") as question:
            number = gui.add_number("height, m", height, min=_LOWEST_M, max=_HIGHEST_M, step=0.1)
            text = gui.add_markdown("")
            self._buttons(question, GO_TO, lambda: self._control.send_to(target()), lambda: self._plant(None))

        def target() -> Floats:
            return np.array([place[0], place[1], -float(number.value)])

        def describe(_: Any = None) -> None:
            text.content = go_to_words(here, target(), self._world())
            self._plant(target())

        number.on_update(describe)
        describe()

    def _plant(self, target_ned: Floats | None) -> None:
        """A flag where it was asked to go."""
        self._flag.visible = self._spot.visible = target_ned is not None
        if target_ned is not None:
            top = enu_to_ned(np.asarray(target_ned, np.float64))
            self._flag.points = np.array([[[top[0], top[1], 0.0], top]])
            self._spot.position = top


def on_ground(origin_enu: tuple[float, ...], direction_enu: tuple[float, ...]) -> Floats | None:
    """(3,) NED: where a ray meets the ground; None if it goes up."""
    if direction_enu[2] >= 0.0 or origin_enu[2] <= 0.0:
        return None
    reach = -origin_enu[2] / direction_enu[2]
    east, north, _ = (np.array(origin_enu) + reach * np.array(direction_enu)).tolist()
    return np.array([north, east, 0.0])


def place_words(place_ned: Floats) -> str:
    """With its height, unless that is the ground's."""
    north, east, down = place_ned.tolist()
    return f"north {north:.1f}, east {east:.1f}" + (f", {-down:.1f} m high" if down else "")


def out_of_bounds(target_ned: Floats) -> str:
    """Why nobody is sent to a place (3,), in words; empty for one that is not too high or low."""
    height = -float(target_ned[2])
    return "" if _LOWEST_M <= height <= _HIGHEST_M else f"{height:.1f} m is not between {_LOWEST_M} and {_HIGHEST_M} m"


def go_to_words(here_ned: Floats, target_ned: Floats, world: bytes) -> str:
    """What the question says."""
    if refused := out_of_bounds(target_ned):
        return f"**Not sent: {refused}.**"
    distance = math.dist(here_ned, target_ned)
    text = f"To **{place_words(target_ned)}**: {distance:.0f} m, straight. Nothing is avoided on the way."
    standing = in_the_way(world, here_ned, target_ned)
    return f"{text}\n\n**In the way: {', '.join(standing)}.**" if standing else text


def _ned(row: Any) -> Array:
    return np.array([row["x"], row["y"], row["z"]], np.float64)


def _on_earth(row: Any, latitude: str, longitude: str, altitude: str) -> tuple[float, float, float]:
    """1e-7 degrees and mm, as rad and m."""
    return math.radians(row[latitude] * 1e-7), math.radians(row[longitude] * 1e-7), float(row[altitude]) * 1e-3


def _for_us(table: Any) -> Any:
    """Answers to this ground station, or to nobody in particular (before MAVLink 2 there was no addressee)."""
    return (table["target_system"] == 0) | (
        (table["target_system"] == SYSTEM) & (table["target_component"] == COMPONENT)
    )
