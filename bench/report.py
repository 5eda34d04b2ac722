"""The report of a long flight: the time until its first chart is drawn in Chromium, and the memory that writing takes.

    python bench/report.py [LOG] [--minutes 20] [--hours 8] [--openings 5] [--json]

Without a LOG the courier's mission is flown first. The log of 20 minutes repeats that log. --hours N also writes a log
of N hours with 1000 messages a second (8 hours take minutes and 0.7 GB), and measures `companion info` and `companion
report` of it. Chromium is headless and draws in software; without it that part is left out.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from companion.logs.writer import Writer
from companion.view.report import write
from protocol.flightlog import LogReader
from protocol.flightlog.mavlink_records import message_type
from protocol.flightlog.mcap_file import McapFile
from protocol.flightlog.mcap_format import message_record
from protocol.messages import dialect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
RATE = 1000


def repeated(source: Path, target: Path, seconds: float) -> Path:
    """A log of `seconds`: all records of another log again and again, each time later."""
    log = LogReader(source)
    kinds, records = log.topics, list(log.records())
    span_ns = max(record.time_ns for record in records) - records[0].time_ns + 4_000_000
    most = max(record.sequence for record in records) + 1
    with Writer(target, log.epoch_ns, {"flight": log.metadata["flight"], "result": log.metadata["result"]}) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        for turn in range(round(seconds * 1e9 / span_ns)):
            for record in records:
                later_ns, sequence = record.time_ns + turn * span_ns, record.sequence + turn * most
                writer.record(kinds[record.topic], later_ns, sequence & 0xFFFF_FFFF, record.data)
    return target


WATCH = """
window.opening = {};
const markOpening = name => requestAnimationFrame(() => { opening[name] = performance.now() / 1e3; });
new MutationObserver((_, watcher) => {
  if (!("words" in opening) && document.querySelector("#title:not(:empty)")) markOpening("words");
  if (!document.querySelector("[data-drawn]")) return;
  watcher.disconnect();
  markOpening("chart");
}).observe(document, {subtree: true, childList: true, attributeFilter: ["data-drawn"]});
addEventListener("DOMContentLoaded", () => document.querySelector(".plot").scrollIntoView());
"""
"""A chart is drawn when it comes into view. The page's own clock measures, because playwright asks only now and
then."""


def opening(report: Path, times: int) -> dict[str, float]:
    """Times (s) from the request of the page until its first words and its first chart are on the screen, in a browser
    that has just started."""
    words, charts, all_charts = [], [], 0
    with sync_playwright() as playwright:
        for _ in range(times):
            arguments = ["--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
            arguments += ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.add_init_script(WATCH)
            page.goto(report.as_uri(), wait_until="commit")
            page.wait_for_function("opening.chart")
            words.append(page.evaluate("opening.words"))
            charts.append(page.evaluate("opening.chart"))
            all_charts = page.locator(".plot").count()
            browser.close()
    return {
        "charts in it": all_charts,
        "first words, median s": statistics.median(words),
        "first chart, median s": statistics.median(charts),
        "first chart, worst s": max(charts),
    }


def fly(folder: Path) -> Path:
    """The log of the courier's mission, flown in lockstep."""
    command = [sys.executable, "-m", "companion", "demo", "courier", "--sensors", "perfect", "--no-report"]
    command += ["--log", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    (log,) = folder.glob("*/flight.mcap")
    return log


def long_log(path: Path, hours: float) -> int:
    """Write a log with the attitudes of four vehicles at 250 Hz each, in chunks of 80 ms. Returns its messages."""
    file = McapFile(path)
    file.add_metadata("flightlog", {"version": "1", "epoch_ns": "0"})
    attitude, beat = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_HEARTBEAT
    kinds = [message_type(attitude, f"/mavlink/{system}/1/ATTITUDE_QUATERNION")[0] for system in range(1, 5)]
    channels = [file.add_channel(kind) for kind in kinds]
    beats = file.add_channel(message_type(beat, "/mavlink/1/1/HEARTBEAT")[0])
    messages = round(hours * 3600) * RATE
    for index in range(messages):
        time_ns = index * (1_000_000_000 // RATE)
        turn = index & 3
        channel = channels[turn]
        data = kinds[turn].pack(index, 1.0, 0.0, 0.0, 0.0, 1e-3 * (index % 997), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if index % RATE == 0:
            channel, data = beats, kind_of_beat(index)
        file.add_message(channel, time_ns, message_record(channel, index & 0xFFFF_FFFF, time_ns, data))
        if index % 80 == 79:
            file.end_chunk()
    file.end_chunk()
    file.finish()
    return messages


def kind_of_beat(index: int) -> bytes:
    """The heartbeat of a PX4 vehicle that alternates between two modes."""
    mode = (6 if index // RATE // 60 % 2 else 3) << 16
    return message_type(dialect.MAVLINK_MSG_ID_HEARTBEAT, "/x")[0].pack(mode, 2, 12, 0x81, 4, 3)


def run(command: str, log: Path) -> tuple[str, float, float]:
    """Run a command of the companion in a process: what it prints, its time (s) and its largest memory (MB)."""
    code = (
        "import sys; sys.argv = ['companion', *sys.argv[1:]]\n"
        "from companion.cli.app import app; app(standalone_mode=False)\n"
        "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])"
    )  # (getrusage would count what this process had when it forked)
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *command.split(), str(log)], capture_output=True, text=True, check=True
    )
    took_s = time.perf_counter() - began
    *said, most_kb = done.stdout.strip().splitlines()
    return "\n".join(said), took_s, int(most_kb) / 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, nargs="?")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--hours", type=float, default=0.0)
    parser.add_argument("--openings", type=int, default=5)
    arguments = parser.parse_args()
    result: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.minutes:
            source = arguments.log or fly(folder / "flown")
            log = repeated(source, folder / "long.mcap", 60.0 * arguments.minutes)
            began = time.perf_counter()
            report = write(log).path
            result["report, s to write"] = time.perf_counter() - began
            result["report, MB"] = report.stat().st_size / 1e6
            if CHROMIUM is not None:
                result |= opening(report, arguments.openings)
        if arguments.hours:
            log = folder / "hours.mcap"
            messages = long_log(log, arguments.hours)
            said, info_s, info_mb = run("info --json", log)
            assert sum(json.loads(said)["topics"].values()) == messages
            _, report_s, report_mb = run("report", log)
            result |= {
                f"log of {arguments.hours:g} h, MB": log.stat().st_size / 1e6,
                "messages in it": messages,
                "companion info of it, s": info_s,
                "companion info of it, MB of memory": info_mb,
                "companion report of it, s": report_s,
                "companion report of it, MB of memory": report_mb,
            }
    if arguments.json:
        print(json.dumps(result))
        return
    for key, value in result.items():
        print(f"{key:50} {value:12,.2f}")


if __name__ == "__main__":
    main()
