"""Flights flown again from their logs, and what is said of logs in which something was changed."""

import json
import signal
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from companion.cli.logs import _replay_table
from companion.events import operation_of
from companion.logs.difference import EXTRA, MISSING, Differ
from companion.logs.repair import repair
from companion.logs.replay import Replay, replay
from companion.records import LOGGED, OPERATION, TICK, TRACE
from companion.supervision.operations import LandRequest
from protocol.flightlog import DATAGRAM, FlightLogError, LogReader, Record
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect, layout
from protocol.toml_files import TomlFileError
from tests.companion.logs.changed_logs import Flyer, rewritten, sent
from tests.flights.processes import HOP, Process, run

DATA = Path(__file__).resolve().parents[2] / "data"
AT_S = 5.0


@pytest.mark.parametrize("output", ["rates", "actuators"])
def test_every_byte_is_the_same(fly: Flyer, output: str) -> None:
    """Attitudes are those of a golden flight; real time see below."""
    path = fly("--output", output, "--pace", "lockstep")
    result = replay(path)
    assert result.differences == [] and result.notes == []
    out = [data for record in LogReader(path).records() if (data := sent(record)) is not None]
    assert (result.datagrams, result.bytes) == (len(out), sum(map(len, out)))
    assert result.traces == len(LogReader(path).array("/companion/trace")) > 100


def test_the_whole_trace_comes_back(fly: Flyer, tmp_path: Path) -> None:
    """A step for each setpoint, of which the log's own records are some; and the log that holds them replays, too."""
    target = tmp_path / "whole.mcap"
    done = run("companion", "replay", str(fly()), "--trace", str(target))
    assert done.returncode == 0, done.stdout + done.stderr
    source, copy = LogReader(fly()), LogReader(target)
    kept, whole = source.array(TRACE.topic), copy.array(TRACE.topic)
    assert copy.problem is None and copy.attachments == source.attachments
    assert len(whole) == len(copy.array("/mavlink/1/191/SET_ATTITUDE_TARGET")) > 4 * len(kept)
    same = whole[np.searchsorted(whole["time_ns"], kept["time_ns"])]
    for name in ("time_ns", "state", "step", "position_ned", "rates_command_frd", "thrust_command"):
        assert (same[name].astype(kept[name].dtype) == kept[name]).all()
    for topic in source.topics.keys() - {TRACE.topic}:
        assert [(each.time_ns, each.data) for each in copy.records((topic,))] == [
            (each.time_ns, each.data) for each in source.records((topic,))
        ]
    again = replay(target)
    assert again.differences == [] and again.traces == len(whole)
    assert run("companion", "replay", str(fly()), "--trace", str(target)).returncode == 2, "it is there already"


def test_a_changed_trace_is_named(fly: Flyer, tmp_path: Path) -> None:
    """Thoughts are compared, too, as thin as they are in the log."""
    left = [2]

    def change(record: Record) -> list[Record]:
        if record.topic != LOGGED.topic or record.time_ns < AT_S * 1e9 or not left[0]:
            return [record]
        left[0] -= 1
        row = np.frombuffer(record.data, LOGGED.dtype).copy()
        row["worst_error"] += 1.0
        return [record._replace(data=row.tobytes())]

    (difference,) = replay(rewritten(fly(), tmp_path / "changed.mcap", change)).differences
    assert (difference.message, difference.field, difference.count) == ("trace", "worst_error", 2)
    assert difference.largest == pytest.approx(1.0)


def test_another_commit_is_said_where_it_matters(fly: Flyer, victim: Record, tmp_path: Path) -> None:
    other = {"git": "0" * 40}
    assert replay(rewritten(fly(), tmp_path / "same.mcap", flight=other)).notes == []

    def change(record: Record) -> list[Record]:
        return [] if record == victim else [record]

    notes = replay(rewritten(fly(), tmp_path / "other.mcap", change, flight=other)).notes
    assert len(notes) == 1 and "flown by commit " + "0" * 40 in notes[0]


def test_real_time_and_a_request_to_land(tmp_path: Path) -> None:
    """Ctrl-C in flight is an event, too."""
    arguments = ("demo", HOP, "--no-report", "--pace", "2", "--log", str(tmp_path))
    with Process("companion", arguments) as companion:
        companion.wait_for("armed, taking off")
        companion.signal(signal.SIGINT)
        companion.end()
    (path,) = tmp_path.glob("*/flight.mcap")
    *_, asked = LogReader(path).records((OPERATION.topic,))
    assert operation_of(OPERATION, asked.time_ns, asked.data) == LandRequest(asked.time_ns)
    assert replay(path).differences == []


def change_thrust(record: Record, by: float) -> Record:
    """The first frame in it that sets an attitude with `by` more thrust."""
    values = DATAGRAM.unpack(record.data)
    frames = Framer().datagram(values["data"])
    place = next(i for i, frame in enumerate(frames) if frame.message_id == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET)
    message = decode(frames[place])
    assert message is not None
    message.thrust += by
    encoder = Encoder(frames[place].system, frames[place].component)
    encoder.sequence = frames[place].sequence
    raw = [frame.raw for frame in frames]
    raw[place] = encoder.encode(message)
    return record._replace(data=DATAGRAM.pack(values["direction"], values["address"], b"".join(raw)))


def is_setpoint_after(record: Record, time_s: float) -> bool:
    data = sent(record)
    return (
        data is not None
        and record.time_ns > time_s * 1e9
        and any(frame.message_id == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET for frame in Framer().datagram(data))
    )


@pytest.fixture(scope="module")
def victim(fly: Flyer) -> Record:
    """A datagram in the middle of the flight with a setpoint in it."""
    return next(record for record in LogReader(fly()).records() if is_setpoint_after(record, AT_S))


def test_a_changed_field_is_named(fly: Flyer, victim: Record, tmp_path: Path) -> None:
    """The log says 0.125 more thrust than was sent, three times."""
    left = [3]

    def change(record: Record) -> list[Record]:
        if left[0] and is_setpoint_after(record, AT_S):
            left[0] -= 1
            return [change_thrust(record, 0.125)]
        return [record]

    result = replay(rewritten(fly(), tmp_path / "changed.mcap", change))
    (difference,) = result.differences
    assert (difference.message, difference.field) == ("SET_ATTITUDE_TARGET", "thrust")
    assert (difference.first_ns, difference.count) == (victim.time_ns, 3)
    assert difference.largest == pytest.approx(0.125, rel=1e-6)


@pytest.mark.parametrize("where", [MISSING, EXTRA])
def test_a_datagram_too_many_or_too_few_is_named(fly: Flyer, victim: Record, tmp_path: Path, where: str) -> None:
    def change(record: Record) -> list[Record]:
        if record != victim:
            return [record]
        return [record, record] if where == MISSING else []

    result = replay(rewritten(fly(), tmp_path / "changed.mcap", change))
    assert {(each.field, each.first_ns) for each in result.differences} == {(where, victim.time_ns)}
    frames = Framer().datagram(sent(victim) or b"")
    names = Counter(layout(frame.message_id).name for frame in frames)
    assert {each.message: each.count for each in result.differences} == names


def test_bytes_that_are_no_frame_are_compared_too() -> None:
    differ = Differ()
    differ.datagram(5, b"\x01\x02", b"\x01\x03")
    differ.datagram(6, b"\x01\x02", b"\x01\x02")
    (difference,) = differ.differences
    assert (difference.message, difference.first_ns, difference.count) == ("datagram", 5, 1)


def test_what_was_infinite_or_no_number_has_no_size_in_json() -> None:
    """The trace's free distance is inf where all is free; a NaN in a setpoint says that it is not used."""
    then, now = np.zeros(1, LOGGED.dtype), np.zeros(1, LOGGED.dtype)
    then["free_distance"], then["clearance"], now["clearance"] = np.inf, np.nan, 2.0
    differ = Differ()
    differ.trace(0, then.tobytes(), now.tobytes())
    differ.trace(1, now.tobytes(), np.zeros(1, LOGGED.dtype).tobytes())
    differ.trace(2, then.tobytes(), now.tobytes())
    sizes = {each.field: each.largest for each in differ.differences}
    assert sizes == {"free_distance": np.inf, "clearance": 2.0}
    result = Replay(differ.differences, [], 1, 1, 1, 1.0, 1.0, {}, None)
    rows = json.loads(json.dumps(_replay_table(result), allow_nan=False))["differences"]
    assert {row["field"]: row["largest"] for row in rows} == {"free_distance": None, "clearance": 2.0}


def test_what_if(fly: Flyer, tmp_path: Path) -> None:
    """Less is allowed: no thrust above the limit is sent, and where it was below before nothing else changes."""
    before = replay(fly(), keeps_series=True).series["SET_ATTITUDE_TARGET", "thrust"].recorded
    limit = 0.5 * (max(before) + sorted(before)[len(before) // 2])
    picture = tmp_path / "difference.png"
    done = run(
        "companion", "replay", str(fly()), "--set", f"limits.highest_thrust={limit}", "--plot", str(picture), "--json"
    )
    assert done.returncode == 1
    found = {(each["message"], each["field"]): each for each in json.loads(done.stdout)["differences"]}
    assert found["SET_ATTITUDE_TARGET", "thrust"]["largest"] >= max(before) - limit - 1e-6
    assert picture.read_bytes()[:4] == b"\x89PNG"
    series = replay(fly(), None, [f"limits.highest_thrust={limit}"], keeps_series=True).series
    assert max(series["SET_ATTITUDE_TARGET", "thrust"].replayed) <= limit + 1e-6


def test_settings_that_can_not_be_used(fly: Flyer) -> None:
    with pytest.raises(TomlFileError, match=r"limits\.nothing|nothing"):
        replay(fly(), None, ["limits.nothing=1"])
    done = run("companion", "replay", str(fly()), "--set", "limits.nothing=1")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


def test_a_cut_log_is_the_same_up_to_there(fly: Flyer, tmp_path: Path) -> None:
    content = fly().read_bytes()
    for part in (0.3, 0.7, 0.999):
        cut = tmp_path / f"{part}.mcap"
        cut.write_bytes(content[: int(len(content) * part)])
        result = replay(cut)
        assert result.differences == [] and result.datagrams > 100
        assert len(result.notes) == 1 and "cut off" in result.notes[0]


@pytest.mark.parametrize("killed", [False, True])
def test_the_last_event_of_a_companion_that_was_killed_may_have_no_answer(
    fly: Flyer, victim: Record, tmp_path: Path, killed: bool
) -> None:
    end = {"reason": "the flying process ended without closing the log"} if killed else None

    def change(record: Record) -> list[Record]:
        return [record] if record.sequence < victim.sequence else []

    path, copy = rewritten(fly(), tmp_path / "killed.mcap", change, end=end), tmp_path / "whole.mcap"
    for result in (replay(path, trace=copy), replay(copy)):
        assert {each.field for each in result.differences} == (set() if killed else {EXTRA})
        assert result.datagrams > 100


@pytest.mark.parametrize("way", ["repaired", "traced"])
def test_nor_may_that_of_a_log_that_was_made_of_a_cut_one(fly: Flyer, tmp_path: Path, way: str) -> None:
    """The cut is looked for where the last event's answer is behind it."""
    content, cut, copy = fly().read_bytes(), tmp_path / "cut.mcap", tmp_path / "copy.mcap"
    for size in range(len(content) // 2, len(content), 499):
        cut.write_bytes(content[:size])
        *_, last = (each for each in LogReader(cut).records() if not each.topic.startswith("/mavlink/"))
        if last.topic == TICK.topic and last.time_ns < 8e9:
            break
    if way == "repaired":
        repair(cut, copy)
    else:
        replay(cut, trace=copy)
    result = replay(copy)
    assert result.problem is None and result.differences == []


def test_a_copy_of_a_log_without_anything_sent_is_not_left_behind(fly: Flyer, tmp_path: Path) -> None:
    path = rewritten(fly(), tmp_path / "silent.mcap", lambda record: [] if sent(record) is not None else [record])
    with pytest.raises(FlightLogError, match=r"silent\.mcap: there is nothing in it that was sent"):
        replay(path, trace=tmp_path / "whole.mcap")
    assert [each.name for each in tmp_path.iterdir()] == ["silent.mcap"]


def test_it_ends_where_records_are_missing(fly: Flyer, tmp_path: Path) -> None:
    """A tenth of a second of the middle is lost with a damaged chunk."""

    def change(record: Record) -> list[Record]:
        return [] if 6.0e9 < record.time_ns < 6.1e9 else [record]

    result = replay(rewritten(fly(), tmp_path / "gap.mcap", change))
    assert result.differences == []
    assert result.flown_s == pytest.approx(6.0, abs=0.3)
    assert any("records are missing after 6.000 s" in note for note in result.notes)


def test_without_its_beginning_nothing_is_flown_again(fly: Flyer, tmp_path: Path) -> None:
    path = rewritten(fly(), tmp_path / "late.mcap", lambda record: [] if record.time_ns < 2.0e9 else [record])
    with pytest.raises(FlightLogError, match=r"late\.mcap: its beginning, up to 2\.000 s, is missing"):
        replay(path)


@pytest.mark.parametrize("lost", ["3", "many"])
def test_records_that_never_reached_the_log_are_said(fly: Flyer, tmp_path: Path, lost: str) -> None:
    """Whatever a log says of them."""
    path = rewritten(fly(), tmp_path / "holes.mcap", end={"dropped": "2", "lost": lost, "undecoded": "9"})
    assert LogReader(path).missing == {"dropped": "2", "lost": lost, "undecoded": "9"}
    (note,) = replay(path).notes
    assert f"2 dropped, {lost} lost" in note and "undecoded" not in note
    assert LogReader(fly()).missing == {}


def test_another_version_is_said(fly: Flyer, tmp_path: Path) -> None:
    path = rewritten(fly(), tmp_path / "old.mcap", flight={"courier": "0.0.9", "numpy": "1.0"})
    notes = replay(path).notes
    assert len(notes) == 2
    assert any("courier 0.0.9" in note for note in notes) and any("numpy 1.0" in note for note in notes)


@pytest.mark.parametrize(("name", "value"), [("overrides", "{"), ("overrides", "[1]"), ("output", "wings")])
def test_damaged_words_are_refused(fly: Flyer, tmp_path: Path, name: str, value: str) -> None:
    path = rewritten(fly(), tmp_path / "damaged.mcap", flight={name: value})
    with pytest.raises(FlightLogError, match=f"damaged.mcap.*{name}"):
        replay(path)


def test_what_is_no_flight_is_refused(many_chunks: Path, tmp_path: Path) -> None:
    for path in (many_chunks, DATA / "px4_offboard.tlog", tmp_path / "none.mcap"):
        with pytest.raises(FlightLogError, match=path.name):
            replay(path)
    done = run("companion", "replay", str(DATA / "px4_offboard.tlog"))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


def test_the_command_says_so(fly: Flyer) -> None:
    done = run("companion", "replay", str(fly().parent))
    assert done.returncode == 0 and done.stdout.startswith("the same to the bit")


def test_a_cut_log_fails_though_nothing_differs(fly: Flyer, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(fly().read_bytes()[:400_000])
    done = run("companion", "replay", str(cut))
    assert done.returncode == 1 and done.stdout.startswith("the same to the bit") and "cut off" in done.stderr


def test_a_trace_of_other_settings_has_these_settings(fly: Flyer, tmp_path: Path) -> None:
    """And comes out the same again by them."""
    target = tmp_path / "whole.mcap"
    asked = ["control.position.c1=[2.0,2.0,2.0]", "mission.speed=3.0"]
    replay(fly(), overrides=asked, trace=target)
    copy = LogReader(target)
    assert json.loads(copy.attachments["settings.json"])["control"]["position"]["c1"] == [2.0, 2.0, 2.0]
    assert json.loads(copy.metadata["what if"]["overrides"]) == asked
    assert "what if" not in LogReader(fly()).metadata
    again = replay(target)
    assert not any(each.message == "trace" for each in again.differences)


def test_a_picture_that_can_not_be_is_refused_before_the_flight(fly: Flyer, tmp_path: Path) -> None:
    before = fly().read_bytes()
    for plot in ("noext", "a.docx", "none/a.png", str(fly())):
        done = run("companion", "replay", str(fly()), "--plot", str(tmp_path / plot))
        assert done.returncode == 2 and done.stdout == "" and len(done.stderr.splitlines()) == 1
    disguised = tmp_path / "log.png"
    disguised.write_bytes(before)
    done = run("companion", "replay", str(disguised), "--plot", str(disguised))
    assert done.returncode == 2 and "never written over" in done.stderr and disguised.read_bytes() == before
    done = run("companion", "replay", str(fly()), "--plot", str(tmp_path / "a.png"))
    assert done.returncode == 0 and "nothing differs" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.png"]
