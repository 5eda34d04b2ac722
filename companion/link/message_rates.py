"""The rates at which telemetry really arrives, against those that are needed: what was asked for is measured, and
asked for again."""

from collections import deque
from collections.abc import Iterable, Mapping

from protocol.messages import dialect

_WINDOW_NS = 1_000_000_000
_MEASURED_NS = 900_000_000
"""Since the first arrival, from when on a low rate is one, and not only the window's beginning."""
_WELCOME_ASKS = 3
_DENIALS = (dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED)


class MessageRates:
    """Counts arrivals over the last second. Rates in Hz, times in ns."""

    def __init__(self, wanted: dict[int, float], least_share: float) -> None:
        self.wanted = wanted
        self._least_share = least_share
        self._arrivals: dict[int, deque[int]] = {
            message_id: deque(maxlen=round(rate) + 1) for message_id, rate in wanted.items()
        }
        self._since: dict[int, int] = {}
        """When each message arrived first."""
        self.denied: set[int] = set()
        """Messages that the vehicle does not send, or not at such a rate: asking again changes nothing."""
        self._welcome: dict[int, float] = {}
        self._asks_left: dict[int, int] = {}
        self._asked: list[int] = []
        self._answers: list[int] = []

    def welcome(self, rates: Mapping[int, float]) -> None:
        """Rates by message, of what is good to have: it is never lacking, and asked for a few times only."""
        for message_id, rate in rates.items():
            if message_id not in self.wanted:
                self._welcome[message_id], self._asks_left[message_id] = rate, _WELCOME_ASKS
                self._arrivals[message_id] = deque(maxlen=1)

    def restart(self) -> None:
        """The vehicle has started anew, and knows nothing of what it was asked for."""
        self.denied.clear()
        for each in self._asks_left:
            self._asks_left[each] = _WELCOME_ASKS
            self._arrivals[each].clear()

    def unheard(self) -> list[int]:
        """What is good to have, never came, and is worth asking for once more."""
        unheard = [each for each, left in self._asks_left.items() if left > 0 and not self._arrivals[each]]
        for each in unheard:
            self._asks_left[each] -= 1
        return unheard

    def count(self, message_id: int, now_ns: int) -> None:
        """One has arrived."""
        arrivals = self._arrivals.get(message_id)
        if arrivals is not None:
            arrivals.append(now_ns)
            self._since.setdefault(message_id, now_ns)

    def ever(self, message_id: int) -> bool:
        """It has come at least once."""
        return message_id in self._since

    def rate(self, message_id: int, now_ns: int) -> float:
        """Arrivals in the last second (at most the wanted rate and one)."""
        arrivals = self._arrivals[message_id]
        while arrivals and now_ns - arrivals[0] >= _WINDOW_NS:
            arrivals.popleft()
        return float(len(arrivals))

    def lacking(self, now_ns: int, part: float = 1.0) -> list[int]:
        """Messages that arrive at less than the least share of their rate, or than a part of it."""
        return [
            message_id
            for message_id, wanted in self.wanted.items()
            if self.rate(message_id, now_ns) < part * wanted * self._least_share
        ]

    def to_ask(self, message_ids: Iterable[int], rate: float | None = None) -> list[tuple[int, float]]:
        """Those of these messages that are worth asking for, each with its interval (us), of `rate` or its own; they
        count as asked for."""
        asked = [message_id for message_id in message_ids if message_id not in self.denied]
        self._asked += asked
        return [(each, 1e6 / (rate or self.wanted.get(each) or self._welcome[each])) for each in asked]

    def answered(self, result: int) -> None:
        """A COMMAND_ACK to one of these has come; it does not say to which."""
        if len(self._answers) < len(self._asked):
            self._answers.append(result)

    def settle(self) -> None:
        """The time for answers to what was asked since the last call is over. Answers come in the order of requests, so
        where each has one, it is known to which it belongs."""
        if len(self._answers) == len(self._asked):
            answers = zip(self._asked, self._answers, strict=True)
            self.denied.update(message_id for message_id, result in answers if result in _DENIALS)
        self._asked.clear()
        self._answers.clear()

    def measured(self, now_ns: int) -> str:
        """What really arrives of all that is wanted, in words."""
        rates = (
            (dialect.mavlink_map[each].msgname, self.rate(each, now_ns), self.wanted[each]) for each in self.wanted
        )
        return ", ".join(f"{name} {rate:.0f} of {wanted:.0f} Hz" for name, rate, wanted in rates)

    def describe(self, message_id: int, now_ns: int) -> str:
        """That it comes too slowly, in words, with the likely cause."""
        name = dialect.mavlink_map[message_id].msgname
        if now_ns - self._since.get(message_id, -_MEASURED_NS) < _MEASURED_NS:
            return f"{name} has begun to arrive: its rate is being measured"
        measured = self.rate(message_id, now_ns)
        cause = (
            "the vehicle denies SET_MESSAGE_INTERVAL for it"
            if message_id in self.denied
            else "does the vehicle have that sensor?"
            if not self.ever(message_id)
            else "another ground station may have asked for less, or the link is too slow"
        )
        return f"telemetry too slow: {name} arrives at {measured:.0f} of {self.wanted[message_id]:.0f} Hz ({cause})"
