"""Encoding and decoding against pymavlink's own path, side by side in one process (fastcrc under both).

encode: a message's fields to the bytes of a frame (pymavlink: construct and pack).
pack:   a message that is there already to bytes.
decode: the bytes of a datagram to a message (pymavlink: the faster of parse_char and parse_buffer; ours:
        Framer.datagram, which settles the datagram's end too, and decode).
sign, verify: what a key adds to each message that leaves and that comes, through a link in memory.

Each repeat times every contender in turn; times are medians over the repeats, ratios the medians of each one's ratio.
"""

import argparse
import json
import platform
import random
import statistics
import sys
import timeit
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

from rich.console import Console
from rich.table import Table

from protocol.framing import Framer
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.messages import Encoder, decode, dialect
from protocol.transport import Memory

_RANGES_CM = [random.Random(7).choice((1501, random.Random(beam).randint(20, 1500))) for beam in range(72)]
_MESSAGES: list[tuple[type[Any], tuple[Any, ...]]] = [
    (dialect.MAVLink_heartbeat_message, (2, 12, 209, 6 << 16, 4, 3)),
    (dialect.MAVLink_attitude_quaternion_message, (83_000, 0.98, 0.02, -0.04, 0.19, 0.01, -0.02, 0.3)),
    (dialect.MAVLink_local_position_ned_message, (83_004, 12.5, -3.2, -5.1, 1.4, 0.2, -0.05)),
    (dialect.MAVLink_set_attitude_target_message, (83_008, 1, 1, 0x80, (1.0, 0.0, 0.0, 0.0), 0.1, -0.2, 0.05, 0.48)),
    (dialect.MAVLink_obstacle_distance_message, (83_012_000, 0, _RANGES_CM, 5, 20, 1500, 5.0, 0.0, 12)),
    (dialect.MAVLink_distance_sensor_message, (83_016, 20, 1500, 640, 0, 1, 0, 255)),
    (dialect.MAVLink_timesync_message, (0, 83_020_123_456)),
]


def _contenders(message_class: type[Any], fields: tuple[Any, ...]) -> dict[str, Callable[[], Any]]:
    mav = dialect.MAVLink(None, 1, 191)
    encoder = Encoder(1, 191)
    framer = Framer()
    message = message_class(*fields)
    data = message.pack(mav)

    def receive() -> Any:
        message = None
        for frame in framer.datagram(data):
            message = decode(frame)
        return message

    if encoder.encode_fields(message_class, *fields) != data or receive() != mav.parse_char(data):
        raise SystemExit(f"{message_class.msgname}: the two don't agree")
    return {
        "encode pymavlink": lambda: message_class(*fields).pack(mav),
        "encode ours": lambda: encoder.encode_fields(message_class, *fields),
        "pack pymavlink": lambda: message.pack(mav),
        "pack ours": lambda: encoder.encode(message),
        "decode parse_char": lambda: mav.parse_char(data),
        "decode parse_buffer": lambda: mav.parse_buffer(data),
        "decode ours": receive,
    }


def _measure(message_class: type[Any], fields: tuple[Any, ...], repeats: int, number: int) -> dict[str, Any]:
    timers = {name: timeit.Timer(call) for name, call in _contenders(message_class, fields).items()}
    runs = [{name: timer.timeit(number) / number * 1e6 for name, timer in timers.items()} for _ in range(repeats)]
    for run in runs:
        run["decode pymavlink"] = min(run["decode parse_char"], run["decode parse_buffer"])
    return {
        way: {
            "pymavlink_us": statistics.median(run[f"{way} pymavlink"] for run in runs),
            "ours_us": statistics.median(run[f"{way} ours"] for run in runs),
            "ratio": statistics.median(run[f"{way} pymavlink"] / run[f"{way} ours"] for run in runs),
        }
        for way in ("encode", "pack", "decode")
    }


def _measure_signing(message_class: type[Any], fields: tuple[Any, ...], repeats: int, number: int) -> dict[str, float]:
    """us a message more with a key than without, medians."""
    frame = Encoder(1, 191).encode_fields(message_class, *fields)
    added: dict[str, list[float]] = {"sign": [], "verify": []}
    keeper = Keeper(bytes(range(32)))
    for _ in range(repeats):
        took = []
        for key in (None, keeper):
            near, far = Memory.pair()
            sender, receiver = GuardedLink(near, key), GuardedLink(far, key)
            send = timeit.timeit(partial(sender.send, frame), number=number)
            took.append(
                (send / number * 1e6, timeit.timeit(partial(receiver.receive, 0.0), number=number) / number * 1e6)
            )
        for name, plain, signed in zip(added, *took, strict=True):
            added[name].append(signed - plain)
    if any(keeper.signing.refused.values()):
        raise SystemExit(f"{message_class.msgname}: signed messages were refused")
    return {name: statistics.median(values) for name, values in added.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--repeats", type=int, default=25)
    parser.add_argument("--number", type=int, default=2000, help="calls in each repeat")
    options = parser.parse_args()
    if dialect.mcrf4xx is None:
        sys.exit("pymavlink has not found fastcrc: the comparison would not be fair")

    messages = {cls.msgname: _measure(cls, fields, options.repeats, options.number) for cls, fields in _MESSAGES}
    signing = {cls.msgname: _measure_signing(cls, each, options.repeats, options.number) for cls, each in _MESSAGES}
    least = min(way["ratio"] for message in messages.values() for name, way in message.items() if name != "pack")
    if options.json:
        versions = {name: version(name) for name in ("pymavlink", "fastcrc")} | {"python": platform.python_version()}
        print(json.dumps({"messages": messages, "signing_us": signing, "least_ratio": least, "versions": versions}))
        return
    table = Table("message", title="us a message, pymavlink / ours, and how many times faster")
    for way in ("encode", "pack", "decode"):
        table.add_column(way, justify="right")
        table.add_column("x", justify="right", style="bold")
    table.add_column("sign", justify="right")
    table.add_column("verify", justify="right")
    for name, ways in messages.items():
        cells = [(f"{way['pymavlink_us']:.2f} / {way['ours_us']:.2f}", f"{way['ratio']:.1f}") for way in ways.values()]
        table.add_row(
            name, *(cell for pair in cells for cell in pair), *(f"{us:+.2f}" for us in signing[name].values())
        )
    console = Console(width=112)  # room for the longest name, in pipes too
    console.print(table)
    console.print(f"least of encode and decode: {least:.2f}")


if __name__ == "__main__":
    main()
