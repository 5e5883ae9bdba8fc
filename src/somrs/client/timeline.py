"""The timeline of a transaction: the work of each device as bars, for the terminal and as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from rich.table import Table
from rich.text import Text

from somrs.client.trace import Line

_BEGINS = {"Execute": "does", "Compensate": "undoes"}
_ENDS = frozenset(("Completed", "Failed", "Stopped", "Compensated", "Stranded"))
SIGNS = {"Completed": "✔", "Failed": "✘", "Stopped": "■", "Compensated": "↶", "Stranded": "!", "lost": "?"}
"""A sign for each ending of a bar; colour is never the only sign."""

_WIDEST_TEXT, _WIDEST_CHART, _LEAST_CHART = 34, 64, 24
"""Widths of columns in the terminal, in characters. A text that is longer ends in an ellipsis."""

_COLOURS = {"does": "#2c5d8f", "undoes": "#8a5a00", "lost": "#b3261e"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """Work of a device between two times, in seconds since 1970. `ending`: the type of the final message, or `lost` if there was none."""

    device: str
    label: str
    kind: str
    start: float
    end: float
    ending: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """An event that concerns a component of the system, or the task."""

    at: float
    subject: str
    text: str


def bars(lines: Sequence[Line]) -> list[Bar]:
    """The work that appears in the messages. Work without a final message is lost, and ends at the participant's last message."""
    service_types = {_service_type(line) for line in lines if line.type in _BEGINS}
    last_times = {(line.transaction, line.participant): line.at for line in lines if line.type != "End"}
    bars_by_work: dict[tuple[str, str, str], Bar] = {}
    for line in lines:
        participant = line.transaction, line.participant
        if line.type in _BEGINS:
            device, _, _ = line.recipient.partition(".")
            label = _label(line, named=len(service_types) > 1)
            kind = _BEGINS[line.type]
            if (*participant, kind) not in bars_by_work:
                bars_by_work[*participant, kind] = Bar(
                    device=device, label=label, kind=kind, start=line.at, end=last_times[participant], ending="lost"
                )
        elif line.type in _ENDS:
            kind = "undoes" if line.type in ("Compensated", "Stranded") else "does"
            bar = bars_by_work.get((*participant, kind))
            if bar is not None and bar.ending == "lost":
                bars_by_work[*participant, kind] = Bar(
                    device=bar.device, label=bar.label, kind=kind, start=bar.start, end=line.at, ending=line.type
                )
    return [*bars_by_work.values()]


def _service_type(line: Line) -> str:
    return line.recipient.partition(".")[2]


def _label(line: Line, *, named: bool) -> str:
    """What the work is about: its first input, or what it restores. `named`: after its service type."""
    inputs = [str(value) for value in line.body.get("inputs", {}).values()]
    subject = inputs[0] if inputs else str(line.body.get("situation", "")).partition(" ")[0]
    return f"{_service_type(line)} {subject}".strip() if named or not subject else subject


def timeline_table(bars: Sequence[Bar], marks: Sequence[Mark], room: int) -> Table:
    """The timeline for a terminal with `room` characters in a line: a row for each bar and each mark, in order of time."""
    start, end = _limits(bars, marks)
    entries: list[tuple[float, str, str, Bar | Mark]] = [(bar.start, bar.device, f"{bar.kind}: {bar.label}", bar) for bar in bars]
    entries += [(mark.at, mark.subject, mark.text, mark) for mark in marks]
    entries.sort(key=lambda entry: entry[0])
    who = max((len(subject) for _, subject, _, _ in entries), default=0)
    room -= who + 3 * 2 + 2  # the paddings, and the sign beside the last bar
    what = min(max((len(text) for _, _, text, _ in entries), default=0), _WIDEST_TEXT, max(room - _LEAST_CHART, 0))
    width = min(max(room - what, _LEAST_CHART), _WIDEST_CHART)
    scale = width / max(end - start, 1e-9)
    table = Table(title="Timeline", title_justify="left", title_style="bold", box=None, padding=(0, 1))
    table.add_column("who", style="bold", no_wrap=True)
    table.add_column("what", overflow="ellipsis", no_wrap=True, max_width=max(what, 4))
    table.add_column(f"0 s{'':>{max(width - 12, 1)}}{end - start:6.1f} s", no_wrap=True)
    for _, subject, text, entry in entries:
        table.add_row(subject, text, _chart_line(entry, start, scale, width))
    table.caption = "  ".join(f"{sign} {ending}" for ending, sign in SIGNS.items())
    return table


def _chart_line(entry: Bar | Mark, start: float, scale: float, width: int) -> Text:
    if isinstance(entry, Mark):
        return Text(" " * int((entry.at - start) * scale)) + Text("◆", style="bold red")
    begin = int((entry.start - start) * scale)
    length = max(1, round((entry.end - entry.start) * scale))
    fill = {"does": "█", "undoes": "▒"}[entry.kind] if entry.ending != "lost" else "░"
    colour = _COLOURS["lost" if entry.ending in ("lost", "Failed", "Stranded") else entry.kind]
    return Text(" " * begin) + Text(fill * min(length, width - begin), style=colour) + Text(f" {SIGNS[entry.ending]}")


_LEFT_MARGIN, _TOP_MARGIN, _LANE, _CHART_WIDTH, _RIGHT_MARGIN = 130, 70, 44, 1100, 140
LETTER = 7.2
"""Maximum width of a letter, in pixels."""
_STYLE = """
  .timeline { font-family: system-ui, sans-serif; font-size: 12px; fill: #1c2733 }
  .lane { stroke: #e1e7ee }
  .who { font-weight: 600; text-anchor: end }
  .mark { stroke: #b3261e; stroke-dasharray: 3 3 }
  .told { fill: #b3261e }
  .told, .beside { stroke: #ffffff; stroke-width: 4px; paint-order: stroke }
  .inside { fill: #ffffff; font-size: 11px }
"""


def svg(bars: Sequence[Bar], marks: Sequence[Mark], title: str) -> str:
    """The timeline as an SVG document: a lane with bars for each device, and a vertical line for each mark."""
    start, end = _limits(bars, marks)
    scale = _CHART_WIDTH / max(end - start, 1e-9)
    lanes = _lanes(bars)
    names = list(dict.fromkeys(device for device, _ in lanes.values()))
    rows = {(device, row) for device, row in lanes.values()}
    place = {key: _TOP_MARGIN + _LANE * index for index, key in enumerate(sorted(rows, key=lambda key: (names.index(key[0]), key[1])))}
    bottom = _TOP_MARGIN + _LANE * len(place)
    height = bottom + 24 * len(marks) + 30
    elements = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="timeline" viewBox="0 0 {_LEFT_MARGIN + _CHART_WIDTH + _RIGHT_MARGIN} {height}" '
        f'width="{_LEFT_MARGIN + _CHART_WIDTH + _RIGHT_MARGIN}" height="{height}">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        f'<rect width="{_LEFT_MARGIN + _CHART_WIDTH + _RIGHT_MARGIN}" height="{height}" fill="#ffffff"/>',
        f'<text x="20" y="28" font-size="16" font-weight="600">{escape(title)}</text>',
    ]
    for number, (kind, colour) in enumerate(_COLOURS.items()):
        legend_x = _LEFT_MARGIN + _CHART_WIDTH - 90 * (len(_COLOURS) - number)
        elements.append(
            f'<rect x="{legend_x}" y="17" width="12" height="12" rx="3" fill="{colour}"/><text x="{legend_x + 18}" y="28">{kind}</text>'
        )
    for seconds in _ticks(end - start):
        x = _LEFT_MARGIN + seconds * scale
        elements.append(f'<line class="lane" x1="{x:.1f}" y1="{_TOP_MARGIN - 14}" x2="{x:.1f}" y2="{bottom}"/>')
        elements.append(f'<text x="{x:.1f}" y="{_TOP_MARGIN - 20}" text-anchor="middle">{seconds:g} s</text>')
    for (device, row), y in place.items():
        if row == 0:
            elements.append(f'<text class="who" x="{_LEFT_MARGIN - 12}" y="{y + 20}">{escape(device)}</text>')
    texts: list[str] = []
    """Texts are drawn last, so that no line crosses them."""
    for bar in bars:
        y = place[lanes[bar]]
        x, wide = _LEFT_MARGIN + (bar.start - start) * scale, max(3.0, (bar.end - bar.start) * scale)
        colour = _COLOURS["lost" if bar.ending in ("lost", "Failed", "Stranded") else bar.kind]
        opacity = ' fill-opacity="0.35"' if bar.ending == "lost" else ""
        elements.append(f'<rect x="{x:.1f}" y="{y + 4}" width="{wide:.1f}" height="24" rx="4" fill="{colour}"{opacity}/>')
        label = f"{SIGNS[bar.ending]} {bar.label}"
        next_start = min(
            (other_bar.start for other_bar in bars if lanes[other_bar] == lanes[bar] and other_bar.start >= bar.end),
            default=end + _RIGHT_MARGIN / scale,
        )
        if (next_start - bar.end) * scale > LETTER * len(label) and (bar.ending == "lost" or wide <= LETTER * len(label)):
            texts.append(f'<text class="beside" x="{x + wide + 5:.1f}" y="{y + 20}">{escape(label)}</text>')
        else:
            fits = label if wide > LETTER * len(label) else SIGNS[bar.ending]
            texts.append(f'<text class="inside" x="{x + 6:.1f}" y="{y + 20}">{escape(fits)}</text>')
    for number, mark in enumerate(sorted(marks, key=lambda mark: mark.at)):
        x, y = _LEFT_MARGIN + (mark.at - start) * scale, bottom + 16 + 24 * number
        elements.append(f'<line class="mark" x1="{x:.1f}" y1="{_TOP_MARGIN - 14}" x2="{x:.1f}" y2="{y}"/>')
        late = x > _LEFT_MARGIN + _CHART_WIDTH * 0.7
        anchor = ' text-anchor="end"' if late else ""
        texts.append(
            f'<text class="told"{anchor} x="{x + (-6 if late else 6):.1f}" y="{y}">{escape(f"{mark.subject}: {mark.text}")}</text>'
        )
    return "\n".join([*elements, *texts, "</svg>"]) + "\n"


def _limits(bars: Sequence[Bar], marks: Sequence[Mark]) -> tuple[float, float]:
    times = [bar.start for bar in bars] + [bar.end for bar in bars] + [mark.at for mark in marks]
    return (min(times), max(times)) if times else (0.0, 1.0)


def _lanes(bars: Sequence[Bar]) -> dict[Bar, tuple[str, int]]:
    """For each bar its device and its row among the device's rows, such that bars in a row do not overlap."""
    end_times: dict[str, list[float]] = {}
    lanes: dict[Bar, tuple[str, int]] = {}
    for bar in sorted(bars, key=lambda bar: bar.start):
        rows = end_times.setdefault(bar.device, [])
        row = next((index for index, end_time in enumerate(rows) if end_time <= bar.start), len(rows))
        rows[row:] = [bar.end, *rows[row + 1 :]]
        lanes[bar] = (bar.device, row)
    return lanes


def _ticks(seconds: float) -> Iterable[float]:
    step = next((step for step in (1, 2, 5, 10, 20, 60, 120, 300) if seconds / step <= 12), 600)
    return (float(step * number) for number in range(int(seconds / step) + 1))
