"""The services asked for each step of a task, with their terms and the result."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from somrs.client.durations import format_duration
from somrs.gui.components.task.terms import Bid, TermsTable
from somrs.gui.icons import Sign, format_time
from somrs.gui.panel import Panel
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import ContractView

CONTRACT_SIGNS = {
    State.COMMITTED: Sign("handshake", "Chosen", "good"),
    State.EXECUTING: Sign("play_circle", "Chosen, at work", "busy"),
    State.COMPLETED: Sign("check_circle", "Chosen, done", "good"),
    State.FAILED: Sign("cancel", "Chosen, failed", "bad"),
    State.STOPPING: Sign("stop_circle", "Chosen, stopping", "busy"),
    State.STOPPED: Sign("stop_circle", "Chosen, stopped", "plain"),
    State.COMPENSATING: Sign("undo", "Chosen, undoing", "busy"),
    State.COMPENSATED: Sign("undo", "Chosen, undone", "plain"),
    State.STRANDED: Sign("error", "Chosen, not undone", "bad"),
    State.UNREACHABLE: Sign("help", "Chosen, stopped responding", "bad"),
}
"""Status of services whose terms were accepted."""

_REQUESTED = Sign("more_horiz", "Asked", "busy")
_OFFERS = Sign("sell", "Offers", "busy")
_LOST = Sign("remove_circle_outline", "Not chosen", "plain")
_SILENT = Sign("help", "Did not answer", "bad")
_REFUSED = Sign("block", "Refused", "bad")
_REFUSED_NOW = Sign("schedule", "Refused for now", "plain")
_RELEASED = Sign("logout", "Released", "plain")

_DASH = "–"


def bid_status(contract: ContractView, chosen: Collection[str]) -> Sign:
    """The status of a bid. `chosen`: the steps for which terms were accepted."""
    if contract.accepted:
        return CONTRACT_SIGNS.get(contract.state, _RELEASED)
    match contract.state:
        case State.NEW | State.ARRANGING:
            return _REQUESTED
        case State.OFFERED:
            return _OFFERS
    if contract.refused:
        return _REFUSED_NOW if contract.not_now else _REFUSED
    if contract.price is None:
        return _RELEASED if contract.refused is None else _SILENT
    return _LOST if contract.step in chosen else _RELEASED


def _reason_text(contract: ContractView) -> str:
    condition = f"only if {contract.condition}" if contract.condition is not None else ""
    return "; ".join(text for text in (condition, contract.reason if contract.reason != "ended" else "") if text)


class BidPanel:
    """Contents of `panel`; the panel's note shows the number of services asked."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._table = TermsTable()

    def render(self, contracts: Sequence[ContractView], start: float) -> None:
        accepted = [contract.step for contract in contracts if contract.accepted]
        self._panel.note.set_text(f"{len(contracts)} asked, {len(accepted)} chosen" if contracts else "")
        self._table.show_rows([_bid(contract, accepted, start) for contract in contracts])


def _price(contract: ContractView) -> str:
    if contract.price is None:
        return _DASH
    penalty = f" (undoing {contract.penalty:g})" if contract.penalty is not None else ""
    return f"{contract.price:g} {contract.currency}{penalty}"


def _bid(contract: ContractView, chosen: Collection[str], start: float) -> Bid:
    status = bid_status(contract, chosen)
    return Bid(
        key=contract.participant,
        step=contract.step,
        service=contract.service,
        chosen=contract.accepted,
        icon=status.icon,
        tone=status.tone,
        word=status.text,
        why=_reason_text(contract),
        price=_price(contract),
        takes=format_duration(contract.duration) if contract.duration is not None else _DASH,
        window=_window(contract, start),
        valid=format_time(contract.valid_until) if contract.valid_until is not None else _DASH,
    )


def _window(contract: ContractView, start: float) -> str:
    if contract.start is None or contract.finish is None:
        return _DASH
    return f"+{format_duration(max(0.0, contract.start - start))} – +{format_duration(max(0.0, contract.finish - start))}"
