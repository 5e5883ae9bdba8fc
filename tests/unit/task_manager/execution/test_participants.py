"""What is said to the participants of one transaction, what of what they say matters, and how long one may be silent."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.kernel.component import Effect, Send, SetTimer
from somrs.kernel.offers import Offers
from somrs.kernel.replica import Replica
from somrs.kernel.service_replica import ServiceReplica
from somrs.ontology.services import ServiceType
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import ReceiveResult
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.events import Event, ServiceOverdue, ServiceSilent
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.context import Quotes, TaskManagerContext
from somrs.task_manager.device_queue import AtWork, DeviceQueues
from somrs.task_manager.discovery import Discovery
from somrs.task_manager.execution.bids import Bid
from somrs.task_manager.execution.member import Member, Members
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.execution.senders import answer_stranger
from somrs.task_manager.pace import Pace
from somrs.task_manager.requests import Requests
from somrs.task_manager.timers import OverdueDue, SilenceDue
from somrs.task_manager.world_clock import WorldClock
from tests.support.effects import run_effects

WORK = ServiceType(name="Work", effect="Jar1.Clean = TRUE")
OFFER = Offer(service="Robot1.Work", provider="Robot1", provider_type="Robot", address="devices/Robot1", service_type=WORK)
ARRANGE = frp.Arrange(service_type="Work", inputs={}, effect="Jar1.Clean = TRUE")
TERMS = frp.Terms(effect="Jar1.Clean = TRUE", price=5.0, duration=30.0)
EXECUTE = frp.Execute(inputs={})
ME, DAY = "tm", 86_400.0


class TransactionHarness:
    """Participants of one transaction, and what was noted of them."""

    def __init__(self) -> None:
        self.members, self.queues = Members(), DeviceQueues()
        self.logged_events: list[tuple[Event, float]] = []
        self.logged_messages: list[tuple[float, Message]] = []
        self.replica = Replica(ME, "repository", version=7)
        self.directory = ServiceReplica(ME, "registry")
        self.touched: dict[str, None] = {}
        context = TaskManagerContext(
            replica=self.replica,
            requests=Requests(address=ME, repository="repository", registry="registry"),
            local_reservations=None,
            discovery=Discovery(directory=self.directory),
            queues=self.queues,
            quotes=Quotes(),
            pace=Pace(),
            clock=WorldClock(),
            touched=self.touched,
            commitments=dict,
            still_at_work=lambda work: True,
            reserved_elsewhere=lambda task: frozenset(),
            may_ask=lambda task: True,
        )
        self.participants = Participants("task1", self.members, context, self._log_event, self._log_message)
        self._message_count = 0

    def _log_event(self, event: Event, now: float) -> None:
        self.logged_events.append((event, now))

    def _log_message(self, now: float, message: Message) -> None:
        self.logged_messages.append((now, message))

    def invited(self, step: str = "1.1/step1", now: float = 0.0) -> Member:
        return run_effects(self.participants.invite(OFFER, "step1", step, ARRANGE, now, 10.0))[1]

    def message(self, participant: str | None, body: FrpBody, sender: str = OFFER.address) -> Message:
        self._message_count += 1
        header = Header(
            sender=sender,
            recipient=ME,
            message_id=f"said {self._message_count}",
            reply_to=sender,
            transaction="task1",
            participant=participant,
        )
        return Message(header=header, body=body)

    def member_says(
        self, member: Member, body: FrpBody, now: float = 0.0
    ) -> tuple[list[Effect], tuple[Member, ReceiveResult, Message] | None]:
        return run_effects(self.participants.receive(self.message(member.id, body, sender=member.offer.address), now))

    def offered(self, duration: float = 30.0) -> Member:
        member = self.invited()
        self.member_says(member, frp.Terms(effect="", price=5.0, duration=duration))
        return member

    def committed(self, duration: float = 30.0) -> Member:
        member = self.offered(duration)
        assert member.session.terms_id is not None
        run_effects(self.participants.accept(member, member.session.terms_id, 0.0))
        return member

    def executing(self, now: float = 100.0, duration: float = 30.0, *, started: bool = False) -> Member:
        member = self.committed(duration)
        run_effects(self.participants.execute(member, EXECUTE, now))
        if started:
            self.member_says(member, frp.Progress(fraction=0.1), now)
        return member

    def in_state(self, state: State) -> Member:
        match state:
            case State.ARRANGING:
                return self.invited()
            case State.OFFERED:
                return self.offered()
            case State.COMMITTED:
                return self.committed()
        member = self.executing()
        match state:
            case State.STOPPING:
                run_effects(self.participants.halt(member, "enough", 100.0))
            case State.COMPLETED:
                self.member_says(member, frp.Completed(situation="Jar1.Clean = TRUE"), 100.0)
            case State.COMPENSATING:
                self.member_says(member, frp.Completed(situation="Jar1.Clean = TRUE"), 100.0)
                run_effects(self.participants.compensate(member, "Jar1.Clean = FALSE", 100.0))
            case State.UNREACHABLE:
                run_effects(self.participants.give_up_member(member))
        assert member.state is state
        return member


def sends(effects: list[Effect]) -> list[tuple[object, float | None]]:
    """What is sent, and until when."""
    return [(effect.message.body, effect.expires_at) for effect in effects if isinstance(effect, Send)]


def timer_times(effects: list[Effect]) -> dict[str, float | None]:
    """When which kind of timer is to ring."""
    return {type(effect.timer).__name__: effect.at for effect in effects if isinstance(effect, SetTimer)}


# Speaking


def test_who_is_asked_is_a_participant_of_its_own_each_time() -> None:
    transaction = TransactionHarness()
    effects, first = run_effects(transaction.participants.invite(OFFER, "step1", "1.1/step1", ARRANGE, 3.0, 10.0))
    second = transaction.invited(step="1.2/step1", now=4.0)
    assert [*transaction.members] == [first, second]
    assert (first.id, first.number, first.step, first.label, first.offer) == ("Robot1.Work#step1", 1, "1.1/step1", "step1", OFFER)
    assert (second.id, second.number, second.step) == ("Robot1.Work#step1.2", 2, "1.2/step1")
    assert sends(effects) == [(ARRANGE, 13.0)]
    (arrange_message,) = [effect.message for effect in effects if isinstance(effect, Send)]
    assert (arrange_message.header.sender, arrange_message.header.recipient, arrange_message.header.transaction) == (
        ME,
        OFFER.address,
        "task1",
    )
    assert [time for time, _ in transaction.logged_messages] == [3.0, 4.0]
    assert transaction.logged_messages[0][1] == arrange_message
    assert (transaction.members.invited_count, transaction.members.change_count, first.change_number, second.change_number) == (2, 2, 1, 2)


def test_who_is_known_only_is_not_asked() -> None:
    transaction = TransactionHarness()
    transaction.invited()
    member = transaction.participants.make_member(OFFER, "step2", "1.1/step2")
    assert (member.id, member.number, member.state) == ("Robot1.Work#step2.2", 2, State.NEW)
    assert (transaction.members.invited_count, len([*transaction.members])) == (1, 1)


def test_what_is_told_is_kept_up_for_as_long_as_it_matters() -> None:
    transaction = TransactionHarness()
    member = transaction.offered()
    assert member.session.terms_id is not None
    effects, _ = run_effects(transaction.participants.accept(member, member.session.terms_id, 50.0))
    assert sends(effects) == [(frp.Accept(terms=member.session.terms_id), 70.0)]
    effects, _ = run_effects(transaction.participants.execute(member, EXECUTE, 60.0))
    order = frp.Execute(inputs={}, begin_by=80.0)
    assert sends(effects) == [(order, 80.0)]
    assert (member.last_order, member.begins_by) == (order, 80.0)
    assert transaction.queues.at_work == {"Robot1": [AtWork("task1", "Robot1.Work#step1")]}
    effects, _ = run_effects(transaction.participants.halt(member, "enough", 61.0))
    assert sends(effects) == [(frp.Stop(reason="enough"), 81.0)]


@pytest.mark.parametrize(
    ("duration", "start", "overdue"),
    [(6.0, 100.0, 160.0), (7.0, 100.0, 170.0), (7.0, 105.0, 175.0), (7.0, 90.0, 170.0), (7.0, None, 170.0)],
)
def test_a_service_has_ten_times_as_long_as_it_said_from_when_it_is_to_start_and_a_minute_at_least(
    duration: float, start: float | None, overdue: float
) -> None:
    transaction = TransactionHarness()
    member = transaction.committed(duration)
    if start is not None:
        member.bid = Bid(participant=member.id, terms=TERMS, terms_id="", start=start, finish=start + duration)
    effects, _ = run_effects(transaction.participants.execute(member, EXECUTE, 100.0))
    assert [effect for effect in effects if isinstance(effect, SetTimer)] == [
        SetTimer(SilenceDue("task1", member.id), 120.0),
        SetTimer(OverdueDue("task1", member.id), overdue),
    ]
    assert (member.last_heard_time, member.queried) == (100.0, False)


def test_who_has_done_something_is_told_to_undo_it() -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.COMPLETED)
    member.reported, member.lost_version = True, 3
    effects, accepted = run_effects(transaction.participants.compensate(member, "Jar1.Clean = FALSE", 200.0))
    assert accepted is True
    assert sends(effects) == [(frp.Compensate(situation="Jar1.Clean = FALSE", begin_by=220.0), 220.0)]
    assert timer_times(effects) == {"SilenceDue": 220.0, "OverdueDue": 500.0}
    assert (member.reported, member.state) == (False, State.COMPENSATING)
    assert [listed_member.lost_version for listed_member in transaction.members] == [None]
    assert transaction.queues.at_work == {"Robot1": [AtWork("task1", member.id)] * 2}


@pytest.mark.parametrize("state", [State.COMMITTED, State.UNREACHABLE])
def test_who_cannot_be_told_to_undo_is_left_alone(state: State) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    state_before = (member.reported, member.lost_version)
    assert run_effects(transaction.participants.compensate(member, "Jar1.Clean = FALSE", 200.0)) == ([], False)
    assert (member.reported, member.lost_version, member.state) == (*state_before, state)


@pytest.mark.parametrize(
    ("state", "cancelled"),
    [
        (State.ARRANGING, True),
        (State.OFFERED, True),
        (State.COMMITTED, True),
        (State.EXECUTING, False),
        (State.COMPLETED, False),
        (State.UNREACHABLE, False),
    ],
)
def test_only_who_has_not_begun_is_dismissed(state: State, cancelled: bool) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    effects, _ = run_effects(transaction.participants.dismiss(member, "not needed", 200.0))
    assert sends(effects) == ([(frp.Cancel(reason="not needed"), 200.0 + DAY)] if cancelled else [])


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (State.OFFERED, [(frp.Cancel(reason="enough"), 200.0 + DAY)]),
        (State.EXECUTING, [(frp.Stop(reason="enough"), 220.0)]),
        (State.STOPPING, []),
        (State.COMPLETED, []),
        (State.COMPENSATING, []),
    ],
)
def test_whoever_works_has_to_stop_and_who_does_not_goes_home(state: State, expected: list[tuple[object, float]]) -> None:
    transaction = TransactionHarness()
    transaction.in_state(state)
    effects, _ = run_effects(transaction.participants.stop("enough", 200.0))
    assert sends(effects) == expected


@pytest.mark.parametrize(
    ("state", "body", "final_state"),
    [
        (State.ARRANGING, frp.Cancel(reason="the task is over"), State.ARRANGING),
        (State.COMMITTED, frp.End(outcome=Outcome.FAILED), State.COMMITTED),
        (State.COMPLETED, frp.End(outcome=Outcome.FAILED), State.COMPLETED),
        (State.EXECUTING, frp.End(outcome=Outcome.FAILED), State.UNREACHABLE),
        (State.COMPENSATING, frp.End(outcome=Outcome.FAILED), State.STRANDED),
    ],
)
def test_everybody_hears_of_the_end(state: State, body: FrpBody, final_state: State) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    effects, _ = run_effects(transaction.participants.end(Outcome.FAILED, 300.0))
    assert sends(effects) == [(body, 300.0 + DAY)]
    assert member.final_state is final_state
    assert member.lost_version == (7 if state in (State.EXECUTING, State.COMPENSATING) else None)


def test_after_the_end_those_are_kept_that_may_report_yet() -> None:
    transaction = TransactionHarness()
    finished, lost, reported = transaction.invited(), transaction.invited(), transaction.invited()
    lost.lost_version = 3
    reported.lost_version, reported.reported = 3, True
    transaction.participants.forget([None, "nobody", finished.id])
    assert [*transaction.members] == [lost]
    assert transaction.members.former == {finished.id: finished}
    assert [transaction.members.find_known_member(id) for id in (lost.id, finished.id, reported.id, None)] == [lost, finished, None, None]
    assert [transaction.members.find_member(id) for id in (lost.id, finished.id, None)] == [lost, None, None]


# Who is at work


@pytest.mark.parametrize(
    ("state", "working", "held"),
    [
        (State.OFFERED, False, False),
        (State.COMMITTED, False, True),
        (State.EXECUTING, True, True),
        (State.STOPPING, True, True),
        (State.COMPENSATING, True, True),
        (State.COMPLETED, False, False),
        (State.UNREACHABLE, False, False),
    ],
)
def test_who_works_and_whose_a_step_is(state: State, working: bool, held: bool) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    assert transaction.members.working == ([member] if working else [])
    assert transaction.members.at_work(member.id) is working
    assert transaction.members.held("1.1/step1") is held
    assert transaction.members.held("1.1/step2") is False
    assert transaction.members.at_work("nobody") is False


@pytest.mark.parametrize(("halting", "reporting"), [(True, False), (False, True)])
def test_a_device_is_taken_until_it_stands_still_and_what_it_did_is_known(halting: bool, reporting: bool) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.COMPLETED)
    member.halting, member.reporting = halting, reporting
    assert transaction.members.at_work(member.id) is True
    assert transaction.members.working == ([member] if halting else [])


# Hearing


def test_what_a_participant_says_is_noted_and_counts_as_a_sign_of_life() -> None:
    transaction = TransactionHarness()
    member = transaction.executing()
    member.queried = True
    changes, noted = transaction.members.change_count, len(transaction.logged_messages)
    effects, received = transaction.member_says(member, frp.Progress(fraction=0.5), 110.0)
    assert effects == []
    assert received is not None
    assert (received[0], received[1].moved) == (member, True)
    assert (member.last_heard_time, member.queried, member.begins_by) == (110.0, False, 0.0)
    assert (transaction.members.change_count, [time for time, _ in transaction.logged_messages[noted:]]) == (changes, [110.0])
    transaction.member_says(member, frp.Completed(situation="Jar1.Clean = TRUE"), 111.0)
    assert (transaction.members.change_count, member.change_number) == (changes + 1, changes + 1)


def test_who_has_come_to_an_end_is_not_watched_any_more_and_who_comes_back_is() -> None:
    transaction = TransactionHarness()
    member = transaction.executing()
    effects, _ = transaction.member_says(member, frp.Completed(situation="Jar1.Clean = TRUE"), 110.0)
    assert effects == [SetTimer(SilenceDue("task1", member.id), None), SetTimer(OverdueDue("task1", member.id), None)]
    other_transaction = TransactionHarness()
    member = other_transaction.in_state(State.UNREACHABLE)
    effects, _ = other_transaction.member_says(member, frp.Progress(fraction=0.5), 500.0)
    assert [type(body).__name__ for body, _ in sends(effects)] == ["Stop"]
    assert timer_times(effects) == {"SilenceDue": 520.0, "OverdueDue": 800.0}
    assert [type(message.body).__name__ for _, message in other_transaction.logged_messages[-2:]] == ["Progress", "Stop"]


@pytest.mark.parametrize(
    ("state", "status", "repeated"),
    [
        (State.EXECUTING, State.OFFERED, True),
        (State.EXECUTING, State.COMMITTED, True),
        (State.EXECUTING, State.EXECUTING, False),
        (State.COMPENSATING, State.COMPLETED, True),
        (State.COMPENSATING, State.STOPPED, True),
        (State.COMPENSATING, State.COMPENSATING, False),
        (State.STOPPING, State.COMMITTED, False),
    ],
)
def test_who_was_not_reached_by_what_it_was_told_is_told_again(state: State, status: State, repeated: bool) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    first_order, body = member.last_order, frp.Status(state=status)
    effects, _ = transaction.member_says(member, body, 110.0)
    assert (sends(effects), member.begins_by) == ([], 120.0), "whether the step may still begin is for others to say"
    assert transaction.participants.is_unreached(member, body) is repeated
    if not repeated:
        return
    effects, _ = run_effects(transaction.participants.order_again(member, 110.0))
    assert [(type(order), expires_at) for order, expires_at in sends(effects)] == [(type(first_order), 130.0)]
    assert (type(member.last_order), member.begins_by) == (type(first_order), 130.0)


@pytest.mark.parametrize(
    ("state", "status", "order"),
    [
        (State.EXECUTING, State.COMPLETED, "Execute"),
        (State.EXECUTING, State.FAILED, "Execute"),
        (State.EXECUTING, State.STOPPED, "Stop"),
        (State.STOPPING, State.STOPPED, "Stop"),
        (State.COMPENSATING, State.STRANDED, "Compensate"),
        (State.EXECUTING, State.EXECUTING, None),
        (State.COMPENSATING, State.COMPLETED, None),
    ],
)
def test_who_has_reported_to_somebody_else_is_told_to_repeat_it(state: State, status: State, order: str | None) -> None:
    transaction = TransactionHarness()
    member, body = transaction.in_state(state), frp.Status(state=status)
    assert transaction.participants.has_reported(member, body) is (order is not None)
    if order is not None:
        effects, _ = run_effects(transaction.participants.ask_for_report(member, body, 110.0))
        assert [(type(repeated).__name__, expires_at) for repeated, expires_at in sends(effects)] == [(order, 130.0)]


def test_a_stranger_is_sent_home() -> None:
    transaction = TransactionHarness()
    message = transaction.message("Robot9.Work#step1", frp.Completed(situation="Jar1.Clean = TRUE"))
    effects, received = run_effects(transaction.participants.receive(message, 5.0))
    assert received is None
    (farewell,) = [effect for effect in effects if isinstance(effect, Send)]
    assert isinstance(farewell.message.body, frp.End)
    assert farewell.message.header.recipient == OFFER.address
    assert transaction.logged_messages == []


@pytest.mark.parametrize(
    ("transaction", "participant", "reply_to", "recipients"),
    [
        ("old task", "Robot1.Work#step1", "elsewhere", ["elsewhere"]),
        ("old task", "Robot1.Work#step1", ANONYMOUS, ["devices/Robot1"]),
        (None, "Robot1.Work#step1", "elsewhere", []),
        ("old task", None, "elsewhere", []),
    ],
)
def test_who_is_sent_home_hears_it_where_it_wants_its_answers(
    transaction: str | None, participant: str | None, reply_to: str, recipients: list[str]
) -> None:
    header = Header(sender=OFFER.address, recipient=ME, message_id="1", reply_to=reply_to, transaction=transaction, participant=participant)
    effects = answer_stranger(Message(header=header, body=frp.Completed(situation="")), ME)
    headers = [effect.message.header for effect in effects if isinstance(effect, Send)]
    assert [header.recipient for header in headers] == recipients
    assert all((header.sender, header.transaction, header.participant) == (ME, transaction, participant) for header in headers)


@pytest.mark.parametrize(
    ("state", "body", "excluded", "expected"),
    [
        (State.ARRANGING, ARRANGE, True, [(frp.Cancel(reason="could not be reached: no route"), 50.0 + DAY)]),
        (State.OFFERED, ARRANGE, False, []),
        (State.COMMITTED, frp.Accept(terms="1"), True, []),
        (State.EXECUTING, frp.Accept(terms="1"), False, []),
        (State.EXECUTING, EXECUTE, False, []),
        (State.STOPPING, frp.Stop(reason="enough"), False, [(frp.Stop(reason="enough"), 70.0)]),
        (State.COMPLETED, frp.Stop(reason="enough"), False, []),
    ],
)
def test_who_cannot_be_reached_is_out_unless_it_works(
    state: State, body: FrpBody, excluded: bool, expected: list[tuple[object, float]]
) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    changes = transaction.members.change_count
    effects, excluded_member = run_effects(transaction.participants.delivery_failed(transaction.message(member.id, body), "no route", 50.0))
    assert excluded_member is (member if excluded else None)
    assert sends(effects) == expected
    assert member.exit_reason == ("could not be reached: no route" if excluded else "")
    assert member.change_number == (transaction.members.change_count if excluded else changes)
    assert (transaction.members.change_count > changes) is excluded
    assert member.lost_version == (7 if state is State.COMMITTED else None)
    assert run_effects(transaction.participants.delivery_failed(transaction.message("nobody", body), "no route", 50.0)) == ([], None)


# Silence, and lateness


def test_a_timer_that_rings_too_early_is_set_again() -> None:
    transaction = TransactionHarness()
    member = transaction.executing(100.0, started=True)
    effects, lost_member = run_effects(transaction.participants.silent(member.id, 119.5))
    assert (timer_times(effects), sends(effects), lost_member) == ({"SilenceDue": 120.0}, [], None)
    assert (member.queried, transaction.logged_events) == (False, [])


@pytest.mark.parametrize(("started", "deadline"), [(True, 140.0), (False, 160.0)])
def test_who_is_silent_is_asked_and_then_given_up(started: bool, deadline: float) -> None:
    """Who was not heard to begin may do so when its order is just about to expire, and is waited for twice as long from then on."""
    transaction = TransactionHarness()
    member = transaction.executing(100.0, started=started)
    effects, lost_member = run_effects(transaction.participants.silent(member.id, 120.0))
    assert (sends(effects), timer_times(effects), lost_member) == ([(frp.Query(), deadline)], {"SilenceDue": deadline}, None)
    assert transaction.logged_events == [(ServiceSilent(service="Robot1.Work"), 120.0)]
    assert member.queried is True
    effects, lost_member = run_effects(transaction.participants.silent(member.id, deadline))
    assert lost_member is member
    assert timer_times(effects) == {"SilenceDue": None, "OverdueDue": None}
    assert (member.state, member.lost_version, member.change_number) == (State.UNREACHABLE, 7, transaction.members.change_count)
    assert len(transaction.logged_events) == 1


@pytest.mark.parametrize("state", [State.COMMITTED, State.COMPLETED, State.UNREACHABLE])
def test_the_silence_of_who_does_not_work_means_nothing(state: State) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    member.queried = True
    assert run_effects(transaction.participants.silent(member.id, 900.0)) == ([], None)
    assert run_effects(transaction.participants.overdue(member.id, 900.0)) == ([], None)
    assert run_effects(transaction.participants.silent("nobody", 900.0)) == ([], None)
    assert run_effects(transaction.participants.overdue("nobody", 900.0)) == ([], None)
    assert (member.state, transaction.logged_events) == (state, [])


def test_who_takes_far_too_long_is_stopped_and_then_given_up() -> None:
    transaction = TransactionHarness()
    member = transaction.executing()
    effects, lost_member = run_effects(transaction.participants.overdue(member.id, 400.0))
    assert sends(effects) == [(frp.Stop(reason="it takes far longer than it said"), 420.0)]
    assert (timer_times(effects), lost_member) == ({"OverdueDue": 460.0}, None)
    assert transaction.logged_events == [(ServiceOverdue(service="Robot1.Work"), 400.0)]
    effects, lost_member = run_effects(transaction.participants.overdue(member.id, 460.0))
    assert (lost_member, sends(effects), member.state) == (member, [], State.UNREACHABLE)
    assert len(transaction.logged_events) == 1


def test_who_undoes_for_far_too_long_is_sent_home_and_waited_for_until_it_stands_still() -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.COMPENSATING)
    transaction.member_says(member, frp.Progress(fraction=0.1), 101.0)
    effects, lost_member = run_effects(transaction.participants.overdue(member.id, 400.0))
    assert sends(effects) == [(frp.End(outcome=Outcome.FAILED), 400.0 + DAY)]
    assert (timer_times(effects), lost_member) == ({"SilenceDue": None, "OverdueDue": 420.0}, None)
    assert transaction.logged_events == [(ServiceOverdue(service="Robot1.Work", undoing=True), 400.0)]
    assert (member.halting, transaction.members.working) == (True, [member])
    assert run_effects(transaction.participants.overdue(member.id, 420.0)) == ([], member)
    assert (member.halting, transaction.members.working) == (False, [])


def test_whoever_watches_the_task_hears_of_a_contract_that_changed() -> None:
    transaction = TransactionHarness()
    member = transaction.executing()
    transaction.touched.clear()
    run_effects(transaction.participants.give_up_member(member))
    assert transaction.touched == {"task1": None}


def test_who_is_given_up_twice_is_lost_once() -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.UNREACHABLE)
    changes = transaction.members.change_count
    transaction.replica.version = 9
    assert run_effects(transaction.participants.give_up_member(member)) == ([], None)
    assert (member.lost_version, transaction.members.change_count) == (7, changes)
    assert isinstance(member.session, CoordinatorSession)


COMPLETED = frp.Completed(situation="Jar1.Clean = TRUE")


def test_what_a_stranger_reports_is_refused_and_no_news() -> None:
    transaction = TransactionHarness()
    member = transaction.executing(100.0)
    logged = [*transaction.logged_messages]
    effects, received = run_effects(transaction.participants.receive(transaction.message(member.id, COMPLETED, "stranger"), 110.0))
    [fault] = [effect.message for effect in effects if isinstance(effect, Send)]
    assert (received, member.state, member.last_heard_time, transaction.logged_messages) == (None, State.EXECUTING, 100.0, logged)
    assert isinstance(fault.body, frp.Fault)
    assert fault.header.recipient == "stranger"


def test_a_device_reports_from_where_its_service_is_on_offer_now() -> None:
    transaction = TransactionHarness()
    member = transaction.executing(100.0)
    transaction.directory.offers = Offers([structs.replace(OFFER, address="moved")])
    run_effects(transaction.participants.receive(transaction.message(member.id, COMPLETED, "moved"), 110.0))
    assert (member.state, member.session.peer) == (State.COMPLETED, "moved")


@pytest.mark.parametrize(
    ("state", "address", "bodies"),
    [(State.EXECUTING, "moved", [frp.Query()]), (State.OFFERED, "moved", []), (State.EXECUTING, OFFER.address, [])],
)
def test_a_device_at_work_that_is_elsewhere_is_asked_there(state: State, address: str, bodies: list[FrpBody]) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(state)
    transaction.directory.offers = Offers([structs.replace(OFFER, address=address)])
    effects, _ = run_effects(transaction.participants.services_joined([OFFER.service], 110.0))
    messages = [effect.message for effect in effects if isinstance(effect, Send)]
    assert [message.body for message in messages] == bodies
    assert {message.header.recipient for message in messages} <= {address}
    assert member.session.peer == address
