"""The strip below the live page's slider: phases and modes of the flight so far, and when a warning was said."""

from collections.abc import Callable
from html import escape

from companion.view.history import Span

_COLORS = ("#bcd7f5", "#c5e8cd", "#f7dca3", "#e3cdf3", "#c9d3dc", "#f9cfc0", "#bfe7e6")
"""Backgrounds for dark text."""
_LEAST_SHARE, _LETTER_SHARE = 0.004, 0.026
"""Shares of the strip's width: of a span that can be seen, and of a letter."""
STYLE = """<style>
#strip {position:relative; margin:2px 14px 6px; font:11px/15px system-ui,sans-serif; color:#10151c}
#strip .row {position:relative; height:15px; margin-bottom:2px; background:#eef1f4; border-radius:2px; overflow:hidden}
#strip .row div {position:absolute; top:0; height:15px; padding-left:3px; box-sizing:border-box; overflow:hidden;
  white-space:nowrap}
#strip .warning {position:absolute; top:0; bottom:0; width:3px; margin-left:-1px; background:#c62f00}
#strip .now {position:absolute; top:-2px; bottom:-2px; width:2px; background:#10151c}
</style>"""


def strip(rows: list[list[Span]], warnings: list[float], start: float, end: float, now: float) -> str:
    """Rows of spans from `start` to `end` (s), with marks at `warnings` and at `now`, as HTML."""
    length = max(end - start, 1e-3)

    def share(time: float) -> float:
        return min(max((time - start) / length, 0.0), 1.0)

    drawn = "".join(f'<div class="row">{_row(spans, share)}</div>' for spans in rows if spans)
    marks = "".join(f'<div class="warning" style="left:{100 * share(time):.2f}%"></div>' for time in warnings)
    return f'<div id="strip">{drawn}{marks}<div class="now" style="left:{100 * share(now):.2f}%"></div></div>'


def _row(spans: list[Span], share: Callable[[float], float]) -> str:
    """Each name has one color; a name that does not fit is left out, and is in the tooltip."""
    names = list(dict.fromkeys(span.name for span in spans))
    parts = []
    for span in spans:
        left, width = share(span.start), max(share(span.end) - share(span.start), _LEAST_SHARE)
        color, name = _COLORS[names.index(span.name) % len(_COLORS)], escape(span.name)
        text = name if width > _LETTER_SHARE * len(span.name) else ""
        place = f"left:{100 * left:.2f}%;width:{100 * width:.2f}%"
        parts.append(f'<div title="{name}" style="{place};background:{color}">{text}</div>')
    return "".join(parts)
