"""Processes that are killed, stopped or asked to end in mid flight: the real ones, in real time, over UDP."""

import os
import signal
import time
from collections.abc import Collection, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import msgspec
import numpy as np

from companion.logs.replay import replay
from protocol.flightlog import Direction, FlightLogError, LogReader, datagrams
from studies.faults import flights, proxy
from studies.faults.injector import Injector, Onset
from studies.faults.matrix import as_promised
from studies.faults.proxy import Console
from studies.joined import mission_of
from studies.report import Report

NAME = "kills"
TITLE = "Processes that are killed or stopped"

SEEDS = 20
MISSION = "errand"
FLIGHT_S = 1.0, 20.0
"""From when to when after the arming it may happen: from before the lift-off to the landing."""
STOPPED_S = 3.0
MISSING_S = 0.2
"""What a log may lack at its end."""
_LISTED = 8

COMPANION, RECORDER, PLANNER, VEHICLE = PROCESSES = ("companion", "recorder", "planner", "vehicle")
SIGNALS = {"SIGKILL": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "SIGSTOP 3 s": signal.SIGSTOP}
STAYED = "stayed on the ground"
_WORDS = {RECORDER: b"protocol.flightlog.recorder", PLANNER: b"spawn_main"}
"""In the command lines of the companion's own processes."""

PROMISES: dict[tuple[str, str], tuple[str, str]] = {
    (COMPANION, "SIGKILL"): ("the vehicle lands by its own failsafe", "landed"),
    (COMPANION, "SIGTERM"): ("lands where it is", "landed"),
    (COMPANION, "SIGSTOP 3 s"): ("the vehicle's failsafe, watched to the ground", "landed"),
    (RECORDER, "SIGKILL"): ("said; delivers", "delivered"),
    (RECORDER, "SIGTERM"): ("delivers", "delivered"),
    (RECORDER, "SIGSTOP 3 s"): ("delivers, nothing is lost", "delivered"),
    (PLANNER, "SIGKILL"): ("holds, lands after 5 s", "landed"),
    (PLANNER, "SIGTERM"): ("delivers: it ends with its companion alone", "delivered"),
    (PLANNER, "SIGSTOP 3 s"): ("holds, goes on", "delivered"),
    (VEHICLE, "SIGKILL"): ("the companion gives up after 4 s", "gone"),
    (VEHICLE, "SIGTERM"): ("the companion gives up after 4 s", "gone"),
    (VEHICLE, "SIGSTOP 3 s"): ("withdraws, lands after 5 s", "landed"),
}
"""What is promised, and the least that the vehicle comes to: one that is done in time is as good as landed."""


@dataclass(frozen=True, slots=True)
class Kill:
    process: str
    signal: str
    seed: int
    code: str
    """Digest of the code that flies: see flights.code."""


class Row(msgspec.Struct, frozen=True):
    """One flight. What there was no word of is None."""

    process: str
    signal: str
    seed: int
    code: str
    after_s: float
    """From the arming to the signal."""
    outcome: str
    """delivered; landed; stayed on the ground; gone: the vehicle's process has ended; contact; not ended; no signal:
    the flight was over before."""
    words: str | None
    """The outcome as the companion said it last."""
    answer: str | None
    """The first one after the signal: see studies/faults/catalogue.py."""
    answer_s: float | None
    log: str | None
    """What is wrong with it; None: it opens."""
    missing_s: float
    """Before the signal: what was sent that is not in the log."""
    differences: int | None
    """Differences that the replay found."""
    wall_s: float

    @property
    def job(self) -> Kill:
        return Kill(self.process, self.signal, self.seed, self.code)

    @property
    def logged(self) -> bool:
        """The log opens, lacks next to nothing, and replays to the byte. One whose recorder was killed is cut off."""
        opens = self.log is None or (self.process, self.signal) == (RECORDER, "SIGKILL")
        return opens and self.missing_s <= MISSING_S and self.differences == 0

    @property
    def kept(self) -> bool:
        least = PROMISES[self.process, self.signal][1]
        return self.outcome == least or (least == "landed" and self.outcome in ("delivered", STAYED))


class Sent(Injector):
    """Hands everything on, and keeps what the companion sent, with its time."""

    def __init__(self, after_s: float) -> None:
        super().__init__(onset=Onset(after_s))
        self.sent: list[tuple[int, bytes]] = []

    def to_vehicle(self, data: bytes, now_ns: int) -> None:
        self.sent.append((now_ns, data))
        super().to_vehicle(data, now_ns)


class Blow:
    """Sends a signal to a process once the moment has come, and wakes who was stopped."""

    def __init__(self, kill: Kill, between: Sent) -> None:
        self._kill, self._between = kill, between
        self._pid = 0
        self._wake_ns: int | None = None

    def __call__(self, companion: Console, vehicle: Console) -> None:
        now_ns = time.monotonic_ns()
        if self._pid == 0 and self._between.began_ns is not None:
            self._pid = _pid_of(self._kill.process, companion, vehicle)
            number = SIGNALS[self._kill.signal]
            os.kill(self._pid, number)
            if number is signal.SIGSTOP:
                self._wake_ns = now_ns + round(STOPPED_S * 1e9)
        if self._wake_ns is not None and now_ns >= self._wake_ns:
            os.kill(self._pid, signal.SIGCONT)
            self._wake_ns = None


def _pid_of(process: str, companion: Console, vehicle: Console) -> int:
    """Raises ValueError where the companion has no such process, or several."""
    if process in (COMPANION, VEHICLE):
        return (companion if process == COMPANION else vehicle).process.pid
    parent = companion.process.pid
    children = map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split())
    (found,) = (pid for pid in children if _WORDS[process] in Path(f"/proc/{pid}/cmdline").read_bytes())
    return found


def run(report: Report) -> None:
    report.text(
        f"""
`companion fly {MISSION}` and `vehicle-sim` as processes in real time; one process gets a signal at a random moment
from before the lift-off to the landing. The recorder and the planner are processes of the companion. Each log is opened
and replayed. There are as many flights at once as the machine has cores.
"""
    )
    code = flights.code(__file__, proxy.__file__)
    kills = [
        Kill(process, name, seed, code)
        for seed in range(1, min(report.choice.seeds, SEEDS) + 1)
        for process in PROCESSES
        for name in SIGNALS
    ]
    path = report.choice.logs.with_name("faults") / "kills.jsonl"
    tell(report, flights.fly_missing(kills, Row, path, _fly_all, report.progress))


def tell(report: Report, rows: list[Row]) -> None:
    """The section: a table by process and signal, checks, and what was not as promised."""
    if not rows:
        report.text("Not flown yet.")
        return
    cases = {case: [row for row in rows if (row.process, row.signal) == case] for case in PROMISES}
    report.table(
        ("process", "signal", "promised", "flights", "as promised (95 %)", "outcomes", "first answers", "after (s)",
         "log opens, replays", "missing at its end (s)"),
        [(*case, PROMISES[case][0], *_line(found)) for case, found in cases.items() if found],
        "Times are the latest. A flight that was over before it mattered has delivered.",
    )  # fmt: skip
    contacts = sum(row.outcome == "contact" for row in rows)
    report.check("contacts", "0", f"{contacts} of {len(rows)} flights", contacts == 0)
    for what, good in (("flights as promised", [row.kept for row in rows]), ("logs", [row.logged for row in rows])):
        report.check(what, "all", f"{sum(good)} of {len(good)}", all(good))
    wrong = [row for row in rows if not (row.kept and row.logged)]
    if wrong:
        report.table(
            ("process", "signal", "seed", "after arming (s)", "outcome", "said", "log", "missing (s)", "differences"),
            [(row.process, row.signal, row.seed, row.after_s, row.outcome, row.words or "-", row.log or "opens",
              row.missing_s, "-" if row.differences is None else row.differences) for row in wrong[:_LISTED]],
            f"Not as promised ({len(wrong)}; at most {_LISTED} are listed).",
        )  # fmt: skip


def _line(rows: list[Row]) -> tuple[int, str, str, str, float, str, float]:
    return (
        len(rows),
        as_promised(rows),
        _counted([row.outcome for row in rows]),
        _counted([row.answer or "-" for row in rows]),
        max((row.answer_s for row in rows if row.answer_s is not None), default=float("nan")),
        f"{sum(row.log is None for row in rows)}, {sum(row.differences == 0 for row in rows)}",
        max(row.missing_s for row in rows),
    )


def _counted(words: list[str]) -> str:
    return ", ".join(f"{words.count(each)} {each}" for each in sorted(set(words)))


def _fly_all(kills: list[Kill]) -> Iterator[Row]:
    """One on each core at a time, from a process of its own, whose replays keep no other flight waiting."""
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        yield from pool.map(fly, kills)


def fly(kill: Kill) -> Row:
    """Fly it, at the pace of the clock."""
    began = time.perf_counter()
    key = crc32(f"{kill.process}, {kill.signal}".encode())
    after_s = float(np.random.default_rng([kill.seed, key]).uniform(*FLIGHT_S))
    between = Sent(after_s)
    with TemporaryDirectory() as folder:
        companion, vehicle = proxy.fly(
            between, MISSION, mission_of(MISSION).world, kill.seed, Path(folder), watch=Blow(kill, between)
        )
        said, ended = companion.end(), vehicle.end()
        log, missing_s, differences = _log(next(Path(folder).glob("*/flight.mcap")), between)
    lines = [(1e-9 * at, proxy.sentence(line)) for at, line in companion.lines]
    answer, answer_s = next(iter(flights.answers(lines, _seconds(between.began_ns))), (None, None))
    words = None if said is None else str(said["outcome"])
    return Row(
        process=kill.process,
        signal=kill.signal,
        seed=kill.seed,
        code=kill.code,
        after_s=after_s,
        outcome="no signal" if between.began_ns is None else outcome(kill, ended, words),
        words=words,
        answer=answer,
        answer_s=answer_s,
        log=log,
        missing_s=missing_s,
        differences=differences,
        wall_s=time.perf_counter() - began,
    )


def _seconds(time_ns: int | None) -> float | None:
    return None if time_ns is None else 1e-9 * time_ns


def outcome(kill: Kill, ended: dict[str, object] | None, words: str | None) -> str:
    """What the vehicle came to, by its own last word and the companion's."""
    killed = kill.process == VEHICLE and SIGNALS[kill.signal] is not signal.SIGSTOP
    if killed and (ended is None or ended["outcome"] == "stopped"):
        return "gone"
    if ended is None:
        return "not ended"
    if ended["contacts"]:
        return "contact"
    if ended["flight_time_s"] == 0.0:
        return STAYED
    if ended["outcome"] != "landed":
        return str(ended["outcome"])
    return "delivered" if words == "delivered" else "landed"


def _log(path: Path, between: Sent) -> tuple[str | None, float, int | None]:
    """What is wrong with the log, what of before the signal it lacks (s), and how many differences its replay finds."""
    own = f"{path}: "
    try:
        problem = LogReader(path).problem
        logged = {data for _, direction, _, data in datagrams(path) if direction is Direction.OUT}
        differences = len(replay(path).differences)
    except FlightLogError as error:
        return str(error).removeprefix(own), float("inf"), None
    missing_s = missing(between.sent, logged, between.began_ns or 0)
    return None if problem is None else problem.removeprefix(own), missing_s, differences


def missing(sent: Iterable[tuple[int, bytes]], logged: Collection[bytes], signal_ns: int) -> float:
    """How long (s) before a signal the first datagram was sent of those before it that are not in the log."""
    return max((1e-9 * (signal_ns - at) for at, data in sent if at < signal_ns and data not in logged), default=0.0)
