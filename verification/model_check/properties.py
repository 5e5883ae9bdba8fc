"""What must hold, named as in the protocol's design, and how a state of one participant's part can break it.

Property 1 takes two participants and is `pair.py`'s; 3 and 7 are about all states together and are `explore.py`'s. Property 5, that
the map tells the truth, is about the Task Manager's data and is tested with faults in running systems, not here.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum

from somrs.protocol.frp import states
from somrs.protocol.messages.frp import Accept, State
from verification.model_check.coordinator import NEEDS_COMPENSATION, Coordinator, Phase
from verification.model_check.participant import Participant, WorkState


class Property(StrEnum):
    """In the order in which they are printed."""

    FITS = "no invalid state"
    MUTUAL_EXCLUSION = "1 no double hands"
    CONTRACT = "2 no work without a contract"
    HOME = "3 everyone goes home"
    HALF_DONE = "4 nothing half-done in silence"
    ORPHAN = "6 no orphan"
    RESTART = "7 restart changes nothing"


BrokenProperty = tuple[Property, str]

REPORTS = frozenset((State.COMPLETED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED))
"""The coordinator's states that stand for a report, by the same name, that its participant has made."""

Outcome = tuple[Phase, WorkState, State | None]
"""How the transaction ended for one participant: the outcome, what was really done, and what the coordinator last knew of it."""


def broken_properties(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    """What is wrong with the two states together. A side that lost its disk is not held to what it no longer knows."""
    believed, real = coordinator.session.state, participant.session.state
    if coordinator.phase is Phase.LOST:
        return
    if not participant.forgot:
        yield from _fits(coordinator, participant)
        yield from _contract(coordinator, participant)
    if coordinator.phase is Phase.BROKEN and not _is_client_told(coordinator, participant):
        yield Property.HALF_DONE, f"the work was {participant.work_state.value}, and the coordinator last knew {coordinator.last_state}"
    if coordinator.phase in (Phase.ACCOMPLISHED, Phase.BROKEN) and believed not in (State.NEW, State.ENDED):
        yield Property.ORPHAN, f"the transaction is over, and {believed} was not told so"
    dismissed = {"End", "Cancel"} & coordinator.session.sent_messages.keys()
    if believed is State.ENDED and participant.committed and not dismissed:
        yield Property.ORPHAN, f"the coordinator is done with a committed participant that is {real}, and told it nothing"


def _fits(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    if coordinator.abandoned:
        return  # nothing is believed of it
    believed = coordinator.session.state
    known_state = coordinator.last_state if believed is State.ENDED else believed
    if known_state in REPORTS and known_state.value not in participant.session.sent_messages:
        yield Property.FITS, f"the coordinator holds it for {known_state}, and it never said so"
    if participant.moving and believed not in states.HOLDING_STATES:
        yield Property.FITS, f"its device moves, and the coordinator holds it for {believed}"


def _contract(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    sent_messages, session = coordinator.session.sent_messages, participant.session
    accept, terms = sent_messages.get("Accept"), session.sent_messages.get("Terms")
    agreed = accept is not None and terms is not None and isinstance(accept.body, Accept) and accept.body.terms == terms.id
    if participant.work_state is not WorkState.NOT_STARTED and not (agreed and "Execute" in sent_messages):
        yield Property.CONTRACT, "it began without terms that were accepted, or without an Execute"
    if participant.work_state is not WorkState.NOT_STARTED and "Refuse" in session.sent_messages:
        yield Property.CONTRACT, "it began on terms that had expired"
    if session.state is State.COMPENSATING and "Compensate" not in sent_messages:
        yield Property.CONTRACT, "it undoes what nobody asked it to undo"


def _is_client_told(coordinator: Coordinator, participant: Participant) -> bool:
    """Whether the client is told how the work was left."""
    last_state = coordinator.last_state
    if participant.work_state is WorkState.NOT_STARTED or coordinator.abandoned or last_state is State.STRANDED:
        return True
    if last_state is State.COMPENSATED:
        return participant.work_state is WorkState.UNDONE or participant.forgot
    return coordinator.overdue and last_state in NEEDS_COMPENSATION


def at_home(coordinator: Coordinator, participant: Participant) -> bool:
    """Whether the transaction is over for both, and the device at rest."""
    real = participant.session.state
    if coordinator.phase in (Phase.OPEN, Phase.STOPPING) or coordinator.session.state not in (State.NEW, State.ENDED) or participant.moving:
        return False
    # Nobody may be left who would say End to one whose report was heard, or who had a contract with one that forgot it.
    has_reported = coordinator.last_state in REPORTS | {State.ENDED} or (
        coordinator.last_state is State.COMPENSATING and real in NEEDS_COMPENSATION
    )
    if coordinator.phase is Phase.LOST or participant.forgot:
        return real in (State.NEW, State.ENDED) or (real in REPORTS and (has_reported or participant.forgot))
    return real is State.ENDED or (real is State.NEW and coordinator.session.state is State.NEW)


def outcome(coordinator: Coordinator, participant: Participant) -> Outcome:
    return coordinator.phase, participant.work_state, coordinator.last_state
