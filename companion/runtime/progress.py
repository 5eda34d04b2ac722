"""How far a flight is, for the person who watches."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from companion.autopilot import Autopilot
from companion.mission.plan import Step
from companion.supervision.states import FLYING, State
from protocol.arrays import Array
from protocol.flightlog import Status

_LANDING_SPEED = 0.7
"""m/s at which vehicles land."""
_SILENT_S = 1.0
_HINT = "Ctrl-C lands"


class Ahead(NamedTuple):
    """What is left of the mission."""

    metres: float
    """inf where a track is on the way."""
    seconds: float


class Progress:
    """The state of an autopilot's flight in words, whenever it is asked for."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._durations = autopilot.guidance.durations
        self._step, self._step_since_ns = -1, 0
        self._whole_s = 0.0
        """The longest that was ever left."""

    def status(self, now_ns: int, flown_s: float) -> Status:
        """After `flown_s` on the companion's clock."""
        autopilot, navigator, state = self._autopilot, self._autopilot.navigator, self._autopilot.sensing.state
        supervised = autopilot.supervisor.state
        doing = (navigator.phase if supervised is State.FLY else supervised).name.lower()
        title = f"{navigator.mission.name}: {doing}"
        if supervised is State.FLY and navigator.steps:
            title += f", step {navigator.step_index + 1} of {len(navigator.steps)}"
        figures = [("time", clock_text(flown_s))]
        done = None
        if autopilot.supervisor.waiting_for is not None:
            title += f", waiting: {autopilot.supervisor.waiting_for}"
        if state is not None:
            if navigator.steps and supervised in FLYING:
                ahead = self._ahead(state.position_ned, now_ns)
                if math.isfinite(ahead.seconds):  # not while it waits for orders
                    self._whole_s = max(self._whole_s, ahead.seconds)
                    done = 1.0 - ahead.seconds / self._whole_s if self._whole_s else None
                figures += [] if math.isinf(ahead.metres) else [("to go", f"{ahead.metres:.0f} m")]
                figures.append(("time to go", clock_text(ahead.seconds)))
            height = navigator.ground_down - float(state.position_ned[2])
            speed = math.hypot(*state.velocity_ned.tolist())
            figures += [("speed", f"{speed:.1f} m/s"), ("height", f"{height:.1f} m")]
            clearance = autopilot.guidance.decision.clearance
            figures += [("clearance", f"{clearance:.1f} m")] if math.isfinite(clearance) else []
        figures += self._vehicle(now_ns)
        return Status(title, tuple(figures), done, _HINT)

    def _vehicle(self, now_ns: int) -> list[tuple[str, str]]:
        """Battery and link, as far as they are known."""
        autopilot = self._autopilot
        batteries = autopilot.sensing.report(now_ns, 0.0).batteries.values()
        charges = [battery.charge for battery in batteries if battery.charge is not None]
        volts = [battery.volts for battery in batteries if battery.volts is not None]
        battery = f"{min(charges):.0%}" if charges else f"{min(volts):.1f} V" if volts else None
        peer = autopilot.link.peer
        if peer is None or peer.heard_ns is None:
            link = "no vehicle yet"
        else:
            silent_s, lost = (now_ns - peer.heard_ns) * 1e-9, autopilot.link.traffic.messages_lost
            link = f"silent {silent_s:.0f} s" if silent_s > _SILENT_S else f"{lost} lost" if lost else "good"
        known = (("battery", battery), ("link", link))
        return [(name, value) for name, value in known if value is not None]

    def _ahead(self, here_ned: Array, now_ns: int) -> Ahead:
        navigator = self._autopilot.navigator
        if navigator.step_index != self._step:
            self._step, self._step_since_ns = navigator.step_index, now_ns
        left = [
            (step, self._durations[index] if step.curve is not None else None)
            for index, step in enumerate(navigator.steps[self._step :], self._step)
        ]
        settings, speed = self._autopilot.settings.trajectory, navigator.mission.speed
        elapsed_s = (now_ns - self._step_since_ns) * 1e-9
        return ahead(left, here_ned, elapsed_s, (speed, settings.climb_speed), navigator.ground_down)


def ahead(
    left: Sequence[tuple[Step, float | None]],
    here_ned: Array,
    elapsed_s: float,
    speeds: tuple[float, float],
    ground_down: float,
) -> Ahead:
    """What is left from a place (3,) on. `left`: the steps, the present one first, each with the time (s) of its track;
    `elapsed_s`: since the present one began. `speeds`: m/s, along and up."""
    metres, seconds, place = 0.0, 0.0, here_ned
    for index, (step, track_s) in enumerate(left):
        if step.target_ned is not None:
            way = np.abs(step.target_ned - place)
            along, up = math.hypot(*way[:2].tolist()), float(way[2])
            metres += math.hypot(along, up)
            seconds += max(along / (step.speed or speeds[0]), up / speeds[1]) + step.hold_s
            place = step.target_ned
        if track_s is not None:
            metres = math.inf
            seconds += track_s if index else max(track_s - elapsed_s, 0.0)
    height = max(ground_down - float(place[2]), 0.0)
    return Ahead(metres + height, seconds + height / _LANDING_SPEED)


def clock_text(seconds: float) -> str:
    """As 1:05, or 1:00:05; "-" for no time."""
    if not math.isfinite(seconds):
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
