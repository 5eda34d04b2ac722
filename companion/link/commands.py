"""Commands to the vehicle: sent again with a rising confirmation until what they ask for is seen, not believed by
their ACK alone."""

from dataclasses import dataclass
from typing import Any

from protocol.messages import dialect

RESULT_NAMES = {
    number: str(entry.name).removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for number, entry in dialect.enums["MAV_RESULT"].items()
}


@dataclass(slots=True)
class _Pending:
    parameters: tuple[float, ...]
    sent_ns: int
    tries: int
    result: int | None


class Commander:
    """Keeps asking. One pending entry a command number; asking for other parameters starts it anew."""

    def __init__(self, interval_s: float) -> None:
        self._interval_ns = round(interval_s * 1e9)
        self._pending: dict[int, _Pending] = {}

    def ask(
        self, command: int, parameters: tuple[float, ...], now_ns: int, target: tuple[int, int]
    ) -> tuple[type[Any], tuple[Any, ...]] | None:
        """COMMAND_LONG's class and fields if it is time to send it (again); call at each tick while it is wanted."""
        pending = self._pending.get(command)
        if pending is None or pending.parameters != parameters:
            pending = self._pending[command] = _Pending(parameters, now_ns - self._interval_ns, 0, None)
        wait = self._interval_ns * (4 if pending.result == dialect.MAV_RESULT_IN_PROGRESS else 1)
        if now_ns - pending.sent_ns < wait:
            return None
        pending.sent_ns = now_ns
        pending.tries += 1
        padded = parameters + (0.0,) * (7 - len(parameters))
        return dialect.MAVLink_command_long_message, (*target, command, min(pending.tries - 1, 255), *padded)

    def answered(self, message: Any) -> None:
        """COMMAND_ACK (77)."""
        pending = self._pending.get(message.command)
        if pending is not None:
            pending.result = message.result

    def accepted(self, command: int) -> bool:
        """The latest answer to what is asked now was "accepted"."""
        pending = self._pending.get(command)
        return pending is not None and pending.result == dialect.MAV_RESULT_ACCEPTED

    def tries(self, command: int) -> int:
        """How often it was sent."""
        pending = self._pending.get(command)
        return 0 if pending is None else pending.tries

    def exhausted(self, command: int, tries: int, now_ns: int) -> bool:
        """It was sent so often, and the last one has had its time."""
        pending = self._pending.get(command)
        return pending is not None and pending.tries >= tries and now_ns - pending.sent_ns >= self._interval_ns

    def answer(self, command: int) -> str:
        """The latest answer in words."""
        pending = self._pending.get(command)
        if pending is None or pending.result is None:
            return "no answer"
        return RESULT_NAMES.get(pending.result, f"result {pending.result}")

    def forget(self, command: int) -> None:
        """What was asked is there, or not wanted any more."""
        self._pending.pop(command, None)
