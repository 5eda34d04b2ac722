"""SERIAL_CONTROL: a small shell, with what PX4's answers for parameters and its version. Other serial ports are not
there, and an empty answer says so."""

from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.outbox import Channel, Outbox
from vehicle_sim.services.parameter_store import Parameters

PROMPT = "pxh> "
_PIECE_BYTES = 70
_LONGEST_LINE = 200
_MOST_SHOWN = 60
"""Parameters at once."""


class ShellService:
    """Runs the lines that come. Each link has a line of its own that is not yet whole."""

    capabilities = 0

    def __init__(
        self, parameters: Parameters, identity: Identity, outbox: Outbox, tell: Callable[[list[str]], None]
    ) -> None:
        """`tell` tells all which parameters have changed."""
        self._parameters = parameters
        self._identity = identity
        self._outbox = outbox
        self._tell = tell
        self._lines: dict[Channel, str] = {}
        self.handlers: dict[int, Callable[[Any], None]] = {dialect.MAVLINK_MSG_ID_SERIAL_CONTROL: self._handle}
        self._commands: dict[str, Callable[[list[str]], str]] = {
            "help": lambda _: "help, ver, param show [NAME or BEGINNING*], param set NAME VALUE",
            "ver": lambda _: f"PX4 version: {'.'.join(map(str, self._identity.firmware))} (simulated vehicle)",
            "param": self._param,
        }

    def _handle(self, message: Any) -> None:
        if message.flags & dialect.SERIAL_CONTROL_FLAG_REPLY:
            return
        if message.device != dialect.SERIAL_CONTROL_DEV_SHELL:
            self._say(message.device, b"")
            return
        here, channels = self._outbox.here, self._outbox.channels
        self._lines = {channel: line for channel, line in self._lines.items() if channel in channels}
        typed = bytes(message.data[: message.count]).decode("ascii", "replace").replace("\r", "\n")
        *lines, rest = (self._lines.get(here, "") + typed).split("\n")
        self._lines[here] = rest[:_LONGEST_LINE]
        text = "".join(f"{self._run(line.split())}\n{PROMPT}" if line.strip() else PROMPT for line in lines)
        data = text.encode("ascii", "replace")
        for start in range(0, len(data), _PIECE_BYTES):
            self._say(message.device, data[start : start + _PIECE_BYTES])

    def _say(self, device: int, data: bytes) -> None:
        padded = list(data.ljust(_PIECE_BYTES, b"\0"))
        flags = dialect.SERIAL_CONTROL_FLAG_REPLY
        self._outbox.send(dialect.MAVLink_serial_control_message, device, flags, 0, 0, len(data), padded)

    def _run(self, words: list[str]) -> str:
        command = self._commands.get(words[0])
        return f"{words[0]}: command not found, try help" if command is None else command(words[1:])

    def _param(self, words: list[str]) -> str:
        match words:
            case ["show"]:
                return self._show("*")
            case ["show", pattern]:
                return self._show(pattern)
            case ["set", name, text]:
                return self._set(name, text)
        return "param show [NAME or BEGINNING*], param set NAME VALUE"

    def _show(self, pattern: str) -> str:
        parameters = self._parameters
        beginning = pattern.removesuffix("*")
        found = [
            name
            for name in parameters.names
            if name == pattern or (name.startswith(beginning) and pattern != beginning)
        ]
        lines = [f"{name} : {parameters[name]:.9g}" for name in found[:_MOST_SHOWN]]
        if len(found) > _MOST_SHOWN:
            lines.append(f"... {len(found) - _MOST_SHOWN} more: param show BEGINNING*")
        return "\n".join(lines) or f"{pattern}: no such parameter"

    def _set(self, name: str, text: str) -> str:
        try:
            refusal = self._parameters.set(name, self._parameters.parse(name, text))
        except (ValueError, OverflowError):
            return f"{name}: {text} is no value"
        if refusal is not None:
            return f"{name}: {refusal.name.lower().replace('_', ' ')}"
        self._tell([name])
        return self._show(name)
