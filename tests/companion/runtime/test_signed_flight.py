"""A flight with a key, whoever else speaks: the same to the byte as one without."""

import random
from collections import deque
from pathlib import Path

from companion.autopilot import Autopilot
from companion.runtime.files import load_body, load_settings
from companion.runtime.flight import traffic_of
from companion.runtime.planning import InProcessPlanner, Planning
from companion.runtime.runner import Runner
from companion.state import Output
from companion.supervision.states import State
from protocol.flightlog.reader import digest
from protocol.framing import Framer
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.messages import Encoder, dialect
from protocol.transport import Transport
from tests.companion.runtime.test_runner import HOVER, Queue, opened

KEY, OTHER_KEY = bytes(range(32)), bytes(32 * [9])
SETTINGS = load_settings(None, ["avoidance.method=none"])


class Hostile(Queue):
    """A vehicle that signs, on a line onto which others write: what was recorded, what is unsigned, other keys."""

    def __init__(self) -> None:
        super().__init__()
        self.keeper, self._other, self._draw = Keeper(KEY), Keeper(OTHER_KEY), random.Random(3)
        self._recorded: deque[bytes] = deque(maxlen=500)
        self.attacks = self.refused = 0

    def receive(self, timeout_s: float) -> bytes | None:
        if self._waiting:
            return self._waiting.popleft()
        datagrams = self.vehicle.advance()
        for datagram in datagrams:
            signed = self.keeper.signing.sign(datagram, self.keeper.now())
            wrong = Encoder(1, 1).encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 0, 0, 6, 3)
            tampered = Framer().datagram(signed)[0].raw
            tampered = tampered[:-1] + bytes((tampered[-1] ^ 1,))
            attacks = [wrong, tampered, self._other.signing.sign(datagram, self._other.now())]
            attacks += [self._draw.choice(self._recorded)] if self._recorded else []
            attack = self._draw.choice(attacks)
            self.attacks += 1
            self._waiting += [attack, signed] if self._draw.random() < 0.5 else [signed, attack]
            self._recorded.append(signed)
        return self._waiting.popleft()

    def send(self, data: bytes) -> None:
        link = GuardedLink(_Once(data), self.keeper)
        plain = link.receive(0.0)
        assert plain is not None
        self.vehicle.receive(plain)


class _Once(Queue):
    def __init__(self, data: bytes) -> None:
        self._waiting = deque([data])


def flown(transport: Transport, folder: Path) -> Runner:
    autopilot = Autopilot(SETTINGS, load_body(HOVER.vehicle), HOVER, Output.RATES)
    planning = Planning(InProcessPlanner(SETTINGS.avoidance), SETTINGS.avoidance.answer_delay)
    with opened(folder) as log:
        runner = Runner(autopilot, transport, log, None, planning)
        runner.run()
    assert autopilot.supervisor.state is State.ENDED and autopilot.supervisor.fault is None
    traffic = traffic_of(autopilot, transport)
    assert traffic.messages_lost == traffic.messages_late == traffic.duplicates == 0
    return runner


def test_a_signed_flight_among_attacks_is_the_same_to_the_byte(tmp_path: Path) -> None:
    flown(Queue(), tmp_path / "plain")
    hostile = Hostile()
    link = GuardedLink(hostile, Keeper(KEY))
    flown(link, tmp_path / "signed")
    assert hostile.attacks > 2500
    assert sum(link.refused.values()) + link.bad_frames > hostile.attacks / 2
    assert link.refused["signing_ahead"] == link.refused["signing_crowded"] == 0
    assert min(link.refused[f"signing_{each}"] for each in ("forged", "replayed", "unsigned")) > 100
    log = tmp_path / "signed" / "flight.mcap"
    assert digest(log) == digest(tmp_path / "plain" / "flight.mcap")
    assert KEY not in log.read_bytes()
