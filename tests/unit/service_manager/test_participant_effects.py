"""A Service Manager, input by input: what exactly it sends, wakes up for and asks of its device."""

from __future__ import annotations

import msgspec
import pytest

from somrs.kernel.component import (
    Answered,
    AnswerLost,
    Ask,
    DeliveryFailed,
    Effect,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.protocol.frp.session import NOT_ALLOWED
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import ANONYMOUS, Message, reply
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.service_manager.participant.messaging import CUT_OFF, REPORT_TIME
from somrs.service_manager.participant.timers import (
    Activity,
    DepartureRequested,
    Equipped,
    HeartbeatDue,
    Observed,
    ReportDue,
    ReportWanted,
    StartDue,
    TermsDue,
    WorkWanted,
)
from somrs.service_manager.sdk.orders import Advance, Failure, Perform, Quoted, Report, Undo, WorkDone
from tests.support.effects import bodies
from tests.support.lab import CLIENT, REPOSITORY, request
from tests.support.service_manager_harness import (
    ARRANGE,
    ELSEWHERE,
    EXECUTE,
    ME,
    NOW,
    PROFILE,
    ServiceManagerHarness,
    expiry_times,
    order,
    rest,
    timers,
)


def test_who_accepts_has_it_wait_for_its_start_and_then_for_signs_of_life() -> None:
    harness = ServiceManagerHarness()
    assert harness.committed(latest_finish=900.0) == [SetTimer(timers(TermsDue), None), SetTimer(timers(StartDue), 840.0)]
    assert harness.ask(EXECUTE) == [
        SetTimer(timers(StartDue), None),
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(harness.question_for(Activity.PERFORM), Perform(order(latest_finish=900.0))),
    ]


def test_an_execute_that_overtakes_its_accept_takes_both_timers_away() -> None:
    harness = ServiceManagerHarness()
    harness.offered()
    harness.session.accept()
    assert harness.ask(EXECUTE) == [
        SetTimer(timers(TermsDue), None),
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(harness.question_for(Activity.PERFORM), Perform(order())),
    ]


@pytest.mark.parametrize(
    ("execute", "changed"),
    [
        (frp.Execute(inputs={}), {}),
        (frp.Execute(inputs={"Object": "Jar2"}), {"inputs": {"Object": "Jar2"}}),
        (
            frp.Execute(inputs={"Soap": "Soap1"}, precondition="Jar1 isOn Table2"),
            {"inputs": {"Object": "Jar1", "Soap": "Soap1"}, "precondition": "Jar1 isOn Table2"},
        ),
    ],
)
def test_an_execute_changes_the_order_by_what_it_says(execute: frp.Execute, changed: dict[str, object]) -> None:
    harness = ServiceManagerHarness()
    harness.committed()
    assert [effect.task for effect in harness.ask(execute) if isinstance(effect, Ask)] == [Perform(order(**changed))]


@pytest.mark.parametrize(("delay", "state"), [(119.0, State.COMMITTED), (120.0, State.ENDED)])
def test_an_accept_is_too_late_from_when_the_terms_expire(delay: float, state: State) -> None:
    harness = ServiceManagerHarness()
    harness.offered()
    harness.now = NOW + delay
    effects = harness.hear(harness.session.accept())
    assert harness.state is state
    assert bodies(effects) == ([frp.Refuse(reason="the terms expired", not_now=True, lapsed=True)] if state is State.ENDED else [])


OPEN_AND_FREE = "Door1.Open = TRUE AND NOT Jar1 isOn Floor1"


@pytest.mark.parametrize("accepted", [False, True])
@pytest.mark.parametrize("stated", [None, "Jar1 isOn Table1", "Door1.Open = TRUE", "Jar1 isOn"])
def test_an_execute_that_does_not_state_the_condition_of_the_terms_begins_nothing(stated: str | None, accepted: bool) -> None:
    harness = ServiceManagerHarness()
    harness.ask(ARRANGE)
    harness.device_answers(Activity.QUOTE, Quoted(price=2.0, duration=60.0, condition=OPEN_AND_FREE))
    with_condition = harness.session.copy()
    accept, stranger = with_condition.accept(), with_condition.copy()
    stranger.received_messages = {}  # a coordinator that knows nothing of conditions
    execute = stranger.send(frp.Execute(inputs={}, precondition=stated))
    execute = msgspec.structs.replace(execute, header=msgspec.structs.replace(execute.header, relates_to=with_condition.terms_id))
    if accepted:
        harness.hear(accept)
    reason = f"Execute does not say that {OPEN_AND_FREE}, on which the terms depend; nothing was done"
    answer = frp.Failed(description=reason, tried=False) if accepted else frp.Refuse(reason=reason, not_now=True)
    assert bodies(harness.manager.handle(Received(execute), NOW)) == [answer]
    assert harness.manager.idle


def test_an_execute_that_states_the_condition_of_the_terms_is_carried_out() -> None:
    harness = ServiceManagerHarness()
    harness.ask(ARRANGE)
    harness.device_answers(Activity.QUOTE, Quoted(price=2.0, duration=60.0, condition=OPEN_AND_FREE))
    harness.hear(harness.session.accept())
    harness.ask(frp.Execute(inputs={}, precondition="NOT Jar1 isOn Floor1 AND Jar1 isOn Table1 AND Door1.Open = TRUE"))
    assert harness.state is State.EXECUTING


@pytest.mark.parametrize(("late", "state"), [(0.0, State.EXECUTING), (0.5, State.FAILED)])
def test_an_execute_is_too_late_after_the_time_that_it_names(late: float, state: State) -> None:
    harness = ServiceManagerHarness()
    harness.committed(latest_finish=900.0)
    effects = harness.ask(frp.Execute(inputs={}, begin_by=NOW - late))
    assert harness.state is state
    if late:
        assert bodies(effects) == [
            frp.Failed(
                description="Execute came 0.5 s too late to begin; nothing was done: "
                "a slow network, or the clocks of the two hosts do not agree",
                tried=False,
            )
        ]
        assert rest(effects) == [SetTimer(timers(StartDue), None)]


def test_what_was_done_is_reported_for_a_day() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    effects = harness.device_answers(Activity.PERFORM, WorkDone(situation="Jar1 isOn Washer1", outputs={"Water": 3.0}))
    assert bodies(effects) == [frp.Completed(situation="Jar1 isOn Washer1", outputs={"Water": 3.0})]
    assert expiry_times(effects) == [NOW + REPORT_TIME]
    assert rest(effects) == [SetTimer(timers(HeartbeatDue), None)]
    assert harness.manager.idle


def test_how_far_it_is_is_told_at_once_and_with_each_heartbeat() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    effects = harness.device_answers(Activity.PERFORM, Advance(fraction=0.25, situation="Jar1 isHeldBy Washer1", note="filling"))
    assert bodies(effects) == [frp.Progress(fraction=0.25, situation="Jar1 isHeldBy Washer1", note="filling")]
    assert expiry_times(effects) == [NOW + CUT_OFF]
    harness.now += 5.0
    effects = harness.ring(timers(HeartbeatDue))
    assert bodies(effects) == [frp.Progress(fraction=0.25)]
    assert rest(effects) == [SetTimer(timers(HeartbeatDue), NOW + 10.0)]


def test_what_waits_for_its_turn_says_so() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    harness.participant = "Washer1.WashObject#s2"
    harness.session = harness.make_session(harness.participant)
    assert harness.executing() == [SetTimer(timers(HeartbeatDue, harness.participant), NOW + 5.0)]
    assert bodies(harness.ring(timers(HeartbeatDue, harness.participant))) == [frp.Progress(fraction=0.0, note="waits for its turn")]


@pytest.mark.parametrize("timer", [TermsDue, StartDue, HeartbeatDue])
def test_a_timer_that_rings_too_late_or_for_nobody_does_nothing(timer: type[TermsDue | StartDue | HeartbeatDue]) -> None:
    harness = ServiceManagerHarness()
    harness.completed()
    assert harness.ring(timers(timer)) == []
    assert harness.ring(timer("t1", "nobody")) == []


def test_a_timer_that_rang_is_not_taken_away_once_more() -> None:
    harness = ServiceManagerHarness()
    harness.committed(latest_finish=900.0)
    harness.now = 840.0
    effects = harness.ring(timers(StartDue))
    assert bodies(effects) == [frp.Failed(description="no order to start came in time", tried=False)]
    assert rest(effects) == []


def test_what_is_stopped_reports_what_is_known_to_hold() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    harness.device_answers(Activity.PERFORM, Advance(fraction=0.5, situation="Jar1 isHeldBy Washer1"))
    assert harness.ask(frp.Stop(reason="r")) == [Withdraw(harness.question_for(Activity.PERFORM))]
    [halt] = harness.device_answers(Activity.PERFORM, None)
    assert isinstance(halt, Ask)
    assert halt.question == harness.question_for(Activity.HALT)
    assert bodies(harness.device_answers(Activity.HALT, WorkDone())) == [frp.Stopped(situation="Jar1 isHeldBy Washer1")]


def test_what_is_undone_is_undone_to_what_is_wanted_now() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    harness.device_answers(Activity.PERFORM, WorkDone(situation="Jar1 isOn Washer1"))
    assert harness.ask(frp.Compensate(situation="Jar1 isOn Table1")) == [
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(harness.question_for(Activity.UNDO), Undo(order(), "Jar1 isOn Table1")),
    ]
    assert bodies(harness.device_answers(Activity.UNDO, WorkDone())) == [frp.Compensated(situation="Jar1 isOn Table1")]


def test_what_fails_and_then_cannot_be_undone_says_both() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    assert bodies(harness.device_answers(Activity.PERFORM, Failure("the pump is dry"))) == [frp.Failed(description="the pump is dry")]
    harness.ask(frp.Compensate(situation="Jar1 isOn Table1"))
    harness.device_answers(Activity.UNDO, AnswerLost())
    assert bodies(harness.device_answers(Activity.HALT, WorkDone())) == [
        frp.Stranded(description="the Service Manager of Washer1 was restarted while it worked")
    ]


@pytest.mark.parametrize(
    ("participant", "service_type", "begin_by", "reason"),
    [
        ("Washer1.DryObject#s1", "DryObject", None, "Washer1 cannot undo DryObject"),
        (
            "Washer1.WashObject#s1",
            "WashObject",
            NOW - 2,
            "Compensate came 2.0 s too late to begin; nothing was done: a slow network, or the clocks of the two hosts do not agree",
        ),
    ],
)
def test_what_cannot_be_undone_is_left_to_others(participant: str, service_type: str, begin_by: float | None, reason: str) -> None:
    harness = ServiceManagerHarness(participant)
    harness.ask(msgspec.structs.replace(ARRANGE, service_type=service_type))
    harness.device_answers(Activity.QUOTE, Quoted(price=2.0, duration=60.0))
    harness.hear(harness.session.accept())
    harness.ask(EXECUTE)
    harness.device_answers(Activity.PERFORM, WorkDone())
    effects = harness.ask(frp.Compensate(situation="Jar1 isOn Table1", begin_by=begin_by))
    assert bodies(effects) == [frp.Stranded(description=reason, tried=False)]
    assert rest(effects) == []


def test_who_is_equipped_without_what_it_did_cannot_undo_it() -> None:
    harness = ServiceManagerHarness()
    harness.completed()
    harness.manager.handle(Notified(Equipped(msgspec.structs.replace(PROFILE, capabilities=PROFILE.capabilities[2:]), "r", "s")), NOW)
    joining = harness.manager.state.joining
    assert (joining.profile.capabilities, joining.repository, joining.registry) == (PROFILE.capabilities[2:], "r", "s")
    reports = bodies(harness.ask(frp.Compensate(situation="Jar1 isOn Table1")))
    assert reports == [frp.Stranded(description="Washer1 cannot undo an unknown service", tried=False)]


def test_only_a_sign_of_life_that_does_not_arrive_stops_the_work() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    [progress] = [e for e in harness.device_answers(Activity.PERFORM, Advance(fraction=0.5)) if isinstance(e, Send)]
    header = progress.message.header
    assert harness.manager.handle(DeliveryFailed(Message(header=header, body=frp.Terms(effect="", price=0, duration=0)), "r"), NOW) == []
    unknown = msgspec.structs.replace(header, participant="nobody")
    assert harness.manager.handle(DeliveryFailed(Message(header=unknown, body=progress.message.body), "r"), NOW) == []
    assert harness.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == [Withdraw(harness.question_for(Activity.PERFORM))]
    assert harness.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == [], "it is being stopped"


def test_what_is_over_does_not_care_whether_its_signs_of_life_arrived() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    [progress] = [e for e in harness.device_answers(Activity.PERFORM, Advance(fraction=0.5)) if isinstance(e, Send)]
    harness.device_answers(Activity.PERFORM, WorkDone())
    assert harness.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == []


def test_who_ends_it_in_the_middle_has_no_timers_left() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    header = harness.session._repeat("Execute")[0].header
    end = Message(header=msgspec.structs.replace(header, message_id="urn:uuid:end"), body=frp.End(outcome=frp.Outcome.CANCELLED))
    assert harness.hear(end) == [SetTimer(timers(HeartbeatDue), None), Withdraw(harness.question_for(Activity.PERFORM))]


def test_who_ends_what_is_done_has_nothing_interrupted() -> None:
    harness = ServiceManagerHarness()
    harness.completed()
    assert harness.ask(frp.End(outcome=frp.Outcome.ACCOMPLISHED)) == []


@pytest.mark.parametrize(("reply_to", "expected"), [(CLIENT, NOW + REPORT_TIME), (ANONYMOUS, None)])
def test_answers_to_who_cannot_be_called_are_not_sent_again(reply_to: str, expected: float | None) -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    query = harness.session.send(frp.Query())
    effects = harness.hear(Message(header=msgspec.structs.replace(query.header, reply_to=reply_to), body=frp.Query()))
    assert bodies(effects) == [frp.Status(state=State.EXECUTING, last_message=harness.session.terms_id)]
    assert expiry_times(effects) == [expected]


@pytest.mark.parametrize("header", [{"participant": "p"}, {"transaction": "t"}])
def test_a_message_outside_any_contract_is_faulted_unless_it_is_a_fault(header: dict[str, str]) -> None:
    harness = ServiceManagerHarness()
    message = request(EXECUTE, recipient=ME)
    message = Message(header=msgspec.structs.replace(message.header, **header), body=EXECUTE)
    assert bodies(harness.hear(message)) == [
        frp.Fault(code=NOT_ALLOWED, text="Execute needs a transaction and a participant in its header")
    ]
    assert harness.hear(Message(header=message.header, body=frp.Fault(code="c", text="t"))) == []


def test_when_it_is_busy_and_with_what() -> None:
    harness = ServiceManagerHarness()
    assert (harness.manager.open, harness.manager.calendar(NOW), harness.manager.idle) == ([], [], True)
    harness.offered(earliest_start=NOW + 50)
    assert (harness.manager.open, harness.manager.calendar(NOW)) == ([], []), "an offer binds nobody"
    harness.hear(harness.session.accept())
    assert harness.manager.open == ["Washer1.WashObject#s1 in t1"]
    assert harness.manager.calendar(NOW) == [(NOW + 50, NOW + 110)]
    assert harness.manager.calendar(NOW + 70) == [(NOW + 70, NOW + 130)], "what is overdue starts now"
    harness.now = NOW + 80
    harness.ask(EXECUTE)
    assert not harness.manager.idle
    assert harness.manager.calendar(NOW + 90) == [(NOW + 80, NOW + 140)]
    assert harness.manager.calendar(NOW + 200) == [(NOW + 80, NOW + 200)], "what is overdue ends now"
    harness.device_answers(Activity.PERFORM, WorkDone())
    assert (harness.manager.open, harness.manager.calendar(NOW + 90), harness.manager.idle) == ([], [], True)


@pytest.mark.parametrize(("address", "repeated"), [(ME, False), (ELSEWHERE, True)])
def test_who_comes_up_elsewhere_says_its_last_word_from_there(address: str, repeated: bool) -> None:
    harness = ServiceManagerHarness()
    messages = [effect.message for effect in harness.completed() if isinstance(effect, Send)]
    sends = [effect for effect in harness.manager.handle(Started(address), NOW + 1) if isinstance(effect, Send)]
    mine = [effect for effect in sends if effect.message.header.participant is not None]
    assert mine == [
        Send(
            msgspec.structs.replace(message, header=msgspec.structs.replace(message.header, sender=address, reply_to=address)),
            NOW + 1 + REPORT_TIME,
        )
        for message in messages * repeated
    ]
    assert harness.manager.address == address


def test_who_leaves_refuses_what_comes_until_it_starts_again() -> None:
    harness = ServiceManagerHarness()
    harness.manager.handle(Notified(DepartureRequested()), NOW)
    assert bodies(harness.ask(ARRANGE)) == [frp.Refuse(reason="Washer1 is leaving", not_now=True)]
    harness.manager.handle(Started(ME), NOW)
    harness.session = harness.make_session("Washer1.WashObject#s2")
    assert bodies(harness.ask(ARRANGE)) == []


def test_a_state_that_nobody_heard_of_is_new() -> None:
    assert ServiceManagerHarness().state is State.NEW


def on_the_map(harness: ServiceManagerHarness) -> None:
    """From now on its reports are sent."""
    reports = harness.manager.state.reports
    assert [*reports.start(NOW)] == []


def reported(effects: list[Effect]) -> list[tuple[str, str, float | None]]:
    """The situations that the Repository is told, by whom, and until when that is tried."""
    sends = [effect for effect in effects if isinstance(effect, Send)]
    return [
        (send.message.body.situation or "", send.message.body.author, send.expires_at)
        for send in sends
        if isinstance(send.message.body, UpdateMap)
    ]


def test_what_is_noticed_is_reported_one_after_the_other() -> None:
    harness = ServiceManagerHarness()
    on_the_map(harness)
    first, timer = harness.manager.handle(Notified(Observed("A isOn B")), NOW)
    assert reported([first]) == [("A isOn B", "Washer1", NOW + 10.0)]
    assert timer == SetTimer(ReportDue(), NOW + 15.0)
    assert harness.manager.handle(Notified(Observed("A isOn C")), NOW + 1) == []
    assert isinstance(first, Send)
    assert (first.message.header.sender, first.message.header.recipient, first.message.header.reply_to) == (ME, REPOSITORY, ME)
    for retry_input in (DeliveryFailed(first.message, "r"), TimerFired(ReportDue())):
        assert reported(harness.manager.handle(retry_input, NOW + 2)) == [("A isOn B", "Washer1", NOW + 12.0)]
    cancelled_timer, second, next_timer = harness.manager.handle(Received(reply(first.message, Updated(version=1), REPOSITORY)), NOW + 3)
    assert (cancelled_timer, reported([second]), next_timer) == (
        SetTimer(ReportDue(), None),
        [("A isOn C", "Washer1", NOW + 13.0)],
        SetTimer(ReportDue(), NOW + 18.0),
    )


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (Rejected(problems=("no A", "no B"), version=1), "no A; no B"),
        (frp.Fault(code="Sender", text="no formula"), "no formula"),
    ],
)
def test_what_the_repository_does_not_take_is_told_to_a_person(answer: Rejected | frp.Fault, reason: str) -> None:
    harness = ServiceManagerHarness()
    on_the_map(harness)
    [first] = [effect for effect in harness.manager.handle(Notified(Observed("A isOn B")), NOW) if isinstance(effect, Send)]
    assert harness.manager.handle(Received(reply(first.message, answer, REPOSITORY)), NOW) == [
        SetTimer(ReportDue(), None),
        Ask(ReportWanted(), Report(f"the Repository rejects A isOn B from Washer1: {reason}")),
    ]


def test_what_waits_at_a_restart_is_given_up_with_its_reason() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    harness.participant = "Washer1.WashObject#s2"
    harness.session = harness.make_session(harness.participant)
    harness.executing()
    failures = [body for body in bodies(harness.manager.handle(Started(ME), NOW + 1)) if isinstance(body, frp.Failed)]
    assert failures == [frp.Failed(description="the Service Manager of Washer1 was restarted while it worked", tried=False)]
    assert harness.state is State.FAILED


@pytest.mark.parametrize(
    ("ended", "leftover", "expected_reports"),
    [
        (True, "Jar1 isOn Floor1", [("Jar1 isOn Floor1", "Washer1.WashObject", NOW + 10.0)]),
        (True, None, []),
        (False, "Jar1 isOn Floor1", []),
    ],
)
def test_what_the_device_left_is_told_to_the_repository_when_nobody_waits_to_hear_of_it(
    ended: bool, leftover: str | None, expected_reports: list[tuple[str, str, float | None]]
) -> None:
    harness = ServiceManagerHarness()
    on_the_map(harness)
    harness.executing()
    if ended:
        harness.session.state = State.COMPLETED  # the coordinator has given it up
    harness.ask(frp.End(outcome=frp.Outcome.FAILED) if ended else frp.Stop(reason="r"))
    harness.device_answers(Activity.PERFORM, None)
    effects = harness.device_answers(Activity.HALT, WorkDone(situation=leftover))
    assert reported(effects) == expected_reports
    assert [body for body in bodies(effects) if not isinstance(body, UpdateMap)] == ([] if ended else [frp.Stopped(situation=leftover)])
    assert harness.manager.idle


def test_an_answer_to_what_the_device_does_not_do_now_changes_nothing() -> None:
    harness = ServiceManagerHarness()
    harness.executing()
    for activity in (Activity.UNDO, Activity.HALT):
        assert harness.device_answers(activity, Failure("f")) == []
    stranger = Answered(WorkWanted("t1", "nobody", Activity.PERFORM), WorkDone())
    assert harness.manager.handle(stranger, NOW) == []
    assert (harness.state, harness.manager.idle) == (State.EXECUTING, False)
    assert bodies(harness.device_answers(Activity.PERFORM, WorkDone())) == [frp.Completed(situation="")]
    assert harness.device_answers(Activity.PERFORM, WorkDone()) == harness.manager.handle(stranger, NOW) == []
    assert (harness.state, harness.manager.idle) == (State.COMPLETED, True)
