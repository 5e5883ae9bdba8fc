"""Who was asked for each step of a task, what they wanted, who got it, and why: a table that grows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nicegui import ui

from somrs.app.gui.panel import Panel
from somrs.app.gui.signs import Sign, clock, lasted
from somrs.protocol.clients import ContractView
from somrs.protocol.frp import State

WORDS = {
    State.COMMITTED: Sign("handshake", "Chosen", "good"),
    State.EXECUTING: Sign("play_circle", "Chosen, at work", "busy"),
    State.COMPLETED: Sign("check_circle", "Chosen, done", "good"),
    State.FAILED: Sign("cancel", "Chosen, failed", "bad"),
    State.STOPPING: Sign("stop_circle", "Chosen, stopping", "busy"),
    State.STOPPED: Sign("stop_circle", "Chosen, stopped", "plain"),
    State.COMPENSATING: Sign("undo", "Chosen, undoing", "busy"),
    State.COMPENSATED: Sign("undo", "Chosen, undone", "plain"),
    State.STRANDED: Sign("error", "Chosen, not undone", "bad"),
    State.UNREACHABLE: Sign("help", "Chosen, fell silent", "bad"),
}
"""Of those whose terms were accepted."""

ASKED = Sign("more_horiz", "Asked", "busy")
OFFERS = Sign("sell", "Offers", "busy")
LOST = Sign("remove_circle_outline", "Not chosen", "plain")
SILENT = Sign("help", "Did not answer", "bad")
REFUSED = Sign("block", "Refused", "bad")
LET_GO = Sign("logout", "Let go", "plain")

CHOSEN = "another service was chosen"
NO_ANSWER = ("did not answer", "no answer in time")


def verdict(contract: ContractView) -> Sign:
    """What became of a bid."""
    if contract.accepted:
        return WORDS.get(contract.state, LET_GO)
    match contract.state:
        case State.NEW | State.ARRANGING:
            return ASKED
        case State.OFFERED:
            return OFFERS
    if contract.reason.startswith(NO_ANSWER):
        return SILENT
    if contract.reason.startswith(CHOSEN):
        return LOST
    return LET_GO if contract.price is not None else REFUSED


def why(contract: ContractView) -> str:
    return contract.reason if contract.reason and contract.reason != "ended" else ""


@dataclass(slots=True)
class _Row:
    contract: ContractView
    element: ui.element


class Terms:
    """In `panel`, beside whose title stands how many were asked."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._rows: dict[str, _Row] = {}
        self._steps: dict[str, ui.element] = {}
        self._start = 0.0
        self._none = ui.label("Nobody was asked for terms.").classes("somrs-soft")
        with ui.element("div").classes("somrs-terms-view"):
            self._table = ui.element("table").classes("somrs-terms")
        with self._table, ui.element("thead"), ui.element("tr"):
            for name in ("Service", "Price", "Takes", "From – until", "Valid until"):
                with ui.element("th").props('scope="col"'):
                    ui.label(name)
        self._table.visible = False

    def show(self, contracts: Sequence[ContractView], start: float) -> None:
        self._start = start
        for contract in contracts:
            row = self._rows.get(contract.participant)
            if row is not None and row.contract == contract:
                continue
            if row is None:
                with self._step(contract.step):
                    row = self._rows[contract.participant] = _Row(contract, ui.element("tr"))
            row.contract = contract
            row.element.clear()
            self._fill(row)
        chosen = sum(row.contract.accepted for row in self._rows.values())
        self._none.visible = not self._rows
        self._table.visible = bool(self._rows)
        self._panel.note.set_text(f"{len(self._rows)} asked, {chosen} chosen" if self._rows else "")

    def _step(self, step: str) -> ui.element:
        """The rows of a step, below its name."""
        if step not in self._steps:
            with self._table:
                self._steps[step] = ui.element("tbody")
            with self._steps[step], ui.element("tr").classes("somrs-terms-step"), ui.element("th").props('colspan="5" scope="rowgroup"'):
                ui.label(step)
        return self._steps[step]

    def _fill(self, row: _Row) -> None:
        contract, found = row.contract, verdict(row.contract)
        row.element.classes(replace=f"somrs-terms-row somrs-tone-{found.tone}{' somrs-terms-chosen' if contract.accepted else ''}")
        with row.element:
            with ui.element("th").props('scope="row"'), ui.element("div").classes("somrs-terms-who"):
                ui.icon(found.icon).props('aria-hidden="true"')
                with ui.element("div"):
                    ui.label(contract.service).classes("somrs-terms-service")
                    ui.label(found.text).classes("somrs-terms-word")
                    if reason := why(contract):
                        ui.label(reason).classes("somrs-soft")
            _cell(f"{contract.price:g} {contract.currency}" if contract.price is not None else "–")
            _cell(lasted(contract.duration) if contract.duration is not None else "–")
            _cell(self._window(contract))
            _cell(clock(contract.valid_until) if contract.valid_until is not None else "–")

    def _window(self, contract: ContractView) -> str:
        if contract.start is None or contract.finish is None:
            return "–"
        return f"+{lasted(max(0.0, contract.start - self._start))} – +{lasted(max(0.0, contract.finish - self._start))}"


def _cell(text: str) -> None:
    with ui.element("td"):
        ui.label(text)
