"""The model check itself: the protocol holds on small configurations, and tables that are wrong are found out."""

from __future__ import annotations

import pytest

from somrs.protocol.frp import states
from somrs.protocol.frp.states import Entry, Kind
from somrs.protocol.messages.frp import Cancel, End, Fault, State, Stop
from verification.model_check.explore import explore
from verification.model_check.media import DUPLICATING, EMPTY, FIFO, LOSSY_FIFO, MEDIA, OUTBOX, UNORDERED, Medium
from verification.model_check.mutations import Mutation, all_mutations, altered, find_violation
from verification.model_check.pair import explore_pair
from verification.model_check.properties import Property
from verification.model_check.quotient import Quotient, quotient
from verification.model_check.suite import check_assumption, check_lost_disk, check_one, check_two
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
