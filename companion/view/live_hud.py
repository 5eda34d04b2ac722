"""What lies over the live page's view: a bar with phase, mode, battery and link, the alerts below it, and the
instruments."""

from dataclasses import dataclass
from html import escape

from companion.outcomes import Verdict
from companion.view.accumulators.texts import ERROR, WARNING
from companion.view.history import Moment
from companion.view.live_instruments import battery_icon, flown, instruments, link_icon
from companion.view.live_words import SILENT_S

PANEL_PX = 330
"""Width of the panel beside the view."""
_MOST_ALERTS = 3
_ALERT_S = 15.0
"""A warning that was said is shown for this long (s)."""
_LOW_PERCENT, _EMPTY_PERCENT = 25.0, 12.0
_GOOD, _WARN, _BAD = "#5fd38d", "#ffc14d", "#ff8080"
STYLE = f"""<style>
:root {{--mantine-color-dimmed:#5a6470 !important; --mantine-primary-color-filled:#1864ab !important;
  --mantine-color-blue-filled:#1864ab !important; --mantine-color-blue-outline:#1864ab !important;
  --mantine-color-orange-filled:#a84300 !important}}
.hud {{position:fixed; left:10px; z-index:5; pointer-events:none; color:#fff; font:13px/1.35 system-ui,sans-serif;
  font-variant-numeric:tabular-nums}}
#bar, #alerts {{right:{PANEL_PX + 10}px}}
#bar {{top:10px; display:flex; flex-wrap:wrap; gap:2px 14px; align-items:center; padding:5px 12px; border-radius:6px;
  background:#0d1117e6}}
#bar > span {{display:inline-flex; align-items:center; gap:6px; white-space:nowrap}}
#bar .big {{font-weight:700; text-transform:uppercase; letter-spacing:.04em; color:#ffd54a}}
#bar .end {{margin-left:auto}}
#alerts {{top:74px}}
#alerts div {{display:table; max-width:100%; margin-bottom:4px; padding:3px 12px; border-radius:5px; font-weight:600;
  overflow-wrap:anywhere}}
#alerts .bad {{background:#a31621; color:#fff}}
#alerts .warn {{background:#ffc14d; color:#1b1200}}
#instruments {{display:block}}
#pfd {{bottom:10px; padding:6px; border-radius:6px; background:#0d1117e6}}
.mantine-Notifications-root[data-position^=top] {{top:auto !important; bottom:270px !important}}
@media (max-width:576px) {{ #bar, #alerts {{right:10px}} #pfd {{bottom:auto; top:140px}} }}
</style>"""


@dataclass(frozen=True, slots=True)
class Alert:
    """Something that must not be missed."""

    level: int
    """WARNING or more."""
    time: float
    """Since when (s)."""
    text: str


def alerts(moment: Moment, problem: str | None = None, verdict: Verdict | None = None) -> list[Alert]:
    """What must not be missed at a moment, the worst first, of equals the newest.

    `problem` is one of the page's source; `verdict` is given once the flight is over.
    """
    now, plan, age, battery = moment.time, moment.plan, moment.link_age, moment.battery
    found = [Alert(text.level, text.time, text.text) for text in moment.warnings if text.time > now - _ALERT_S]
    if problem:
        found.append(Alert(ERROR, now, problem))
    if verdict is not None and not verdict.outcome.wanted:
        found.append(Alert(ERROR, now, verdict.text))
    if moment.failsafe:
        found.append(Alert(ERROR, now, "the vehicle is in a failsafe"))
    if age is not None and age > SILENT_S and verdict is None:
        found.append(Alert(ERROR, now, f"link lost: nothing heard for {age:.0f} s"))
    if plan is not None and plan.guard:
        found.append(Alert(ERROR if plan.guard_blind else WARNING, now, f"guard: {plan.guard}"))
    if battery is not None and battery < _LOW_PERCENT:
        found.append(Alert(ERROR if battery < _EMPTY_PERCENT else WARNING, now, f"battery: {battery:.0f} % left"))
    return sorted(found, key=lambda alert: (-alert.level, -alert.time))


def hud(moment: Moment, when: str, found: list[Alert]) -> str:
    """All that lies over the view, as HTML; `when` is the time that is shown. Text from outside is escaped."""
    lines = "".join(
        f'<div class="{"bad" if alert.level >= ERROR else "warn"}">{escape(alert.text)}</div>'
        for alert in found[:_MOST_ALERTS]
    )
    more = len(found) - _MOST_ALERTS
    lines += f'<div class="warn">and {more} more</div>' if more > 0 else ""
    return (
        f'<div id="bar" class="hud">{_bar(moment, when)}</div>'
        f'<div id="alerts" class="hud" role="status">{lines}</div>'
        f'<div id="pfd" class="hud">{instruments(flown(moment))}</div>'
    )


def _bar(moment: Moment, when: str) -> str:
    plan = moment.plan
    doing = moment.doing or ("waiting" if moment.link_age is None else "no companion")
    parts = [f'<span class="big" id="bar-phase">{escape(doing)}</span>']
    parts.append(f'<span id="bar-mode">{escape(moment.mode)}</span>')
    if moment.link_age is not None:
        parts.append(f'<span id="bar-armed">{"armed" if moment.armed else "disarmed"}</span>')
    if plan is not None and plan.clearance < 10.0:
        parts.append(f'<span id="bar-clearance">clearance {plan.clearance:.1f} m</span>')
    parts.append(f'<span id="bar-time" class="end">{escape(when)}</span>')
    return "".join((*parts, _battery(moment.battery), _link(moment.link_age)))


def _battery(percent: float | None) -> str:
    if percent is None:
        return ""
    color = _GOOD if percent >= _LOW_PERCENT else _WARN if percent >= _EMPTY_PERCENT else _BAD
    return f'<span id="bar-battery" title="battery">{battery_icon(percent, color)}{percent:.0f} %</span>'


def _link(age: float | None) -> str:
    """The bars are lit by how long ago the vehicle was heard."""
    if age is None or age > SILENT_S:
        lost = "no link" if age is None else f"lost {age:.0f} s"
        return f'<span id="bar-link" title="link" style="color:{_BAD}">{link_icon(0, _BAD)}{lost}</span>'
    bars = 4 if age < 0.15 else 3 if age < 0.25 else 2
    return f'<span id="bar-link" title="link">{link_icon(bars, _GOOD if bars > 2 else _WARN)}link</span>'
