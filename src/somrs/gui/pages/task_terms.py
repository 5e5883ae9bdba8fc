"""Who was asked for each step of a task, what they wanted, who got it, and why: a table that grows."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from somrs.gui.components.task.terms import Bid, TermsTable
from somrs.gui.icons import Sign, clock, lasted
from somrs.gui.panel import Panel
from somrs.protocol.messages.clients import ContractView
from somrs.protocol.messages.frp import State

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

NONE = "–"


def verdict(contract: ContractView, chosen: Collection[str]) -> Sign:
    """What became of a bid. `chosen`: the steps for which terms were accepted."""
    if contract.accepted:
        return WORDS.get(contract.state, LET_GO)
    match contract.state:
        case State.NEW | State.ARRANGING:
            return ASKED
        case State.OFFERED:
            return OFFERS
    if contract.refused:
        return REFUSED
    if contract.price is None:
        return LET_GO if contract.refused is None else SILENT
    return LOST if contract.step in chosen else LET_GO


def why(contract: ContractView) -> str:
    return contract.reason if contract.reason and contract.reason != "ended" else ""


class Terms:
    """In `panel`, beside whose title stands how many were asked."""

    def __init__(self, panel: Panel) -> None:
        self._panel = panel
        self._table = TermsTable()

    def show(self, contracts: Sequence[ContractView], start: float) -> None:
        accepted = [contract.step for contract in contracts if contract.accepted]
        self._panel.note.set_text(f"{len(contracts)} asked, {len(accepted)} chosen" if contracts else "")
        self._table.show([_bid(contract, accepted, start) for contract in contracts])


def _bid(contract: ContractView, chosen: Collection[str], start: float) -> Bid:
    found = verdict(contract, chosen)
    return Bid(
        key=contract.participant,
        step=contract.step,
        service=contract.service,
        chosen=contract.accepted,
        icon=found.icon,
        tone=found.tone,
        word=found.text,
        why=why(contract),
        price=f"{contract.price:g} {contract.currency}" if contract.price is not None else NONE,
        takes=lasted(contract.duration) if contract.duration is not None else NONE,
        window=_window(contract, start),
        valid=clock(contract.valid_until) if contract.valid_until is not None else NONE,
    )


def _window(contract: ContractView, start: float) -> str:
    if contract.start is None or contract.finish is None:
        return NONE
    return f"+{lasted(max(0.0, contract.start - start))} – +{lasted(max(0.0, contract.finish - start))}"
