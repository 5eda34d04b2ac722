"""The live page's table of figures: the moment that is shown, in words."""

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from companion.outcomes import Verdict
from companion.view.history import Moment, Plan

SILENT_S = 0.5
"""A vehicle that was not heard for longer than this (s) is highlighted: the companion waits no longer either."""
HIGHLIGHT = ' style="color:#c4006a;font-weight:600"'


def words(
    moment: Moment, name: str, when: str, problem: str | None, verdict: Verdict | None = None, *, quiet: bool = False
) -> str:
    """The table of a moment of the flight `name`, as HTML. Text from outside is escaped.

    `when` follows the time; `problem` stands above the table; `verdict` is on the whole flight; `quiet`: nothing new
    comes.
    """
    plan = moment.plan
    rows = [("flight", name), ("time", f"{moment.time:.2f} s{when}")]
    if verdict is not None:
        rows.insert(1, ("outcome", verdict.text))
    if moment.phase is not None and moment.state is not None:
        rows += [("phase", moment.phase), ("companion", moment.state)]
    rows += [*_link(moment), *_motion(moment)]
    if plan is not None:
        rows += _avoidance(plan)
    if moment.nearest is not None:
        rows.append(("nearest", f"{moment.nearest:.2f} m"))
    if moment.battery is not None:
        rows.append(("battery", f"{moment.battery:.0f} %"))
    highlighted = {
        "time": quiet,
        "outcome": verdict is not None and not verdict.outcome.wanted,
        "failsafe": moment.failsafe,
        "link": moment.link_age is not None and moment.link_age > SILENT_S,
        "guard": plan is not None and bool(plan.guard),
    }
    cells = "".join(
        f'<tr><td style="color:#5a6470;padding-right:12px">{name}</td>'
        f'<td id="{name}"{HIGHLIGHT if highlighted.get(name) else ""}>{escape(value)}</td></tr>'
        for name, value in rows
    )
    trouble = f'<div style="color:#b3173a">{escape(problem)}</div>' if problem else ""
    style = "font-size:13px;line-height:1.38;padding:4px 14px;font-variant-numeric:tabular-nums"
    return f'<div style="{style}">{trouble}<table style="border-spacing:0">{cells}</table></div>'


def said(moment: Moment) -> str:
    """The last few lines that were said, as HTML, the newest first."""
    return paragraphs(*(f"{text.time:.1f} {text.text}" for text in reversed(moment.texts)))


def paragraphs(*texts: str) -> str:
    """Texts as HTML, a paragraph each; empty ones are left out. Text from outside is escaped."""
    style = "margin:6px 14px;font-size:13px;overflow-wrap:anywhere"
    return "".join(f'<p style="{style}">{escape(text)}</p>' for text in texts if text)


def legend(colors: Mapping[str, tuple[int, int, int]]) -> str:
    """What is drawn in which color, as HTML."""
    rows = "".join(
        f'<div><span style="display:inline-block;width:12px;height:12px;border-radius:3px;margin-right:8px;'
        f'vertical-align:-1px;background:rgb{color}"></span>{escape(name)}</div>'
        for name, color in colors.items()
    )
    return f'<div id="legend" style="font-size:13px;margin:4px 14px;line-height:1.6">{rows}</div>'


def _link(moment: Moment) -> list[tuple[str, str]]:
    if moment.link_age is None:
        return [("mode", "unknown"), ("failsafe", "unknown"), ("link", "silent")]
    return [
        ("mode", moment.mode + (", armed" if moment.armed else ", disarmed")),
        ("failsafe", "YES" if moment.failsafe else "no"),
        ("link", f"heard {1e3 * moment.link_age:.0f} ms ago"),
    ]


def _motion(moment: Moment) -> list[tuple[str, str]]:
    if moment.position_ned is None or moment.velocity_ned is None:
        return []
    north, east, down = moment.position_ned
    return [
        ("place", f"north {north:.1f}, east {east:.1f}, height {-down:.1f} m"),
        ("speed", f"{np.linalg.norm(moment.velocity_ned):.1f} m/s"),
    ]


def _avoidance(plan: Plan) -> list[tuple[str, str]]:
    clearance = f"{plan.clearance:.2f} m" if math.isfinite(plan.clearance) else "nothing near"
    notes = [note for note, holds in (("avoiding", plan.blocked), ("at a limit", plan.limited)) if holds]
    return [
        ("clearance", ", ".join([clearance, *notes])),
        ("guard", f"{plan.guard}, {plan.guard_change:.1f} m/s²" if plan.guard else "quiet"),
    ]
