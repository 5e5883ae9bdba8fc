"""The properties of the protocol, numbered as in its design, and their check in one state of one participant's part.

`pair.py` checks property 1, which takes two participants. `explore.py` and `suite.py` check 3 and 7, which concern all states together.
Property 5, map correctness, concerns the Task Manager's data; the fault runs check it.
"""

from __future__ import annotations

from collections.abc import Iterator

from somrs.protocol.frp import states
from somrs.protocol.messages.frp import Accept, Execute, State
from verification.model_check.coordinator import NEEDS_COMPENSATION, Coordinator, Phase
from verification.model_check.participant import Participant, WorkState
from verification.model_check.property import Property
from verification.model_check.step import DOOR_OPEN, StepKind, is_conditional

BrokenProperty = tuple[Property, str]

REPORTS = frozenset((State.COMPLETED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED))
"""The coordinator's states that stand for a report of the same name by the participant."""

Outcome = tuple[Phase, WorkState, State | None]
"""The end of a transaction for one participant: the outcome, the work really done, and the coordinator's last state of it."""


def broken_properties(kind: StepKind, coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    """Yield the properties that the two states together violate. A side that lost its disk is not bound by what it has lost."""
    believed, real = coordinator.session.state, participant.session.state
    if coordinator.phase is Phase.LOST:
        return
    if not participant.forgot:
        yield from _fits(coordinator, participant)
        yield from _contract(coordinator, participant)
    yield from _depends_on_the_door(kind, coordinator, participant)
    yield from _recognition(coordinator, participant)
    if coordinator.phase is Phase.BROKEN and not _is_client_told(coordinator, participant):
        yield Property.PARTIAL_RESULT, f"the work was {participant.work_state.value}; the coordinator last knew {coordinator.last_state}"
    if coordinator.phase in (Phase.ACCOMPLISHED, Phase.BROKEN) and believed not in (State.NEW, State.ENDED):
        yield Property.ORPHAN, f"the transaction has ended, and the participant in {believed} got no message about it"
    dismissed = {"End", "Cancel"} & coordinator.session.sent_messages.keys()
    if believed is State.ENDED and participant.committed and not dismissed:
        yield Property.ORPHAN, f"the coordinator has ended a committed participant that is {real}, without a message to it"


def _fits(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    if coordinator.abandoned:
        return  # the coordinator assumes nothing about a participant that it gave up
    believed = coordinator.session.state
    known_state = coordinator.last_state if believed is State.ENDED else believed
    if known_state in REPORTS and known_state.value not in participant.session.sent_messages:
        yield Property.VALID_STATE, f"the coordinator assumes {known_state}, which the participant never reported"
    if participant.moving and believed not in states.HOLDING_STATES:
        yield Property.VALID_STATE, f"the device moves, and the coordinator assumes {believed}"


def _contract(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    sent_messages, session = coordinator.session.sent_messages, participant.session
    accept, terms = sent_messages.get("Accept"), session.sent_messages.get("Terms")
    agreed = accept is not None and terms is not None and isinstance(accept.body, Accept) and accept.body.terms == terms.id
    if participant.work_state is not WorkState.NOT_STARTED and not (agreed and "Execute" in sent_messages):
        yield Property.CONTRACT, "it began without accepted terms, or without an Execute"
    if participant.work_state is not WorkState.NOT_STARTED and "Refuse" in session.sent_messages:
        yield Property.CONTRACT, "it began on terms that had expired"
    if session.state is State.COMPENSATING and "Compensate" not in sent_messages:
        yield Property.CONTRACT, "it compensates without a Compensate"


def _depends_on_the_door(kind: StepKind, coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    if kind is StepKind.WHILE and works_behind_a_shut_door(coordinator, participant) and coordinator.session.state is State.EXECUTING:
        yield Property.INVARIANT, "the service is not told to stop, although what has to hold meanwhile does not hold any more"
    execute = participant.session.received_messages.get("Execute")
    if (
        participant.work_state is not WorkState.NOT_STARTED
        and is_conditional(participant.session.terms)
        and not (execute is not None and isinstance(execute.body, Execute) and execute.body.precondition == DOOR_OPEN)
    ):
        yield Property.CONDITION, "it began on an order that does not say that its condition holds"


def works_behind_a_shut_door(coordinator: Coordinator, participant: Participant) -> bool:
    """Whether the device works on a step that needs an open door, and the door is shut by the map of a task that goes on."""
    return participant.moving and coordinator.is_open is False and coordinator.phase is Phase.OPEN


def _recognition(coordinator: Coordinator, participant: Participant) -> Iterator[BrokenProperty]:
    if participant.work_state is WorkState.LOOKED and "Compensate" in coordinator.session.sent_messages:
        yield Property.RECOGNITION, "it is told to undo what changed nothing"
    if coordinator.phase is Phase.ACCOMPLISHED and coordinator.reporting:
        yield Property.RECOGNITION, "the task goes on, and the map does not have what was recognised"


def _is_client_told(coordinator: Coordinator, participant: Participant) -> bool:
    """Whether the client learns in which state the work was left."""
    last_state = coordinator.last_state
    if participant.work_state in (WorkState.NOT_STARTED, WorkState.LOOKED) or coordinator.abandoned or last_state is State.STRANDED:
        return True
    if last_state is State.COMPENSATED:
        return participant.work_state is WorkState.UNDONE or participant.forgot
    return coordinator.overdue and last_state in NEEDS_COMPENSATION


def has_ended(coordinator: Coordinator, participant: Participant) -> bool:
    """Whether the transaction has ended for both sides, and the device is at rest."""
    real = participant.session.state
    if coordinator.phase in (Phase.OPEN, Phase.STOPPING) or coordinator.session.state not in (State.NEW, State.ENDED) or participant.moving:
        return False
    # After the loss of a disk, a participant that has reported may be left without an End: no coordinator has a record of it.
    has_reported = coordinator.last_state in REPORTS | {State.ENDED} or (
        coordinator.last_state is State.COMPENSATING and real in NEEDS_COMPENSATION
    )
    if coordinator.phase is Phase.LOST or participant.forgot:
        return real in (State.NEW, State.ENDED) or (real in REPORTS and (has_reported or participant.forgot))
    return real is State.ENDED or (real is State.NEW and coordinator.session.state is State.NEW)


def outcome(coordinator: Coordinator, participant: Participant) -> Outcome:
    return coordinator.phase, participant.work_state, coordinator.last_state
