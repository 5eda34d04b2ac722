"""A vehicle that is flown by a program. The flight itself is `companion fly` in a process of its own, which is given
orders by a pipe: nothing that the program does can delay it, and if the program dies the vehicle lands."""

import asyncio
import contextlib
import logging
import sys
import tempfile
from collections import deque
from collections.abc import AsyncIterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec

from companion.api.telemetry import Event, State, Telemetry, event_of, state_of
from companion.mission.files import to_toml
from companion.mission.orders import Order
from companion.mission.plan import Delivery, Mission, Waypoint
from companion.outcomes import Verdict, recorded
from companion.records import LOGGED
from companion.runtime.orders import LOG_AT, MOST_BYTES
from protocol.flightlog import TEXT, LogReader

_log = logging.getLogger(__name__)

_LONGEST = 1 << 16
"""Bytes of a line that are kept: a path has fewer."""


class FlightError(Exception):
    """The flight did not begin, ended before what was asked for was done, or refused an order."""


class Companion:
    """One flight of one vehicle; made by `connect`, and used as an asynchronous context manager.

    Each command returns when it is done. One that is cancelled (as by `asyncio.timeout`) leaves the vehicle holding its
    place; only a flight that began with a mission without `waits` then lands. Leaving the block, for whatever reason,
    lands the vehicle where it is.
    """

    def __init__(self, url: str, arguments: tuple[str, ...], vehicle: str, logs: Path | str) -> None:
        self._url, self._arguments, self._vehicle, self._logs = url, arguments, vehicle, Path(logs)
        self._telemetry = Telemetry()
        self._process: asyncio.subprocess.Process | None = None
        self._flight: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()
        """One command alone starts the process."""
        self._left = False
        self._orders = 0
        """Given so far."""
        self._words: deque[str] = deque(maxlen=20)
        """What the process said last."""
        self.log: Path | None = None
        """The flight's log, once that has begun."""
        self.verdict: Verdict | None = None
        """How it came out, once it has ended."""

    @classmethod
    def connect(cls, url: str, *arguments: str, vehicle: str = "paper_quad", logs: Path | str = Path("logs")) -> Self:
        """A vehicle at a URL (as of `companion fly --connect`), which is opened at the take-off.

        `arguments`: more of `companion fly`, such as "--set", "avoidance.method=vfh". `vehicle`: the name or path of
        its file. `logs`: where the flight's folder is made.
        """
        return cls(url, arguments, vehicle, logs)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._left = True
        async with self._starting:  # a process that is being started is waited for, too
            self._hang_up()
        if self._flight is not None:
            await asyncio.shield(self._flight)

    def _hang_up(self) -> None:
        """Give no more orders: the vehicle lands."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()

    # -- commands ------------------------------------------------------------------------------------------------------

    async def take_off(self, height: float) -> None:
        """Take off to a height (m above the ground), and wait there. Raises FlightError, also in the air."""
        if self.state is not None and not self._telemetry.ended:
            raise FlightError("the vehicle is in the air: go_to flies it to another height")
        await self.fly(Mission("script", takeoff_height=height, waits=True))

    async def go_to(self, north: float, east: float, height: float, speed: float | None = None) -> None:
        """Fly around whatever is in the way to a place (m from the take-off), at most at `speed` (m/s; None: a
        mission's default), and wait there. Raises FlightError, also before the take-off."""
        if self._flight is None:
            raise FlightError("the vehicle is not in the air: take_off begins a flight")
        place = Waypoint(north, east, height, speed=speed)
        await self.fly(Mission("go-to", waypoints=[place], waits=True))

    async def deliver(self, release_height: float = 0.5) -> None:
        """Descend to a height (m above the take-off), release the parcel and climb back. Raises FlightError."""
        await self._order(Order("deliver", delivery=Delivery(release_height)))

    async def hold(self) -> None:
        """Stop, and wait. Raises FlightError."""
        await self._order(Order("hold"))

    async def fly(self, mission: Mission) -> Verdict | None:
        """Fly a mission; in the air, all of it but the take-off. Returns how the flight came out, or None if the
        mission ends with waiting. Raises FlightError."""
        mission = msgspec.structs.replace(mission, vehicle=self._vehicle)
        async with self._starting:
            opened = None if self._flight is not None else await self._begin(mission)
        if opened is None:
            await self._order(Order("fly", mission))
            return self.verdict
        try:
            await opened.wait()
            await self._done(0, waits=mission.waits)
        except asyncio.CancelledError:
            if not mission.waits:  # it takes no orders
                self._hang_up()
            raise
        return self.verdict

    async def land(self) -> Verdict:
        """Land where the vehicle is. Returns how the flight came out. Raises FlightError."""
        await self._order(Order("land"))
        assert self.verdict is not None
        return self.verdict

    # -- telemetry -----------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State | None:
        """The latest; None before the flight. There is no new one once the vehicle lands by itself."""
        return self._telemetry.state

    async def states(self) -> AsyncIterator[State]:
        """From now on, until the flight ends; some 50 a second, up to 0.2 s late."""
        async for time_ns, fields in self._telemetry.records(LOGGED.topic):
            yield state_of(time_ns, fields)

    async def events(self) -> AsyncIterator[Event]:
        """What companion and vehicle say from now on, until the flight ends."""
        async for time_ns, fields in self._telemetry.records(TEXT.topic):
            yield event_of(time_ns, fields)

    async def messages(self, name: str) -> AsyncIterator[dict[str, Any]]:
        """The fields of each MAVLink message of that name, such as "BATTERY_STATUS", from now on."""
        async for _, fields in self._telemetry.records(f"/{name}"):
            yield fields

    # -- the process ---------------------------------------------------------------------------------------------------

    async def _begin(self, mission: Mission) -> asyncio.Event:
        """Start the process. The event comes when its log is there, or when it has ended without one."""
        if self._left:
            raise FlightError("the flight is over: its block was left")
        folder = tempfile.TemporaryDirectory()
        file = Path(folder.name) / "mission.toml"  # its name may be none for a file: the flight refuses it then
        file.write_text(to_toml(mission), encoding="utf-8")
        options = ("--connect", self._url, "--log", str(self._logs), "--orders", *self._arguments)
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "companion", "fly", str(file), *options),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,  # an interrupt at the terminal is the program's, which then lands the vehicle
        )
        opened = asyncio.Event()
        self._flight = asyncio.create_task(self._attend(self._process, opened, folder))
        if self._left:  # meanwhile
            self._hang_up()
        return opened

    async def _attend(
        self,
        process: asyncio.subprocess.Process,
        opened: asyncio.Event,
        folder: "tempfile.TemporaryDirectory[str]",
    ) -> None:
        """Listen to the process until it ends. When it says where its log is, it has read its mission in the folder. If
        that fails, the vehicle lands before anybody is told."""
        assert process.stderr is not None
        following: asyncio.Task[None] | None = None
        over = asyncio.ensure_future(process.wait())
        try:
            async for line in lines(process.stderr):
                self._words.append(line)
                _log.debug(line)
                if line.startswith(LOG_AT):
                    self.log = self._log_at(Path(line.removeprefix(LOG_AT)))
                    following = asyncio.create_task(self._telemetry.follow(self.log, over))
                    folder.cleanup()
                    opened.set()
            await over
            if following is not None and self.log is not None:
                await following
                self.verdict = recorded(LogReader(self.log).metadata.get("result", {}))
        except Exception:
            self._hang_up()
            async for _ in lines(process.stderr):  # a full pipe would hold it up
                pass
            await over
            raise
        finally:
            folder.cleanup()
            self._telemetry.end()
            opened.set()

    def _log_at(self, told: Path) -> Path:
        """The log that the process told of. Its own folder has a plain name; those above may have any bytes, or letters
        that the locale of what it says lacks."""
        ours = self._logs / told.parent.name / told.name
        return ours if ours.exists() else told

    async def _order(self, order: Order) -> None:
        """Give an order, and wait until it is done. An order that is not awaited to its end becomes a hold."""
        number = self._send(order)
        try:
            ends = order.do == "land" or (order.mission is not None and not order.mission.waits)
            await self._done(number, waits=not ends)
        except asyncio.CancelledError:
            with contextlib.suppress(FlightError):  # it may have ended at this very moment
                self._send(Order("hold"))
            raise

    def _send(self, order: Order) -> int:
        """Give an order; its number."""
        if self._process is None or self._process.stdin is None or self._telemetry.ended or self.state is None:
            raise FlightError("the vehicle is not in the air")
        line = msgspec.json.encode(order)
        if len(line) > MOST_BYTES:
            raise FlightError(f"an order of {len(line)} bytes: it has at most {MOST_BYTES}, some 2000 waypoints")
        self._process.stdin.write(line + b"\n")
        self._orders += 1
        return self._orders

    async def _done(self, number: int, *, waits: bool) -> None:
        """Until the vehicle waits after the order of that number, or the flight has ended. Raises FlightError, also if
        the order is refused, or another one is flown in its place."""
        telemetry, orders = self._telemetry, self._telemetry.orders

        def is_done() -> bool:
            return waits and number in orders.done

        while not (telemetry.ended or is_done() or number in orders.refused or orders.taken > number):
            await telemetry.news()
            if telemetry.silent and not telemetry.ended:
                raise FlightError(f"nothing is heard of the flight any more: {' / '.join(self._words)}")
        if is_done():
            return
        if number in orders.refused:
            raise FlightError(orders.refused[number])
        if orders.taken > number:
            raise FlightError("another order came")
        if waits or self.verdict is None:
            raise FlightError(self.verdict.text if self.verdict else " / ".join(self._words))


async def lines(stream: asyncio.StreamReader) -> AsyncIterator[str]:
    """What comes by a stream, line by line. What is beyond `_LONGEST` bytes of one is left out."""
    rest = b""
    while data := await stream.read(_LONGEST):
        *whole, rest = (rest + data).split(b"\n")
        for line in whole:
            yield line[:_LONGEST].decode(errors="replace").strip()
        rest = rest[:_LONGEST]
    if rest:
        yield rest.decode(errors="replace").strip()
