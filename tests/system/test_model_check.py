"""The model check itself: the protocol holds on small configurations, and tables that are wrong are found out."""

from __future__ import annotations

import pickle
from typing import Any

import pytest
from msgspec import structs

from somrs.kernel.reservations import Reservations
from somrs.protocol.frp import coordinator_session, participant_session, states
from somrs.protocol.frp.session import ParticipantBody
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import Cancel, End, Fault, State, Stop
from somrs.protocol.messages.reservations import Claim
from somrs.task_manager.reservations import TaskReservation
from verification.model_check import participant, reservation_rules
from verification.model_check.coordinator import Coordinators
from verification.model_check.explore import explore
from verification.model_check.media import DUPLICATING, EMPTY, FIFO, LOSSY_FIFO, MEDIA, OUTBOX, UNORDERED, Medium
from verification.model_check.mutations import TRIALS, Mutation, all_mutations, altered, find_violation
from verification.model_check.pair import explore_pair
from verification.model_check.participant import WorkState
from verification.model_check.property import Property
from verification.model_check.quotient import Quotient, quotient
from verification.model_check.reservation_check import check_reservations
from verification.model_check.reservation_model import ReservationModel
from verification.model_check.rules import RULES
from verification.model_check.shared_reservation_model import SharedReservationModel
from verification.model_check.step import Step, StepKind, is_conditional
from verification.model_check.suite import (
    KIND_PROPERTIES,
    KINDS,
    check_assumption,
    check_kind,
    check_kind_with_two,
    check_lost_disk,
    check_one,
    check_two,
)
from verification.model_check.system import Link, LostDisk, Model


def _fallen(cells: dict[Property, object]) -> list[Property]:
    return [checked_property for checked_property, broken in cells.items() if broken is not None]


@pytest.mark.parametrize("medium", [OUTBOX if medium is LOSSY_FIFO else medium for medium in MEDIA], ids=str)
def test_one_participant(medium: Medium) -> None:
    result = check_one(medium)
    assert _fallen({**result.cells}) == []
    assert result.states > 1000, "restarts, timers and crossings were explored"


def test_two_participants() -> None:
    assert _fallen({**check_two(DUPLICATING).cells}) == []


@pytest.mark.parametrize("disk_owner", [LostDisk.COORDINATOR, LostDisk.PARTICIPANT])
def test_check_termination_when_a_disk_is_lost(disk_owner: LostDisk) -> None:
    assert _fallen({**check_lost_disk(FIFO, disk_owner).cells}) == []


@pytest.mark.parametrize("kind", [*KINDS], ids=str)
def test_a_step_that_depends_on_more_than_the_protocol(kind: StepKind) -> None:
    result = check_kind(kind, FIFO)
    assert _fallen({**result.cells}) == []
    assert result.cells.keys() >= {*KIND_PROPERTIES[kind]}
    assert result.states > 1000


@pytest.mark.parametrize("kind", [StepKind.NOT_NOW, StepKind.RECOGNITION], ids=str)
def test_two_participants_of_a_step_that_depends_on_more(kind: StepKind) -> None:
    assert _fallen({**check_kind_with_two(kind, DUPLICATING).cells}) == []


@pytest.mark.parametrize(("cut_off", "clocks"), [(False, True), (True, False)])
def test_without_the_timing_assumption_two_work_on_one_step(cut_off: bool, clocks: bool) -> None:
    broken = check_assumption(cut_off=cut_off, clocks=clocks).cells[Property.MUTUAL_EXCLUSION]
    assert broken is not None
    chart = "\n".join(broken.chart)
    assert "gives up A [Unreachable]" in chart
    assert chart.count("Execute [Executing]") == 2, chart


WRONG = [
    Mutation("PARTICIPANT", "Committed", "Execute", "ignored"),
    Mutation("PARTICIPANT", "Executing", "Stop", "ignored"),
    Mutation("PARTICIPANT", "Offered", "Stop", "unanswered"),
    Mutation("COORDINATOR", "Executing", "Refuse", "ignored"),
    Mutation("COORDINATOR_SENDS", "Executing", "Stop", "ignored"),
    Mutation("PARTICIPANT_SENDS", "Executing", "Failed", "Ended"),
    Mutation("ABANDONED_STATES", "Stopping", "", "ignored"),
    Mutation("RESUMES", "Executing", "", "Completed"),
    Mutation("HOLDING_STATES", "Executing", "", "ignored"),
]


WRONG_RULES = {
    ("condition of a service", "always met"): Property.CONDITION,
    ("precondition of a step", "without the condition"): Property.VALID_STATE,
    ("invariant", "never broken"): Property.INVARIANT,
    ("start condition", "without the invariant"): Property.INVARIANT,
    ("refusal", "for good"): Property.REFUSAL,
    ("refusal", "for now"): Property.REFUSAL,
    ("refusal", "a condition is for good"): Property.REFUSAL,
    ("work to undo", "none"): Property.PARTIAL_RESULT,
    ("work to undo", "all"): Property.RECOGNITION,
}
"""Wrong rules of the Task Manager, by the property that they violate."""


@pytest.mark.parametrize(("rule", "change"), WRONG_RULES, ids=lambda name: name)
def test_a_wrong_rule_is_noticed(rule: str, change: str) -> None:
    mutation = Mutation("RULES", rule, "", change)
    assert mutation in all_mutations()
    single = [trial for trial in TRIALS if not trial.two_participants and trial.model.lost_disk is LostDisk.NONE]
    trials = [trial for trial in single if trial.model.kind in RULES[rule].kinds]
    assert find_violation(mutation, trials).startswith(WRONG_RULES[rule, change])


def test_a_stop_that_is_ignored_breaks_what_has_to_hold_meanwhile() -> None:
    with altered(Mutation("PARTICIPANT", "Executing", "Stop", "ignored")):
        broken = check_kind(StepKind.WHILE, FIFO).cells[Property.INVARIANT]
    assert broken is not None
    assert "the door is shut, sends Stop [Stopping]" in "\n".join(broken.chart)


def test_a_new_session_needs_ids_of_its_own() -> None:
    """With the ids of the session before, the participant takes the new Arrange for an old one, and never answers."""
    space = explore(Link(Model(medium=FIFO, kind=StepKind.NOT_NOW, reuses_ids=True)), single_participant=True)
    assert space.violations.keys() == {Property.TERMINATION}


def test_a_task_that_goes_on_before_the_map_has_what_was_recognised_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Coordinators, "waits_for_map", staticmethod(lambda coordinator: False))
    assert _fallen({**check_kind(StepKind.RECOGNITION, FIFO).cells}) == [Property.RECOGNITION]


def test_a_participant_that_hides_what_it_has_begun_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies: dict[type[object], ParticipantBody] = dict(participant.PARTICIPANT_BODIES)
    bodies[frp.Stopped] = frp.Stopped(tried=False)
    monkeypatch.setattr(participant, "PARTICIPANT_BODIES", bodies)
    assert Property.PARTIAL_RESULT in _fallen({**check_one(FIFO).cells})


@pytest.mark.parametrize("checks", [True, False])
def test_a_task_manager_that_knows_no_conditions_starts_nothing(monkeypatch: pytest.MonkeyPatch, checks: bool) -> None:
    """It accepts conditional terms like any others, and its Execute does not mention the condition. The participant objects."""
    monkeypatch.setattr(Step, "meets_condition", lambda self, session, is_open: True)
    monkeypatch.setattr(Step, "order", lambda self, session, is_open: frp.Execute(inputs={}))
    monkeypatch.setattr(coordinator_session, "unstated_condition", lambda terms, execute: None)
    if not checks:
        monkeypatch.setattr(participant_session, "unstated_condition", lambda terms, execute: None)
    link = Link(Model(medium=DUPLICATING, restarts=False, kind=StepKind.CONDITIONAL))
    explore(link, single_participant=True)
    conditional = [state for state in link.participants.states if is_conditional(state.session.terms)]
    begun = [state for state in conditional if state.work_state is not WorkState.NOT_STARTED]
    assert bool(begun) is not checks
    assert any(state.work_state is WorkState.COMPLETED for state in link.participants.states), "terms without a condition are carried out"


@pytest.mark.parametrize("mutation", WRONG, ids=str)
def test_a_wrong_table_is_noticed(mutation: Mutation) -> None:
    tables_before = repr(states.PARTICIPANT), repr(states.COORDINATOR), repr(states.RESUMES), states.HOLDING_STATES
    assert mutation in all_mutations()
    assert find_violation(mutation)
    assert tables_before == (repr(states.PARTICIPANT), repr(states.COORDINATOR), repr(states.RESUMES), states.HOLDING_STATES), (
        "the tables are as before"
    )


def test_a_stop_that_crosses_a_report_may_not_be_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flaw of WS-BusinessActivity: a message that crosses another meets a state that has no place for it."""
    row = dict(states.PARTICIPANT[State.COMPLETED])
    row[Stop] = Entry(Kind.LATE, State.COMPLETED, Fault)
    monkeypatch.setitem(states.PARTICIPANT, State.COMPLETED, row)
    for medium in (FIFO, UNORDERED):
        broken = check_one(medium).cells[Property.VALID_STATE]
        assert broken is not None
        report_index, stop_index = (
            next(n for n, line in enumerate(broken.chart) if text in line) for text in ("sends Completed", "| Stop")
        )
        assert report_index < stop_index, "a shortest run that shows the crossing"


def test_a_participant_that_nobody_sends_home_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    row = dict(states.PARTICIPANT[State.COMPENSATED])
    row[End] = row[Cancel] = Entry(Kind.LATE, State.COMPENSATED)
    monkeypatch.setitem(states.PARTICIPANT, State.COMPENSATED, row)
    assert Property.TERMINATION in _fallen({**check_one(DUPLICATING).cells})


def test_mutations_are_undone() -> None:
    entries_before = list(states.ABANDONED_STATES.items())
    with altered(Mutation("ABANDONED_STATES", "Executing", "", "ignored")):
        assert State.EXECUTING not in states.ABANDONED_STATES
    assert entries_before == list(states.ABANDONED_STATES.items())


def test_two_parts_joined_are_as_their_quotients_joined() -> None:
    """The reduction beside what it reduces: every state as a class of its own."""
    part = explore(Link(Model(medium=FIFO, restarts=False, cut_off=False)), single_participant=False)
    small = quotient(part)
    classes = [small.observations[block] for block in small.classes]
    moves = [
        tuple({(part.kinds[part.labels[move]], part.targets[move]) for move in part.transitions(state_index)})
        for state_index in range(len(part.states))
    ]
    whole = explore_pair(Quotient(part, list(range(len(part.states))), classes, moves))
    reduced = explore_pair(small)
    assert len(reduced.states) < len(whole.states) / 2
    assert reduced.outcomes == whole.outcomes
    assert reduced.violations.keys() == whole.violations.keys() == {Property.MUTUAL_EXCLUSION}
    assert len(reduced.path_to(reduced.violations[Property.MUTUAL_EXCLUSION].state)) == len(
        whole.path_to(whole.violations[Property.MUTUAL_EXCLUSION].state)
    )


def test_a_check_is_the_same_in_another_process() -> None:
    """A check reaches its process as a copy, which is equal to the original and not the same object."""
    kind = StepKind.NOT_NOW
    assert check_kind(kind, pickle.loads(pickle.dumps(LOSSY_FIFO))).states == check_kind(kind, OUTBOX).states


def test_media() -> None:
    first, second = 0, 1
    channels = {medium: medium.send(medium.send(EMPTY, first), second) for medium in (*MEDIA, OUTBOX)}
    arriving = {
        medium.name: {delivery.token for delivery in medium.arrivals(channel)}
        for medium, channel in channels.items()
        if medium is not OUTBOX
    }
    assert arriving["FIFO"] == arriving["FIFO, lossy"] == {first}
    assert arriving["unordered"] == arriving["unordered, lossy"] == arriving["unordered, lossy, duplicating"] == {first, second}
    (arrival,) = FIFO.arrivals(channels[FIFO])
    assert [delivery.token for delivery in FIFO.arrivals(arrival.channel_after)] == [second]
    redelivering = {
        medium.name for medium, channel in channels.items() for delivery in medium.arrivals(channel) if delivery.channel_after == channel
    }
    assert redelivering == {"FIFO, lossy", "unordered, lossy"}, "an acknowledgement is lost, and the message comes again"
    late_delivery = next(delivery for delivery in DUPLICATING.arrivals(channels[DUPLICATING]) if delivery.token == first)
    assert {delivery.token for delivery in DUPLICATING.arrivals(late_delivery.channel_after)} == {first, second}, (
        "long acknowledged, and here again"
    )
    assert {event.word for event in LOSSY_FIFO.events(channels[LOSSY_FIFO])} == {"is lost"}
    lost = next(LOSSY_FIFO.events(channels[LOSSY_FIFO])).channel_after
    assert [(event.word, event.token) for event in LOSSY_FIFO.events(lost)] == [("is lost", second), ("is sent again", first)]


def _reservations(medium: Medium, *, restarts: bool = True, decisions: bool = False, lapses: bool = False) -> list[Property]:
    model = ReservationModel(medium=medium, restarts=restarts, decisions=decisions, lapses=lapses)
    return _fallen({**check_reservations(model, "").cells})


@pytest.mark.parametrize(("rule", "change"), reservation_rules.RULES)
def test_a_wrong_rule_of_reservations_is_noticed(rule: str, change: str) -> None:
    assert reservation_rules.find_violation(rule, reservation_rules.RULES[rule, change])


@pytest.mark.parametrize(("rule", "change"), reservation_rules.SHARED_RULES)
def test_a_wrong_rule_of_reservations_at_neighbours_is_noticed(rule: str, change: str) -> None:
    violation = reservation_rules.find_shared_violation(rule, *reservation_rules.SHARED_RULES[rule, change])
    assert bool(violation) is (change not in reservation_rules.EXPLANATIONS)


@pytest.mark.parametrize("medium", [FIFO, UNORDERED], ids=str)
def test_no_two_tasks_of_neighbours_have_one_object_and_both_end(medium: Medium) -> None:
    model = SharedReservationModel(medium=medium, delays=True)
    assert _fallen({**check_reservations(model, "").cells}) == []


@pytest.mark.parametrize("medium", [OUTBOX if medium is LOSSY_FIFO else medium for medium in MEDIA], ids=str)
def test_no_two_tasks_of_two_task_managers_have_one_object_and_both_end(medium: Medium) -> None:
    assert _reservations(medium) == []


@pytest.mark.slow
def test_no_two_tasks_have_one_object_whoever_restarts_is_cancelled_or_tries_again() -> None:
    assert _reservations(FIFO, decisions=True) == []


def test_repositories_that_grant_one_object_twice_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Reservations, "_conflicts", lambda *_, **__: {})
    assert _reservations(FIFO) == [Property.MUTUAL_EXCLUSION]


def test_tasks_that_wait_and_are_not_told_when_their_objects_are_free_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Reservations, "admit_waiting", lambda *_: iter(()))
    assert _reservations(FIFO) == [Property.TERMINATION]


def test_task_managers_that_claim_less_than_they_were_granted_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer that grants a reservation is on its way when the Task Manager starts and claims what it knows of."""
    claim = TaskReservation.claim

    def hasty_claim(reservation: TaskReservation, *task: Any) -> Claim | None:
        made = claim(reservation, *task)
        return structs.replace(made, serial=reservation.serial + 1) if made is not None else None

    monkeypatch.setattr(TaskReservation, "claim", hasty_claim)
    assert _reservations(FIFO, decisions=True) == [Property.MUTUAL_EXCLUSION]


@pytest.mark.slow
def test_the_lease_of_a_silent_task_manager_ends_without_harm() -> None:
    assert _reservations(FIFO, lapses=True) == []
