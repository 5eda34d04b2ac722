"""What a page may ask of a vehicle when it was started with `--control`: hold, land, return, each after a second look.

A ground station's commands (DO_SET_MODE), sent to the vehicle's own autopilot until it answers; a companion that flies
at the moment sees its mode changed by others and lets go.
"""

from collections.abc import Callable
from typing import Any

from companion.state import FlightMode
from companion.vehicles import firmware_of
from companion.vehicles.firmware import Firmware
from companion.view.gather import Batch
from protocol.messages import Encoder, dialect

SYSTEM, COMPONENT = 255, 190
"""A ground station's usual ids."""
ASKED = {"hold": FlightMode.HOLD, "land": FlightMode.LAND, "return": FlightMode.RETURN}
_BEAT_NS = 1_000_000_000
_AGAIN_NS = 500_000_000
_TRIES = 6
_NOT_FLOWN = 8
_RESULTS = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "rejected for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "not supported",
    dialect.MAV_RESULT_FAILED: "failed",
    dialect.MAV_RESULT_IN_PROGRESS: "in progress",
}


class Control:
    """One vehicle's ground station; `send` takes a datagram to where the vehicle is, `now_ns` is any clock."""

    def __init__(self, send: Callable[[bytes], None], now_ns: Callable[[], int]) -> None:
        self._send = send
        self._now_ns = now_ns
        self._encoder = Encoder(SYSTEM, COMPONENT)
        self._vehicle: tuple[int, int, Firmware] | None = None
        self._beat_due_ns = 0
        self._command: tuple[float, float, float] | None = None
        self._sent = 0
        self._again_ns = 0
        self._wish = ""
        self.answer = ""
        """What became of the last wish, in words."""

    def take(self, batch: Batch) -> None:
        """Learn from the vehicle's heartbeats and answers."""
        topic, _, _, table = batch
        parts = topic.split("/")
        if len(parts) != 5 or parts[1] != "mavlink":
            return
        sender = int(parts[2]), int(parts[3])
        if parts[4] == "HEARTBEAT" and self._vehicle is None:
            firmware = firmware_of(int(table[-1]["autopilot"]))
            if firmware is not None and int(table[-1]["autopilot"]) != _NOT_FLOWN:
                self._vehicle = (*sender, firmware)
        elif parts[4] == "COMMAND_ACK" and self._command is not None and self._vehicle is not None:
            mine = table[(table["command"] == dialect.MAV_CMD_DO_SET_MODE) & _for_us(table)]
            if len(mine) and sender == self._vehicle[:2]:
                self._command = None
                result = int(mine[-1]["result"])
                self.answer = f"{self._wish}: {_RESULTS.get(result, f'result {result}')}"

    def ask(self, wish: str) -> None:
        """One of ASKED. What can't be asked, and every answer, is in `answer`."""
        if self._vehicle is None:
            self.answer = f"{wish}: no vehicle was heard yet"
            return
        self._wish, self.answer = wish, f"{wish}: sent"
        self._command = self._vehicle[2].mode_command(ASKED[wish])
        self._sent = self._again_ns = 0

    def step(self) -> None:
        """Send what is due: a heartbeat each second, and a command until it is answered."""
        now = self._now_ns()
        if now >= self._beat_due_ns:
            self._beat_due_ns = now + _BEAT_NS
            beat = (dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3)
            self._send(self._encoder.encode_fields(dialect.MAVLink_heartbeat_message, *beat))
        if self._command is None or self._vehicle is None or now < self._again_ns:
            return
        if self._sent == _TRIES:
            self._command, self.answer = None, f"{self._wish}: no answer"
            return
        system, component, _ = self._vehicle
        fields = (system, component, dialect.MAV_CMD_DO_SET_MODE, self._sent, *self._command, 0.0, 0.0, 0.0, 0.0)
        self._send(self._encoder.encode_fields(dialect.MAVLink_command_long_message, *fields))
        self._sent += 1
        self._again_ns = now + _AGAIN_NS

    def put_onto(self, server: Any) -> Callable[[], None]:
        """The buttons, each with a question behind it; what is returned shows the latest answer."""
        with server.gui.add_folder("Control"):
            for wish in ASKED:
                button = server.gui.add_button(wish)
                button.on_click(lambda _, wish=wish: self._confirm(server, wish))
            answer = server.gui.add_markdown("")

        def show() -> None:
            answer.content = self.answer

        return show

    def _confirm(self, server: Any, wish: str) -> None:
        with server.gui.add_modal(f"Ask the vehicle to {wish}?") as question:
            sure, rather_not = server.gui.add_button(f"yes, {wish}", color="red"), server.gui.add_button("no")

        def yes(_: Any) -> None:
            question.close()
            self.ask(wish)

        sure.on_click(yes)
        rather_not.on_click(lambda _: question.close())


def _for_us(table: Any) -> Any:
    """Answers to this ground station, or to nobody in particular (before MAVLink 2 there was no addressee)."""
    return (table["target_system"] == 0) | (
        (table["target_system"] == SYSTEM) & (table["target_component"] == COMPONENT)
    )
