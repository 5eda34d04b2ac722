"""The flight log: what a record costs the flying thread and the recorder, the file's size, reading, loss on a kill.

    python bench/log.py [--ticks 20000] [--kills 8] [--flights] [--json]

Sizes and reading are beside a telemetry log of the same traffic and pymavlink's reader of it. --flights also flies the
courier, in lockstep and in real time (some 2 minutes), and flies both again. Long logs are in bench/report.py.
"""

import argparse
import json
import math
import os
import resource
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.reader import make_reader
from pymavlink import mavutil

from companion.config import Settings
from companion.logs.convert.telemetry import from_flight_log
from companion.logs.repair import repair
from companion.records import LOGGED, TICK, TRACE
from companion.trace import Thinning
from protocol.flightlog import (
    Direction,
    FlightLog,
    LogReader,
    RecordType,
    read,
)
from protocol.framing import Framer
from protocol.messages import Encoder, dialect

PERIOD_NS = 4_000_000
TRACE_RATE = Settings().log.trace_rate
TRACE_HEAD = 7
"""Bytes of flags and numbers before the floats."""
FLOATS = ((TRACE.size or 0) - TRACE_HEAD) // 8
REPLAYS = 5
RECORDS_A_TICK = 3.2
MESSAGES_A_TICK = 5


class Tick(NamedTuple):
    time_ns: int
    received: bytes
    sent: bytes
    trace: bytes


def traffic(ticks: int) -> Iterator[Tick]:
    """A vehicle in a gentle curve, with sensor noise: four frames in and one out each 4 ms."""
    vehicle, companion = Encoder(1, 1), Encoder(1, 191)
    noise = np.random.default_rng(1).normal(0.0, 0.01, (ticks, FLOATS))
    for number in range(ticks):
        ms = number * 4
        n = noise[number].tolist()
        integers = [abs(int(1000.0 * value)) for value in n[16:27]]
        swing = math.sin(ms * 1e-3)
        q = [0.99, 0.1 * swing + 0.01 * n[0], 0.02 + 0.01 * n[1], 0.05 + 0.01 * n[2]]
        received = (
            vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, ms, *q, *n[3:6])
            + vehicle.encode_fields(
                dialect.MAVLink_local_position_ned_message, ms, 2e-3 * ms, 5.0 * swing, -5.0 + n[6], 2.0, *n[7:9]
            )
            + vehicle.encode_fields(dialect.MAVLink_attitude_target_message, ms, 7, q, *n[9:12], 0.5 + n[12])
            + vehicle.encode_fields(
                dialect.MAVLink_hil_state_quaternion_message,
                ms * 1000,
                q,
                *n[13:16],
                *integers,
            )
        )
        sent = companion.encode_fields(
            dialect.MAVLink_set_attitude_target_message, ms, 1, 1, 128, [1.0, 0.0, 0.0, 0.0], *n[27:30], 0.5 + n[30]
        )
        values = [math.sin(1e-3 * ms + index) + (n[index] if index % 3 == 0 else 0.0) for index in range(FLOATS)]
        yield Tick(number * PERIOD_NS, received, sent, bytes(TRACE_HEAD) + struct.pack(f"<{FLOATS}d", *values))


def open_log(folder: Path, types: tuple[RecordType, ...] = (TICK, LOGGED)) -> FlightLog:
    return FlightLog.open(
        folder, metadata={}, attachments={}, types=types, on_full="wait", console=False, minimum_free_bytes=0
    )


def hand_over(log: FlightLog, tick: Tick, thinning: Thinning) -> None:
    log.datagram(tick.time_ns, Direction.IN, "127.0.0.1:14540", tick.received)
    log.record(TICK, tick.time_ns, TICK.pack(0))
    for time_ns, record in thinning.step(tick.time_ns, tick.trace):
        log.record(LOGGED, time_ns, record)
    log.datagram(tick.time_ns, Direction.OUT, "127.0.0.1:14540", tick.sent)


def flying_cost(folder: Path, ticks: list[Tick]) -> dict[str, float]:
    """us on the flying thread for each call, packing included, while the recorder works."""
    log, thinning = open_log(folder), Thinning(TRACE_RATE)
    clock = time.perf_counter_ns
    datagram, trace, fault = [], [], []
    for tick in ticks:
        t0 = clock()
        log.datagram(tick.time_ns, Direction.IN, "127.0.0.1:14540", tick.received)
        t1 = clock()
        for time_ns, record in thinning.step(tick.time_ns, tick.trace):
            log.record(LOGGED, time_ns, record)
        t2 = clock()
        assert log.fault is None
        t3 = clock()
        datagram.append(t1 - t0)
        trace.append(t2 - t1)
        fault.append(t3 - t2)
    log.close()
    result = {}
    for name, times in (("datagram", datagram), ("a step's trace", trace), ("fault", fault)):
        times.sort()
        result[f"{name}, p50 us"] = times[len(times) // 2] * 1e-3
        result[f"{name}, p99 us"] = times[len(times) * 99 // 100] * 1e-3
    return result


def children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def recorder_cost(folder: Path, ticks: list[Tick]) -> tuple[dict[str, float], Path]:
    """The recorder's own processor time, and records a second with the producer as fast as the recorder lets it be."""
    began = children_cpu_s()
    open_log(folder / "empty").close()
    start_s = children_cpu_s() - began
    log, thinning = open_log(folder / "full"), Thinning(TRACE_RATE)
    wall = time.perf_counter()
    for tick in ticks:
        hand_over(log, tick, thinning)
    log.close()
    wall = time.perf_counter() - wall
    busy_s = children_cpu_s() - began - 2 * start_s
    records = len(ticks) * (RECORDS_A_TICK + MESSAGES_A_TICK)
    return {
        "recorder, us a record in the file": busy_s / records * 1e6,
        "recorder, us a tick of 3.2 records and 5 messages": busy_s / len(ticks) * 1e6,
        "records in the file a second, both processes": records / wall,
        "recorder's start, ms of processor": start_s * 1e3,
    }, log.path


def sizes(folder: Path, ticks: list[Tick], everything: Path) -> dict[str, float]:
    log = open_log(folder, ())
    tlog = 0
    for tick in ticks:
        log.datagram(tick.time_ns, Direction.IN, "127.0.0.1:14540", tick.received)
        log.datagram(tick.time_ns, Direction.OUT, "127.0.0.1:14540", tick.sent)
        tlog += len(tick.received) + len(tick.sent) + 8 * MESSAGES_A_TICK
    log.close()
    ours, whole = log.path.stat().st_size, everything.stat().st_size
    return {
        "tlog, bytes a tick": tlog / len(ticks),
        "datagrams and messages, bytes a tick": ours / len(ticks),
        "with ticks and trace, bytes a tick": whole / len(ticks),
        "datagrams and messages, times the tlog": ours / tlog,
        "with ticks and trace, times the tlog": whole / tlog,
    }


def reading(path: Path) -> dict[str, float]:
    began = time.perf_counter()
    records = sum(1 for _ in read(path))
    ours = records / (time.perf_counter() - began)
    began = time.perf_counter()
    with path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)) == records
    theirs = records / (time.perf_counter() - began)
    return {"read, records a second": ours, "mcap's make_reader": theirs, "ratio": ours / theirs}


def decoding(folder: Path, ticks: list[Tick]) -> dict[str, float]:
    """Every value of every message: our log as arrays and one by one, the tlog by pymavlink."""
    log = open_log(folder, ())
    framer = Framer()
    tlog = folder / "same.tlog"
    with tlog.open("wb") as file:
        for tick in ticks:
            log.datagram(tick.time_ns, Direction.IN, "127.0.0.1:14540", tick.received)
            log.datagram(tick.time_ns, Direction.OUT, "127.0.0.1:14540", tick.sent)
            for frame in framer.datagram(tick.received + tick.sent):
                file.write((tick.time_ns // 1000 + 1_790_000_000_000_000).to_bytes(8, "big") + frame.raw)
    log.close()
    messages = len(ticks) * MESSAGES_A_TICK

    began = time.perf_counter()
    reader = LogReader(log.path)
    topics = [topic for topic in reader.topics if topic.startswith("/mavlink/")]
    assert sum(map(len, reader.arrays(topics).values())) == messages
    arrays = messages / (time.perf_counter() - began)

    began = time.perf_counter()
    kinds = reader.topics
    assert sum(1 for record in reader.records(topics) if kinds[record.topic].unpack(record.data)) == messages
    singly = messages / (time.perf_counter() - began)

    began = time.perf_counter()
    theirs = mavutil.mavlogfile(str(tlog))
    count = 0
    while theirs.recv_msg() is not None:
        count += 1
    assert count == messages
    pymavlink = messages / (time.perf_counter() - began)
    return {
        "messages read into arrays a second": arrays,
        "messages read one by one a second": singly,
        "messages by pymavlink's mavlogfile a second": pymavlink,
        "arrays, times pymavlink's": arrays / pymavlink,
        "one by one, times pymavlink's": singly / pymavlink,
    }


def flown(folder: Path, pace: str) -> dict[str, float]:
    """The courier's flight: its log beside the telemetry log of the same traffic, and flown again."""
    command = [sys.executable, "-m", "companion", "demo", "courier", "--no-report", "--pace", pace]
    subprocess.run([*command, "--sensors", "perfect", "--log", str(folder)], check=True, capture_output=True)
    (log,) = folder.glob("*/flight.mcap")
    from_flight_log(LogReader(log), folder / "same.tlog")
    again = sorted(replayed(log) for _ in range(REPLAYS))
    return {
        f"courier, {pace}: log, bytes": log.stat().st_size,
        f"courier, {pace}: times the tlog": log.stat().st_size / (folder / "same.tlog").stat().st_size,
        f"courier, {pace}: replay, times real time": statistics.median(again),
        f"courier, {pace}: replay, least": again[0],
        f"courier, {pace}: replay, most": again[-1],
    }


def replayed(log: Path) -> float:
    """How many times as fast as the flight a new process replays it, to the bit."""
    command = [sys.executable, "-m", "companion", "replay", "--json", str(log)]
    again = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    assert not again["differences"]
    return float(again["times_real_time"])


def lost_on_kill(folder: Path, ticks: list[Tick], kills: int) -> dict[str, float]:
    """ms of log lost when the recorder is killed at 250 ticks a second; all must be made whole again."""
    lost = []
    repaired = 0
    for kill in range(kills):
        log, thinning = open_log(folder / str(kill)), Thinning(TRACE_RATE)
        start = time.monotonic_ns()
        for number, tick in enumerate(ticks[: 100 + 7 * kill]):
            while time.monotonic_ns() - start < number * PERIOD_NS:
                time.sleep(0.0005)
            hand_over(log, tick, thinning)
        os.kill(log.recorder_pid, signal.SIGKILL)
        log.close()
        mended = repair(log.path).target
        assert mended is not None
        reader = LogReader(mended)
        last_ns = max((record.time_ns for record in reader.records()), default=0)
        repaired += reader.complete and reader.problem is None
        lost.append((tick.time_ns - last_ns) * 1e-6)
    return {
        "lost on a kill, median ms": statistics.median(lost),
        "lost on a kill, most ms": max(lost),
        "killed": kills,
        "made whole again": repaired,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--kills", type=int, default=8)
    parser.add_argument("--flights", action="store_true", help="fly the courier, too")
    arguments = parser.parse_args()
    ticks = list(traffic(arguments.ticks))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        result = flying_cost(folder / "flying", ticks)
        recorder, path = recorder_cost(folder / "recorder", ticks)
        result |= recorder
        result |= sizes(folder / "sizes", ticks, path)
        result |= reading(path)
        result |= decoding(folder / "decoding", ticks)
        if arguments.flights:
            result |= flown(folder / "lockstep", "lockstep") | flown(folder / "realtime", "realtime")
        result |= lost_on_kill(folder / "kills", ticks, arguments.kills)
    if arguments.json:
        print(json.dumps(result))
        return
    for key, value in result.items():
        print(f"{key:50} {value:12,.2f}")


if __name__ == "__main__":
    main()
