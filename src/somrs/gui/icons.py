"""Small shared elements: status badges, gauges, and formats for times and durations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from nicegui import ui

from somrs.client import state_labels
from somrs.protocol.messages.frp import Outcome


@dataclass(frozen=True, slots=True)
class Sign:
    """`tone`: good, bad, busy or plain. Icon and text convey the status without colour."""

    icon: str
    text: str
    tone: str


OUTCOMES = {
    Outcome.ACCOMPLISHED: Sign("check_circle", state_labels.OUTCOMES[Outcome.ACCOMPLISHED], "good"),
    Outcome.FAILED: Sign("cancel", state_labels.OUTCOMES[Outcome.FAILED], "bad"),
    Outcome.CANCELLED: Sign("stop_circle", state_labels.OUTCOMES[Outcome.CANCELLED], "plain"),
}


class Badge:
    """A status badge that can be updated."""

    def __init__(self, sign: Sign) -> None:
        with ui.element("span") as self.element:
            self._icon = ui.icon(sign.icon).props('aria-hidden="true"')
            self._text = ui.label(sign.text)
        self._sign: Sign | None = None
        self.show_sign(sign)

    def show_sign(self, sign: Sign) -> None:
        if sign != self._sign:
            self._sign = sign
            self._icon.name = sign.icon
            self._text.set_text(sign.text)
            self.element.classes(replace=f"somrs-badge somrs-{sign.tone}")


class Gauge:
    """A horizontal bar from 0 to 100 %, with a label before and a value after it."""

    def __init__(self, label: str, tip: str) -> None:
        with ui.element("div").classes("somrs-gauge") as self.element:
            ui.label(label).classes("somrs-soft")
            with ui.element("div").classes("somrs-gauge-track").props(f'role="progressbar" aria-label="{label}"') as self._track:
                self._fill = ui.element("div").classes("somrs-gauge-fill")
            self._text = ui.label().classes("somrs-gauge-text")
            ui.tooltip(tip)
        self._shown_content: tuple[float, str] | None = None

    def show_share(self, share: float, text: str, tone: str = "accent") -> None:
        percent = round(100 * min(max(share, 0.0), 1.0))
        if (percent, text + tone) != self._shown_content:
            self._shown_content = percent, text + tone
            self._track.props(f'aria-valuenow="{percent}" aria-valuemin="0" aria-valuemax="100"')
            self._fill.style(f"width: {percent}%; background: var(--{tone})")
            self._text.set_text(text)


def format_time(timestamp: float) -> str:
    """Format a local time; the date is included unless it is today."""
    moment = datetime.fromtimestamp(timestamp)
    return f"{moment:%H:%M:%S}" if moment.date() == datetime.now().date() else f"{moment:%Y-%m-%d %H:%M}"


def join_names(names: Sequence[str]) -> str:
    """`A, B and C`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
