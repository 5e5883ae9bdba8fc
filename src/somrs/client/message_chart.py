"""The message sequence chart of a transaction as SVG (the paper's Figure "Sequence of transaction messages")."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from somrs.client.trace import TASK_MANAGER, Line

LEFT_MARGIN, TOP_MARGIN, COLUMN, ROW = 90, 90, 330, 40
"""Pixels: the margins, the distance between lifelines, and the distance between messages."""

MOST_TEXT = 50
"""Maximum number of characters of a note beside an arrow."""

_STYLE = """
  .chart { font-family: system-ui, sans-serif; font-size: 13px; fill: #1c2733 }
  .ground { fill: #ffffff }
  .head { fill: #e8eef5; stroke: #5b7083 }
  .name { font-weight: 600; text-anchor: middle }
  .life { stroke: #9fb0c0; stroke-dasharray: 4 4 }
  .arrow { stroke: #2c5d8f; stroke-width: 1.6; fill: none }
  .bad { stroke: #b3261e }
  .label { text-anchor: middle; font-weight: 600 }
  .note { text-anchor: middle; font-size: 11px; fill: #52616f }
  .time { font-size: 11px; fill: #52616f; text-anchor: end }
"""

SETBACKS = frozenset(("Failed", "Refuse", "Stranded", "Fault", "Stop"))
"""Message types that are drawn in red."""


def chart(lines: Sequence[Line], title: str) -> str:
    """The chart as an SVG document: a lifeline for each party, and an arrow for each message, in order of time."""
    services = dict.fromkeys(party for line in lines for party in (line.sender, line.recipient) if party != TASK_MANAGER)
    parties = [TASK_MANAGER, *sorted(services)]
    place = {party: LEFT_MARGIN + 60 + index * COLUMN for index, party in enumerate(parties)}
    width = place[parties[-1]] + 160
    height = TOP_MARGIN + ROW * (len(lines) + 1) + 30
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" viewBox="0 0 {width} {height}" width="{width}" height="{height}">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        *_arrowheads(),
        f'<rect class="ground" width="{width}" height="{height}"/>',
        f'<text x="{LEFT_MARGIN - 60}" y="28" font-size="16" font-weight="600">{escape(title)}</text>',
    ]
    for party, x in place.items():
        half = max(100, 4 * len(party) + 14)
        drawn.append(f'<line class="life" x1="{x}" y1="{TOP_MARGIN - 14}" x2="{x}" y2="{height - 20}"/>')
        drawn.append(f'<rect class="head" x="{x - half}" y="{TOP_MARGIN - 46}" width="{2 * half}" height="30" rx="6"/>')
        drawn.append(f'<text class="name" x="{x}" y="{TOP_MARGIN - 26}">{escape(party)}</text>')
    start = lines[0].at if lines else 0.0
    for number, line in enumerate(lines):
        drawn += _arrow(line, place[line.sender], place[line.recipient], TOP_MARGIN + ROW * (number + 1), start)
    return "\n".join([*drawn, "</svg>"]) + "\n"


def _arrowheads() -> Iterable[str]:
    for name, colour in (("head", "#2c5d8f"), ("badhead", "#b3261e")):
        yield (
            f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">'
            f'<path d="M0 0 L10 5 L0 10 z" fill="{colour}"/></marker>'
        )


def _arrow(line: Line, start: int, end: int, y: int, start_time: float) -> Iterable[str]:
    bad = line.type in SETBACKS
    ending = -2 if end > start else 2
    yield (
        f'<path class="arrow{" bad" if bad else ""}" d="M{start} {y} L{end + ending} {y}" '
        f'marker-end="url(#{"badhead" if bad else "head"})"/>'
    )
    # A label is beside the lifeline of the service, so that on a long arrow it does not cross other lifelines.
    middle = (max(start, end)) - COLUMN // 2
    yield f'<text class="label" x="{middle}" y="{y - 5}">{escape(line.type)}</text>'
    if note := describe_message(line):
        yield f'<text class="note" x="{middle}" y="{y + 12}">{escape(note)}</text>'
    yield f'<text class="time" x="{LEFT_MARGIN - 10}" y="{y + 4}">{line.at - start_time:.2f} s</text>'


def describe_message(line: Line) -> str:
    """The main content of a message, cut to fit on a line."""
    body = line.body
    match line.type:
        case "Arrange" | "Execute":
            effect, precondition = body.get("effect"), body.get("precondition")
            text = f"{effect or ''}{f' when {precondition}' if precondition else ''}".strip()
        case "Terms":
            text = f"{body.get('price', 0):g} {body.get('currency', 'EUR')}, {body.get('duration', 0):.0f} s"
        case "Completed" | "Stopped" | "Compensate" | "Compensated":
            text = str(body.get("situation", ""))
        case "Failed" | "Stranded":
            text = str(body.get("situation") or body.get("description") or "")
        case "Progress":
            text = str(body.get("note") or f"{100 * float(body.get('fraction', 0)):.0f} %")
        case "Cancel" | "Refuse" | "Stop":
            text = str(body.get("reason", ""))
        case "End":
            text = str(body.get("outcome", ""))
        case "Fault":
            text = str(body.get("text", ""))
        case _:
            text = ""
    return text if len(text) <= MOST_TEXT else text[: MOST_TEXT - 1] + "…"
