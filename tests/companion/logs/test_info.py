"""What is said of a log, at once and after reading all of it."""

import json
import os
import random
import struct
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path

import pytest

from companion.logs.info import info
from protocol.flightlog import DATAGRAM, FlightLog, FlightLogError, LogReader, digest
from protocol.flightlog.tlog import TlogReader, write
from protocol.messages import dialect
from tests.companion.logs.changed_logs import Flyer, foreign, rewritten, telemetry_log
from tests.flights.processes import run

DATA = Path(__file__).resolve().parents[2] / "data"


def test_the_summary_says_what_reading_finds(fly: Flyer) -> None:
    path = fly()
    quick, thorough = info(path), info(path, check=True)
    counts = Counter(record.topic for record in LogReader(path).records())
    assert quick == thorough
    assert quick.topics == dict(counts) and quick.complete and quick.problem is None
    assert quick.duration_s == pytest.approx(quick.topics["/companion/ticks"] * 0.004, abs=0.02)
    assert quick.flight["mission"] == "hover" and quick.result["landed"] == "True"
    assert quick.started_unix_s == pytest.approx(float(quick.flight["started_unix_s"]))
    assert quick.attachments.keys() == LogReader(path).attachments.keys()


def test_a_finished_log_is_not_read_to_describe_it(many_chunks: Path, tmp_path: Path) -> None:
    """With every message overwritten it is still described, until it is checked."""
    content = bytearray(many_chunks.read_bytes())
    start = int.from_bytes(content[-28:-20], "little")
    content[2_000 : start - 200] = bytes(start - 2_200)
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    assert info(path).topics == info(many_chunks).topics == {"/courier/datagrams": 2000}
    assert info(path).duration_s == pytest.approx(1999 * 0.004)
    assert info(path, check=True).problem is not None


def test_a_cut_log_is_described_by_what_is_there(fly: Flyer, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(fly().read_bytes()[:300_000])
    found = info(path)
    assert not found.complete and found.problem is not None and "cut off" in found.problem
    assert found.flight["mission"] == "hover" and found.result == {}
    assert found.topics == Counter(record.topic for record in LogReader(path).records())
    done = run("companion", "info", str(path), "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout)["topics"] == found.topics


def test_other_systems(tmp_path: Path) -> None:
    source = DATA / "ardupilot_guided.tlog"
    found = info(source)
    times = [entry.time_us for entry in TlogReader(source).entries()]
    assert found.kind == "telemetry log" and found.complete
    assert sum(found.topics.values()) == len(times)
    assert found.duration_s == pytest.approx((times[-1] - times[0]) * 1e-6)
    assert found.topics["/mavlink/1/1/HEARTBEAT"] > 30
    path = tmp_path / "flipped.tlog"
    content = bytearray(source.read_bytes())
    content[100_020] ^= 1
    path.write_bytes(content)
    problem = info(path).problem
    assert problem is not None and path.name in problem


@pytest.mark.parametrize("by_s", [-3600, 3 * 365 * 86_400])
def test_a_telemetry_log_lasts_as_long_as_it_does_where_its_clock_was_set(tmp_path: Path, by_s: int) -> None:
    source = DATA / "px4_offboard.tlog"
    entries, plain = list(TlogReader(source).entries()), info(source)
    at = len(entries) // 2
    moved = [entry._replace(time_us=entry.time_us + by_s * 1_000_000) for entry in entries[at:]]
    write(tmp_path / "set.tlog", [*entries[:at], *moved])
    found = info(tmp_path / "set.tlog")
    assert found.duration_s == pytest.approx(plain.duration_s, abs=0.1)
    assert found.started_unix_s == plain.started_unix_s and found.topics == plain.topics


def test_the_digest_is_of_any_log_s_traffic(fly: Flyer, tmp_path: Path) -> None:
    lines = [f"{direction.name.lower():3} {value}\n" for direction, value in digest(fly()).items()]
    assert run("companion", "digest", str(fly().parent)).stdout == "".join(lines)
    source = DATA / "px4_offboard.tlog"
    told = run("companion", "digest", str(source))
    assert told.returncode == 0 and len(set(told.stdout.split())) == 4
    flipped = tmp_path / "flipped.tlog"
    content = bytearray(source.read_bytes())
    content[40_020] ^= 1
    flipped.write_bytes(content)
    assert run("companion", "digest", str(flipped)).stdout != told.stdout
    empty = tmp_path / "empty"
    FlightLog.open(
        empty, metadata={}, attachments={}, types=(), on_full="wait", console=False, minimum_free_bytes=0
    ).close()
    refused = run("companion", "digest", str(empty))
    assert refused.returncode == 2 and "there is no datagram in it" in refused.stderr


def test_what_is_no_log_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"hello" * 100)
    for path in (tmp_path / "a.mcap", tmp_path / "none.mcap", tmp_path):
        done = run("companion", "info", str(path))
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and str(path) in done.stderr
    with pytest.raises(FlightLogError):
        info(tmp_path / "a.mcap")


@pytest.mark.parametrize("started", ["nan", "inf", "1e300", "-1e11"])
def test_a_start_that_is_none(fly: Flyer, tmp_path: Path, started: str) -> None:
    path = rewritten(fly(), tmp_path / "a.mcap", flight={"started_unix_s": started})
    assert info(path) == info(path, check=True) and info(path).flight["started_unix_s"] == started
    found = info(path).started_unix_s
    assert found is None or found > 0.0
    assert run("companion", "info", str(path)).returncode == 0
    stamped = telemetry_log(tmp_path / "a.tlog", dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3), start_us=0)
    assert info(stamped).started_unix_s == 0.0


def test_a_summary_of_nonsense_with_a_right_checksum_is_not_believed(many_chunks: Path, tmp_path: Path) -> None:
    """Nor does it end in anything but words."""
    content = many_chunks.read_bytes()
    (start,) = struct.unpack_from("<Q", content, len(content) - 28)
    generator = random.Random(5)
    path = tmp_path / "a.mcap"
    for _ in range(300):
        changed = bytearray(content)
        for _ in range(generator.randrange(1, 4)):
            changed[generator.randrange(start, len(content) - 37)] = generator.choice((0, 1, 127, 255))
        struct.pack_into("<I", changed, len(changed) - 12, zlib.crc32(changed[start : len(changed) - 12]))
        path.write_bytes(changed)
        assert info(path).kind == "flight log"


def test_what_is_empty_or_no_file(tmp_path: Path) -> None:
    for name in ("a.tlog", "a.mcap"):
        (tmp_path / name).touch()
        with pytest.raises(FlightLogError, match="an empty file"):
            info(tmp_path / name)
    os.mkfifo(tmp_path / "pipe")
    done = run("companion", "info", str(tmp_path / "pipe"))
    assert done.returncode == 2 and done.stderr == f"companion: {tmp_path / 'pipe'}: not a file\n"


def test_what_is_damaged_is_digested_as_far_as_it_goes(many_chunks: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(many_chunks.read_bytes()[:20_000])
    done = run("companion", "digest", str(tmp_path / "cut.mcap"))
    assert done.returncode == 1 and "cut off" in done.stderr and len(done.stdout.splitlines()) == 2
    topics = {DATAGRAM.topic: (DATAGRAM.schema_name, DATAGRAM.definition, [(10**9, DATAGRAM.pack(7, "", b"x"))])}
    done = run("companion", "digest", str(foreign(tmp_path / "a.mcap", topics)))
    assert done.returncode == 2 and "a.mcap: the datagram at 1.000 s is damaged" in done.stderr


def test_an_output_that_is_full_is_one_line(many_chunks: Path) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "companion", "info", str(many_chunks)]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2 and done.stderr == "companion: standard output: No space left on device\n"
