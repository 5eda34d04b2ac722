"""Lines, spectra, stretches and gaps of streams, against what numpy says of the whole."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.view.lines import (
    BUCKETS,
    Line,
    Regularity,
    ScanRows,
    Stretches,
    Track,
    thin,
)
from companion.view.spectra import SEGMENT, Pairs, Response, Spectrum


@given(st.integers(1, 400), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_extremes_of_every_stretch(count: int, buckets: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    times = np.sort(generator.uniform(-5.0, 5.0, count))
    values = generator.normal(size=count)
    kept_times, kept = thin(times, values, buckets)
    assert len(kept) <= max(2 * buckets, 1)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert set(zip(kept_times, kept, strict=True)) <= set(zip(times, values, strict=True))
    assert (np.diff(kept_times) >= 0.0).all()


def test_a_long_line_stays_small_and_keeps_a_single_spike() -> None:
    line = Line()
    spike = 777_777
    for start in range(0, 2_000_000, 5000):
        index = np.arange(start, start + 5000)
        line.add(index * 1e-3, np.where(index == spike, 9.0, np.sin(index * 1e-4)))
    times, values = line.points()
    assert len(values) <= 2 * BUCKETS
    assert values.max() == 9.0
    assert times[values.argmax()] == spike * 1e-3
    assert values.min() == pytest.approx(-1.0, abs=1e-6)
    quiet = values != 9.0
    assert np.abs(values[quiet] - np.sin(times[quiet] * 0.1)).max() < 1e-9
    assert np.diff(times).max() < 2.5 * 2000.0 / BUCKETS


def test_what_is_not_finite_is_left_out() -> None:
    line = Line()
    line.add(np.arange(4.0), np.array([1.0, math.inf, math.nan, 2.0]))
    assert line.points()[1].tolist() == [1.0, 2.0]


def test_a_track_is_thinned_evenly_over_all_of_its_time() -> None:
    track = Track(2, most=100)
    for start in range(0, 100_000, 1000):
        times = np.arange(start, start + 1000) * 0.01
        track.add(times, 3.0 * times[:, None])
    rows = track.rows()
    assert 50 <= len(rows) <= 200
    assert rows[0, 0] == 0.0 and rows[-1, 0] > 980.0
    assert np.allclose(rows[:, 1], 3.0 * rows[:, 0])
    assert np.diff(rows[:, 0]).max() < 2.1 * np.diff(rows[:, 0]).min()


def test_a_track_keeps_what_is_recent_as_it_came_and_knows_how_late_the_rest_was_heard() -> None:
    track = Track(2, most=100, recent=50)
    for at in range(20_000):
        time = 0.02 * at
        track.add(np.array([time]), np.array([[3.0 * time]]))
        found = track.at(time)
        assert found is not None and (found[0].tolist(), found[1]) == ([3.0 * time], 0.0)
        rows = track.rows()
        assert len(rows) <= 200 and np.allclose(np.diff(rows[-50:, 0]), 0.02)
    assert len(rows) >= 100
    thinned = rows[:-100, 0]
    assert np.diff(thinned).max() < 2.1 * np.diff(thinned).min() and thinned[0] == 0.0
    ages = [found[1] for time in np.arange(1.0, 399.0, 0.1) if (found := track.at(float(time))) is not None]
    assert len(ages) == 3980 and min(ages) >= 0.0 and max(ages) <= 0.02 + 1e-9
    late = track.at(410.0)
    assert late is not None and late[1] == pytest.approx(410.0 - 399.98)
    assert track.at(-1.0) is None


@pytest.mark.parametrize("recent", [0, 50])
def test_a_track_of_one_instant_is_bounded_too(recent: int) -> None:
    track = Track(2, most=100, recent=recent)
    track.add(np.full(300, 7.0), np.arange(300.0)[:, None])
    rows = track.rows()
    assert 0 < len(rows) <= 200 and (rows[:, 0] == 7.0).all()
    assert rows[len(rows) - recent :, 1].tolist() == list(range(300 - recent, 300))


@pytest.mark.parametrize("count", [150, 5000])
def test_a_track_is_in_the_order_of_time_in_whatever_order_its_batches_come(count: int) -> None:
    """As those of two messages that tell the same do, and those of a clock that was set back."""
    track = Track(2, most=100)
    for start, stop in ((0, count), (0, count), (count // 2, count // 2 + 20)):
        times = 0.1 * np.arange(start, stop)
        track.add(times[::-1] if start else times, -times[::-1, None] if start else -times[:, None])
    rows = track.rows()
    assert (np.diff(rows[:, 0]) >= 0.0).all() and (rows[:, 1] == -rows[:, 0]).all()
    assert 50 <= len(rows) <= 2 * count + 20 and rows[-1, 0] > 0.09 * count


@given(st.lists(st.integers(0, 2), min_size=1, max_size=60), st.integers(1, 20))
def test_stretches_do_not_depend_on_how_the_stream_is_cut(values: list[int], cut: int) -> None:
    whole, parts = Stretches(), Stretches()
    times = np.arange(len(values)) * 0.5
    whole.add(times, np.array(values))
    for start in range(0, len(values), cut):
        parts.add(times[start : start + cut], np.array(values[start : start + cut]))
    found = parts.finish()
    assert found == whole.finish()
    assert [stretch.value for stretch in found] == [
        value for index, value in enumerate(values) if index == 0 or values[index - 1] != value
    ]
    assert sum(stretch.seconds for stretch in found) == pytest.approx(times[-1])
    assert sum(parts.seconds.values()) == pytest.approx(times[-1])


@pytest.mark.parametrize(
    ("intervals", "usual"),
    [
        ([0.064] * 40, 0.064),
        ([1.0, 1.0, 30.0], 1.0),
        ([1e-5, 1e-5, 1e-5, 0.1] * 20, 0.025),
        ([0.02] * 50 + [600.0] + [0.02] * 50, 0.02),
        ([1e-5, 1e-5, 1e-5, 0.1] * 5 + [600.0], 0.025),
        ([1e-5, 1e-5, 1e-5, 0.1] * 20 + [3.0], 0.025),
        ([0.5], 0.5),
        ([], 0.0),
    ],
)
def test_the_usual_interval_is_never_longer_than_the_longest(intervals: list[float], usual: float) -> None:
    """Also of what comes with pauses, and several at once."""
    clock = Regularity()
    clock.add(np.cumsum([5.0, *intervals]))
    assert clock.usual == pytest.approx(usual, rel=1e-3)


def test_the_longest_silences_are_found_across_batches() -> None:
    times = np.cumsum(np.full(10_000, 0.02))
    times[5000:] += 1.0
    times[8192:] += 0.5
    clock = Regularity()
    for start in range(0, len(times), 4096):
        clock.add(times[start : start + 4096])
    (longest, at), (second, after), *_ = clock.gaps
    assert [longest, at] == pytest.approx([1.02, times[4999]])
    assert [second, after] == pytest.approx([0.52, times[8191]])
    assert clock.usual == pytest.approx(0.02)
    assert clock.rate == pytest.approx(9999 / (times[-1] - times[0]))


def test_a_spectrum_holds_the_power_of_a_sine_where_it_is() -> None:
    """Parseval: the density's integral is the mean square."""
    spectrum = Spectrum(2)
    times = np.arange(20_000) * 0.004
    values = np.column_stack((0.6 * np.sin(2.0 * np.pi * 40.0 * times), 0.2 * np.sin(2.0 * np.pi * 5.0 * times)))
    for start in range(0, len(times), 777):
        spectrum.add(times[start : start + 777], values[start : start + 777])
    frequencies, density = spectrum.density()
    assert frequencies[density[:, 0].argmax()] == pytest.approx(40.0, abs=0.25)
    assert spectrum.rms_above(20.0)[0] == pytest.approx(0.6 / math.sqrt(2.0), rel=1e-3)
    assert spectrum.rms_above(20.0)[1] < 1e-4
    assert spectrum.rms_above(1.0)[1] == pytest.approx(0.2 / math.sqrt(2.0), rel=1e-3)


def test_a_spectrum_leaves_out_what_spans_a_gap() -> None:
    spectrum = Spectrum(1)
    times = np.arange(SEGMENT) * 0.004
    times[SEGMENT // 2 :] += 3.0
    spectrum.add(times, np.ones((SEGMENT, 1)))
    assert spectrum.segments == 0


def test_a_first_order_lag_is_found_in_its_commands_and_answers() -> None:
    """The analytic answer of a lag of rate k to a step: 1 - exp(-k t); an axis with the sign turned answers with -1."""
    generator = np.random.default_rng(7)
    step, k = 0.004, 20.0
    decay = math.exp(-k * step)
    commands = np.repeat(generator.normal(size=(2000, 1)), 10, axis=0)
    answers = np.zeros_like(commands)
    for index in range(1, len(commands)):
        answers[index] = decay * answers[index - 1] + (1.0 - decay) * commands[index - 1]
    response = Response(2)
    times = np.arange(len(commands)) * step
    for start in range(0, len(times), 900):
        part = slice(start, start + 900)
        pair = np.column_stack((answers[part], -answers[part]))
        response.add_pairs(times[part], np.column_stack((commands[part], commands[part])), pair)
    after, found = response.step_response(0.4)
    wanted = 1.0 - np.exp(-k * after)
    assert len(after) == 100
    assert np.abs(found[10:, 0] - wanted[10:]).max() < 0.06
    assert np.allclose(found[:, 1], -found[:, 0])


def test_rings_keep_the_nearest_return_of_each_bearing() -> None:
    scans = ScanRows(most=4)
    for index in range(64):
        ranges = np.full(3, np.nan)
        ranges[1] = 10.0 - (index == 37) * 9.0
        scans.add(float(index), ranges)
    rows = list(scans.rows())
    assert len(rows) <= 8
    nearest = np.array([row for _, row in rows])
    assert np.isnan(nearest[:, [0, 2]]).all()
    hit = int(nearest[:, 1].argmin())
    assert nearest[hit, 1] == 1.0
    assert rows[hit][0] <= 37.0 < (rows[hit + 1][0] if hit + 1 < len(rows) else math.inf)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_commands_and_answers_of_one_time_are_paired_however_they_come(seed: int) -> None:
    generator = np.random.default_rng(seed)
    asked = np.sort(generator.choice(2000, 900, replace=False)) * 0.004
    answered = np.sort(generator.choice(2000, 1200, replace=False)) * 0.004
    pairs = Pairs(2)
    found = []
    while len(asked) or len(answered):
        count, other = generator.integers(0, 150, 2)
        for add, times in ((pairs.commands, asked[:count]), (pairs.answers, answered[:other])):
            found.append(add(times, np.column_stack((times, 2.0 * times))))
        asked, answered = asked[count:], answered[other:]
    times, commands, answers = (np.concatenate(part) for part in zip(*found, strict=True))
    assert (np.diff(times) > 0.0).all()
    assert (commands == np.column_stack((times, 2.0 * times))).all() and (answers == commands).all()
    generator = np.random.default_rng(seed)
    both = np.intersect1d(generator.choice(2000, 900, replace=False), generator.choice(2000, 1200, replace=False))
    assert len(times) == len(both)
