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
from somrs.protocol.frp.session import NOT_ALLOWED, CoordinatorBody, CoordinatorSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import ANONYMOUS, Message, reply
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.speech import CUT_OFF, REPORT_TIME
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
from somrs.service_manager.sdk.orders import (
    Advance,
    Answer,
    Capability,
    Failure,
    Order,
    Perform,
    Profile,
    Quote,
    Quoted,
    Refused,
    Report,
    Undo,
    WorkDone,
)
from tests.support.lab import CLIENT, REPOSITORY, request

REGISTRY, ME, ELSEWHERE = "http://here/registry", "http://here/washer", "http://there/washer"
PROFILE = Profile(
    name="Washer1",
    type="Washer",
    capabilities=(
        Capability(type="WashObject", method="wash", undoable=True),
        Capability(type="WashObject", method="scrub"),
        Capability(type="DryObject", method="dry"),
    ),
)
ARRANGE = frp.Arrange(
    service_type="WashObject", inputs={"Object": "Jar1"}, effect="?Object isOn ?Provider", precondition="Jar1 isOn Table1"
)
EXECUTE = frp.Execute(inputs={})
NOW = 100.0


class Bench:
    """A Service Manager that is up, and the coordinator of one step of it."""

    def __init__(self, participant: str = "Washer1.WashObject#s1", profile: Profile = PROFILE) -> None:
        self.manager = ServiceManager(profile, repository=REPOSITORY, registry=REGISTRY)
        self.manager.handle(Started(ME), 0.0)
        self.participant = participant
        self.session = self.another(participant)
        self.now = NOW

    @staticmethod
    def another(participant: str) -> CoordinatorSession:
        return CoordinatorSession(transaction="t1", participant=participant, me=CLIENT, peer=ME)

    def hear(self, message: Message) -> list[Effect]:
        """What the Service Manager does about a message; the coordinator hears its answers."""
        return self._heard(self.manager.handle(Received(message), self.now))

    def ask(self, body: CoordinatorBody) -> list[Effect]:
        return self.hear(self.session.send(body))

    def did(self, activity: Activity, answer: Answer) -> list[Effect]:
        return self._heard(self.manager.handle(Answered(self.wanted(activity), answer), self.now))

    def ring(self, timer: TermsDue | StartDue | HeartbeatDue) -> list[Effect]:
        return self._heard(self.manager.handle(TimerFired(timer), self.now))

    def wanted(self, activity: Activity) -> WorkWanted:
        return WorkWanted("t1", self.participant, activity)

    def offered(self, **order: float) -> frp.Terms | frp.Refuse:
        self.ask(msgspec.structs.replace(ARRANGE, **order))
        [said] = bodies(self.did(Activity.QUOTE, Quoted(price=2.0, duration=60.0)))
        assert isinstance(said, frp.Terms | frp.Refuse)
        return said

    def committed(self, **order: float) -> list[Effect]:
        self.offered(**order)
        return self.hear(self.session.accept())

    def executing(self) -> list[Effect]:
        self.committed()
        return self.ask(EXECUTE)

    def completed(self) -> list[Effect]:
        self.executing()
        return self.did(Activity.PERFORM, WorkDone())

    @property
    def state(self) -> State:
        return self.manager.state_of("t1", self.participant)

    def _heard(self, effects: list[Effect]) -> list[Effect]:
        for effect in effects:
            if isinstance(effect, Send) and effect.message.header.participant == self.session.participant:
                self.session.receive(effect.message)
        return effects


def bodies(effects: list[Effect]) -> list[object]:
    return [effect.message.body for effect in effects if isinstance(effect, Send)]


def until(effects: list[Effect]) -> list[float | None]:
    return [effect.expires_at for effect in effects if isinstance(effect, Send)]


def rest(effects: list[Effect]) -> list[Effect]:
    return [effect for effect in effects if not isinstance(effect, Send)]


def timers(
    kind: type[TermsDue | StartDue | HeartbeatDue], participant: str = "Washer1.WashObject#s1"
) -> TermsDue | StartDue | HeartbeatDue:
    return kind("t1", participant)


def order(**changed: object) -> Order:
    plain = Order(
        transaction="t1",
        participant="Washer1.WashObject#s1",
        method="wash",
        inputs={"Object": "Jar1"},
        effect="?Object isOn ?Provider",
        precondition="Jar1 isOn Table1",
    )
    return msgspec.structs.replace(plain, **changed)


def test_an_arrange_has_the_device_quote_what_was_asked_for() -> None:
    bench = Bench()
    effects = bench.ask(msgspec.structs.replace(ARRANGE, earliest_start=120.0, latest_finish=900.0))
    assert effects == [Ask(bench.wanted(Activity.QUOTE), Quote(order(earliest_start=120.0, latest_finish=900.0)))]


@pytest.mark.parametrize(
    ("participant", "service_type", "method"),
    [
        ("Washer1.DryObject#s1", "DryObject", "dry"),
        ("Washer1.DryObject#s1", "WashObject", "dry"),
        ("Washer2.Unknown#s1", "DryObject", "dry"),
        ("Washer2.Unknown#s1", "WashObject", "wash"),
        ("Washer2.Unknown#s1", "Fly", None),
    ],
)
def test_the_service_that_the_participant_is_one_of_comes_before_those_of_the_type(
    participant: str, service_type: str, method: str | None
) -> None:
    effects = Bench(participant).ask(msgspec.structs.replace(ARRANGE, service_type=service_type))
    assert [one.task.order.method for one in effects if isinstance(one, Ask) and isinstance(one.task, Quote)] == [method] * (
        method is not None
    )


def test_terms_say_what_was_quoted_and_when_it_is_possible() -> None:
    bench = Bench()
    bench.ask(msgspec.structs.replace(ARRANGE, latest_finish=900.0))
    effects = bench.did(Activity.QUOTE, Quoted(price=2.0, currency="PLN", duration=60.0))
    terms = frp.Terms(
        effect="Jar1 isOn Washer1",
        precondition="Jar1 isOn Table1",
        price=2.0,
        currency="PLN",
        duration=60.0,
        start_from=NOW,
        start_until=840.0,
        valid_until=NOW + 120.0,
    )
    assert bodies(effects) == [terms]
    assert until(effects) == [NOW + REPORT_TIME]
    assert rest(effects) == [SetTimer(timers(TermsDue), NOW + 120.0)]


@pytest.mark.parametrize(
    ("order", "start"),
    [
        ({}, NOW),
        ({"earliest_start": 0.0}, NOW),
        ({"earliest_start": NOW + 50}, NOW + 50),
        ({"latest_finish": NOW + 60}, NOW),
        ({"latest_finish": NOW + 59}, None),
    ],
)
def test_it_starts_neither_before_now_nor_before_the_earliest_start_nor_too_late(order: dict[str, float], start: float | None) -> None:
    said = Bench().offered(**order)
    assert (said.start_from if isinstance(said, frp.Terms) else None) == start
    if isinstance(said, frp.Refuse):
        assert said.reason == "Washer1 could be done 1 s after the latest finish at the earliest"


@pytest.mark.parametrize(
    ("answer", "reason"),
    [(Refused("too big"), "too big"), (Failure("no water"), str(Failure("no water"))), (None, "None")],
)
def test_whatever_else_a_quote_comes_to_is_refused_with_it(answer: Answer, reason: str) -> None:
    bench = Bench()
    bench.ask(ARRANGE)
    effects = bench.did(Activity.QUOTE, answer)
    assert bodies(effects) == [frp.Refuse(reason=reason)]
    assert rest(effects) == []
    assert (bench.state, bench.manager.state.jobs.live) == (State.ENDED, {})


def test_an_effect_that_cannot_be_read_is_refused_and_not_fatal() -> None:
    bench = Bench()
    bench.ask(msgspec.structs.replace(ARRANGE, effect="Jar1 isOn ("))
    [said] = bodies(bench.did(Activity.QUOTE, Quoted(price=1.0, duration=1.0)))
    assert isinstance(said, frp.Refuse)
    assert bench.state is State.ENDED


def test_a_quote_that_nobody_waits_for_any_more_says_nothing() -> None:
    bench = Bench()
    bench.ask(ARRANGE)
    assert bench.did(Activity.QUOTE, Advance(fraction=0.5)) == []
    bench.ask(frp.Cancel(reason="another is cheaper"))
    assert list(bench.manager.state.jobs.live) == [("t1", bench.participant)], "the device still works it out"
    assert bench.did(Activity.QUOTE, Quoted(price=1.0, duration=1.0)) == []
    assert bench.manager.state.jobs.live == {}
    assert bench.did(Activity.QUOTE, Quoted(price=1.0, duration=1.0)) == []
    assert bench.manager.handle(Answered(WorkWanted("t1", "nobody", Activity.QUOTE), Quoted(price=1.0, duration=1.0)), NOW) == []


def test_who_accepts_has_it_wait_for_its_start_and_then_for_signs_of_life() -> None:
    bench = Bench()
    assert bench.committed(latest_finish=900.0) == [SetTimer(timers(TermsDue), None), SetTimer(timers(StartDue), 840.0)]
    assert bench.ask(EXECUTE) == [
        SetTimer(timers(StartDue), None),
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(bench.wanted(Activity.PERFORM), Perform(order(latest_finish=900.0))),
    ]


def test_an_execute_that_overtakes_its_accept_takes_both_timers_away() -> None:
    bench = Bench()
    bench.offered()
    bench.session.accept()
    assert bench.ask(EXECUTE) == [
        SetTimer(timers(TermsDue), None),
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(bench.wanted(Activity.PERFORM), Perform(order())),
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
    bench = Bench()
    bench.committed()
    assert [effect.task for effect in bench.ask(execute) if isinstance(effect, Ask)] == [Perform(order(**changed))]


@pytest.mark.parametrize(("after", "state"), [(119.0, State.COMMITTED), (120.0, State.ENDED)])
def test_an_accept_is_too_late_from_when_the_terms_expire(after: float, state: State) -> None:
    bench = Bench()
    bench.offered()
    bench.now = NOW + after
    effects = bench.hear(bench.session.accept())
    assert bench.state is state
    assert bodies(effects) == ([frp.Refuse(reason="the terms expired")] if state is State.ENDED else [])


@pytest.mark.parametrize(("late", "state"), [(0.0, State.EXECUTING), (0.5, State.FAILED)])
def test_an_execute_is_too_late_after_the_time_that_it_names(late: float, state: State) -> None:
    bench = Bench()
    bench.committed(latest_finish=900.0)
    effects = bench.ask(frp.Execute(inputs={}, begin_by=NOW - late))
    assert bench.state is state
    if late:
        assert bodies(effects) == [
            frp.Failed(
                description="Execute came 0.5 s too late to begin, and nothing was moved: "
                "a slow network, or the clocks of the two hosts do not agree",
                tried=False,
            )
        ]
        assert rest(effects) == [SetTimer(timers(StartDue), None)]


def test_what_was_done_is_reported_for_a_day() -> None:
    bench = Bench()
    bench.executing()
    effects = bench.did(Activity.PERFORM, WorkDone(situation="Jar1 isOn Washer1", outputs={"Water": 3.0}))
    assert bodies(effects) == [frp.Completed(situation="Jar1 isOn Washer1", outputs={"Water": 3.0})]
    assert until(effects) == [NOW + REPORT_TIME]
    assert rest(effects) == [SetTimer(timers(HeartbeatDue), None)]
    assert bench.manager.idle


def test_how_far_it_is_is_told_at_once_and_with_each_heartbeat() -> None:
    bench = Bench()
    bench.executing()
    effects = bench.did(Activity.PERFORM, Advance(fraction=0.25, situation="Jar1 isHeldBy Washer1", note="filling"))
    assert bodies(effects) == [frp.Progress(fraction=0.25, situation="Jar1 isHeldBy Washer1", note="filling")]
    assert until(effects) == [NOW + CUT_OFF]
    bench.now += 5.0
    effects = bench.ring(timers(HeartbeatDue))
    assert bodies(effects) == [frp.Progress(fraction=0.25)]
    assert rest(effects) == [SetTimer(timers(HeartbeatDue), NOW + 10.0)]


def test_what_waits_for_its_turn_says_so() -> None:
    bench = Bench()
    bench.executing()
    bench.participant = "Washer1.WashObject#s2"
    bench.session = bench.another(bench.participant)
    assert bench.executing() == [SetTimer(timers(HeartbeatDue, bench.participant), NOW + 5.0)]
    assert bodies(bench.ring(timers(HeartbeatDue, bench.participant))) == [frp.Progress(fraction=0.0, note="waits for its turn")]


@pytest.mark.parametrize("timer", [TermsDue, StartDue, HeartbeatDue])
def test_a_timer_that_rings_too_late_or_for_nobody_does_nothing(timer: type[TermsDue | StartDue | HeartbeatDue]) -> None:
    bench = Bench()
    bench.completed()
    assert bench.ring(timers(timer)) == []
    assert bench.ring(timer("t1", "nobody")) == []


def test_a_timer_that_rang_is_not_taken_away_once_more() -> None:
    bench = Bench()
    bench.committed(latest_finish=900.0)
    bench.now = 840.0
    effects = bench.ring(timers(StartDue))
    assert bodies(effects) == [frp.Failed(description="it was not told to start in time", tried=False)]
    assert rest(effects) == []


def test_what_is_stopped_reports_what_is_known_to_hold() -> None:
    bench = Bench()
    bench.executing()
    bench.did(Activity.PERFORM, Advance(fraction=0.5, situation="Jar1 isHeldBy Washer1"))
    assert bench.ask(frp.Stop(reason="r")) == [Withdraw(bench.wanted(Activity.PERFORM))]
    [halt] = bench.did(Activity.PERFORM, None)
    assert isinstance(halt, Ask)
    assert halt.question == bench.wanted(Activity.HALT)
    assert bodies(bench.did(Activity.HALT, WorkDone())) == [frp.Stopped(situation="Jar1 isHeldBy Washer1")]


def test_what_is_undone_is_undone_to_what_is_wanted_now() -> None:
    bench = Bench()
    bench.executing()
    bench.did(Activity.PERFORM, WorkDone(situation="Jar1 isOn Washer1"))
    assert bench.ask(frp.Compensate(situation="Jar1 isOn Table1")) == [
        SetTimer(timers(HeartbeatDue), NOW + 5.0),
        Ask(bench.wanted(Activity.UNDO), Undo(order(), "Jar1 isOn Table1")),
    ]
    assert bodies(bench.did(Activity.UNDO, WorkDone())) == [frp.Compensated(situation="Jar1 isOn Table1")]


def test_what_fails_and_then_cannot_be_undone_says_both() -> None:
    bench = Bench()
    bench.executing()
    assert bodies(bench.did(Activity.PERFORM, Failure("the pump is dry"))) == [frp.Failed(description="the pump is dry")]
    bench.ask(frp.Compensate(situation="Jar1 isOn Table1"))
    bench.did(Activity.UNDO, AnswerLost())
    assert bodies(bench.did(Activity.HALT, WorkDone())) == [
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
            "Compensate came 2.0 s too late to begin, and nothing was moved: a slow network, or the clocks of the two hosts do not agree",
        ),
    ],
)
def test_what_cannot_be_undone_is_left_to_others(participant: str, service_type: str, begin_by: float | None, reason: str) -> None:
    bench = Bench(participant)
    bench.ask(msgspec.structs.replace(ARRANGE, service_type=service_type))
    bench.did(Activity.QUOTE, Quoted(price=2.0, duration=60.0))
    bench.hear(bench.session.accept())
    bench.ask(EXECUTE)
    bench.did(Activity.PERFORM, WorkDone())
    effects = bench.ask(frp.Compensate(situation="Jar1 isOn Table1", begin_by=begin_by))
    assert bodies(effects) == [frp.Stranded(description=reason, tried=False)]
    assert rest(effects) == []


def test_who_is_equipped_without_what_it_did_cannot_undo_it() -> None:
    bench = Bench()
    bench.completed()
    bench.manager.handle(Notified(Equipped(msgspec.structs.replace(PROFILE, capabilities=PROFILE.capabilities[2:]), "r", "s")), NOW)
    joining = bench.manager.state.joining
    assert (joining.profile.capabilities, joining.repository, joining.registry) == (PROFILE.capabilities[2:], "r", "s")
    said = bodies(bench.ask(frp.Compensate(situation="Jar1 isOn Table1")))
    assert said == [frp.Stranded(description="Washer1 cannot undo what it does not know", tried=False)]


def test_only_a_sign_of_life_that_does_not_arrive_stops_the_work() -> None:
    bench = Bench()
    bench.executing()
    [progress] = [e for e in bench.did(Activity.PERFORM, Advance(fraction=0.5)) if isinstance(e, Send)]
    header = progress.message.header
    assert bench.manager.handle(DeliveryFailed(Message(header=header, body=frp.Terms(effect="", price=0, duration=0)), "r"), NOW) == []
    unknown = msgspec.structs.replace(header, participant="nobody")
    assert bench.manager.handle(DeliveryFailed(Message(header=unknown, body=progress.message.body), "r"), NOW) == []
    assert bench.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == [Withdraw(bench.wanted(Activity.PERFORM))]
    assert bench.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == [], "it is being stopped"


def test_what_is_over_does_not_care_whether_its_signs_of_life_arrived() -> None:
    bench = Bench()
    bench.executing()
    [progress] = [e for e in bench.did(Activity.PERFORM, Advance(fraction=0.5)) if isinstance(e, Send)]
    bench.did(Activity.PERFORM, WorkDone())
    assert bench.manager.handle(DeliveryFailed(progress.message, "r"), NOW) == []


def test_who_ends_it_in_the_middle_has_no_timers_left() -> None:
    bench = Bench()
    bench.executing()
    header = bench.session._repeat("Execute")[0].header
    end = Message(header=msgspec.structs.replace(header, message_id="urn:uuid:end"), body=frp.End(outcome=frp.Outcome.CANCELLED))
    assert bench.hear(end) == [SetTimer(timers(HeartbeatDue), None), Withdraw(bench.wanted(Activity.PERFORM))]


def test_who_ends_what_is_done_has_nothing_interrupted() -> None:
    bench = Bench()
    bench.completed()
    assert bench.ask(frp.End(outcome=frp.Outcome.ACCOMPLISHED)) == []


@pytest.mark.parametrize(("reply_to", "expected"), [(CLIENT, NOW + REPORT_TIME), (ANONYMOUS, None)])
def test_answers_to_who_cannot_be_called_are_not_sent_again(reply_to: str, expected: float | None) -> None:
    bench = Bench()
    bench.executing()
    query = bench.session.send(frp.Query())
    effects = bench.hear(Message(header=msgspec.structs.replace(query.header, reply_to=reply_to), body=frp.Query()))
    assert bodies(effects) == [frp.Status(state=State.EXECUTING, last_message=bench.session.terms_id)]
    assert until(effects) == [expected]


@pytest.mark.parametrize("header", [{"participant": "p"}, {"transaction": "t"}])
def test_a_message_outside_any_contract_is_faulted_unless_it_is_a_fault(header: dict[str, str]) -> None:
    bench = Bench()
    message = request(EXECUTE, to=ME)
    message = Message(header=msgspec.structs.replace(message.header, **header), body=EXECUTE)
    assert bodies(bench.hear(message)) == [frp.Fault(code=NOT_ALLOWED, text="Execute needs a transaction and a participant in its header")]
    assert bench.hear(Message(header=message.header, body=frp.Fault(code="c", text="t"))) == []


def test_when_it_is_busy_and_with_what() -> None:
    bench = Bench()
    assert (bench.manager.open, bench.manager.calendar(NOW), bench.manager.idle) == ([], [], True)
    bench.offered(earliest_start=NOW + 50)
    assert (bench.manager.open, bench.manager.calendar(NOW)) == ([], []), "an offer binds nobody"
    bench.hear(bench.session.accept())
    assert bench.manager.open == ["Washer1.WashObject#s1 in t1"]
    assert bench.manager.calendar(NOW) == [(NOW + 50, NOW + 110)]
    assert bench.manager.calendar(NOW + 70) == [(NOW + 70, NOW + 130)], "what is overdue starts now"
    bench.now = NOW + 80
    bench.ask(EXECUTE)
    assert not bench.manager.idle
    assert bench.manager.calendar(NOW + 90) == [(NOW + 80, NOW + 140)]
    assert bench.manager.calendar(NOW + 200) == [(NOW + 80, NOW + 200)], "what is overdue ends now"
    bench.did(Activity.PERFORM, WorkDone())
    assert (bench.manager.open, bench.manager.calendar(NOW + 90), bench.manager.idle) == ([], [], True)


@pytest.mark.parametrize(("address", "again"), [(ME, False), (ELSEWHERE, True)])
def test_who_comes_up_elsewhere_says_its_last_word_from_there(address: str, again: bool) -> None:
    bench = Bench()
    said = [effect.message for effect in bench.completed() if isinstance(effect, Send)]
    sent = [effect for effect in bench.manager.handle(Started(address), NOW + 1) if isinstance(effect, Send)]
    mine = [effect for effect in sent if effect.message.header.participant is not None]
    assert mine == [
        Send(
            msgspec.structs.replace(one, header=msgspec.structs.replace(one.header, sender=address, reply_to=address)),
            NOW + 1 + REPORT_TIME,
        )
        for one in said * again
    ]
    assert bench.manager.address == address


def test_who_leaves_refuses_what_comes_until_it_starts_again() -> None:
    bench = Bench()
    bench.manager.handle(Notified(DepartureRequested()), NOW)
    assert bodies(bench.ask(ARRANGE)) == [frp.Refuse(reason="Washer1 is leaving")]
    bench.manager.handle(Started(ME), NOW)
    bench.session = bench.another("Washer1.WashObject#s2")
    assert bodies(bench.ask(ARRANGE)) == []


def test_a_state_that_nobody_heard_of_is_new() -> None:
    assert Bench().state is State.NEW


# What the device leaves and notices


def on_the_map(bench: Bench) -> None:
    """From now on its reports are sent."""
    reports = bench.manager.state.reports
    assert [*reports.start(NOW)] == []


def reported(effects: list[Effect]) -> list[tuple[str, str, float | None]]:
    """The situations that the Repository is told, by whom, and until when that is tried."""
    sends = [effect for effect in effects if isinstance(effect, Send)]
    return [
        (one.message.body.situation or "", one.message.body.author, one.expires_at)
        for one in sends
        if isinstance(one.message.body, UpdateMap)
    ]


def test_what_is_noticed_is_reported_one_after_the_other() -> None:
    bench = Bench()
    on_the_map(bench)
    first, timer = bench.manager.handle(Notified(Observed("A isOn B")), NOW)
    assert reported([first]) == [("A isOn B", "Washer1", NOW + 10.0)]
    assert timer == SetTimer(ReportDue(), NOW + 15.0)
    assert bench.manager.handle(Notified(Observed("A isOn C")), NOW + 1) == []
    assert isinstance(first, Send)
    assert (first.message.header.sender, first.message.header.recipient, first.message.header.reply_to) == (ME, REPOSITORY, ME)
    for again in (DeliveryFailed(first.message, "r"), TimerFired(ReportDue())):
        assert reported(bench.manager.handle(again, NOW + 2)) == [("A isOn B", "Washer1", NOW + 12.0)]
    gone, second, later = bench.manager.handle(Received(reply(first.message, Updated(version=1), REPOSITORY)), NOW + 3)
    assert (gone, reported([second]), later) == (
        SetTimer(ReportDue(), None),
        [("A isOn C", "Washer1", NOW + 13.0)],
        SetTimer(ReportDue(), NOW + 18.0),
    )


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (Rejected(problems=("no A", "no B"), version=1), "no A; no B"),
        (frp.Fault(code="Sender", text="no formula"), "no formula"),
    ],
)
def test_what_the_repository_does_not_take_is_told_to_a_person(answer: Rejected | frp.Fault, why: str) -> None:
    bench = Bench()
    on_the_map(bench)
    [first] = [one for one in bench.manager.handle(Notified(Observed("A isOn B")), NOW) if isinstance(one, Send)]
    assert bench.manager.handle(Received(reply(first.message, answer, REPOSITORY)), NOW) == [
        SetTimer(ReportDue(), None),
        Ask(ReportWanted(), Report(f"the Repository does not take A isOn B from Washer1: {why}")),
    ]


def test_what_waits_at_a_restart_is_given_up_with_its_reason() -> None:
    bench = Bench()
    bench.executing()
    bench.participant = "Washer1.WashObject#s2"
    bench.session = bench.another(bench.participant)
    bench.executing()
    said = [body for body in bodies(bench.manager.handle(Started(ME), NOW + 1)) if isinstance(body, frp.Failed)]
    assert said == [frp.Failed(description="the Service Manager of Washer1 was restarted while it worked")]
    assert bench.state is State.FAILED


def test_what_is_offered_is_named_to_who_wants_something_else() -> None:
    effects = Bench("Washer2.Fly#s1").ask(msgspec.structs.replace(ARRANGE, service_type="Fly"))
    assert bodies(effects) == [frp.Refuse(reason="Washer1 offers WashObject, WashObject, DryObject, and not Fly")]


@pytest.mark.parametrize(
    ("over", "left", "told"),
    [
        (True, "Jar1 isOn Floor1", [("Jar1 isOn Floor1", "Washer1.WashObject", NOW + 10.0)]),
        (True, None, []),
        (False, "Jar1 isOn Floor1", []),
    ],
)
def test_what_the_device_left_is_told_to_the_repository_when_nobody_waits_to_hear_of_it(
    over: bool, left: str | None, told: list[tuple[str, str, float | None]]
) -> None:
    bench = Bench()
    on_the_map(bench)
    bench.executing()
    if over:
        bench.session.state = State.COMPLETED  # the coordinator has given it up
    bench.ask(frp.End(outcome=frp.Outcome.FAILED) if over else frp.Stop(reason="r"))
    bench.did(Activity.PERFORM, None)
    effects = bench.did(Activity.HALT, WorkDone(situation=left))
    assert reported(effects) == told
    assert [body for body in bodies(effects) if not isinstance(body, UpdateMap)] == ([] if over else [frp.Stopped(situation=left)])
    assert bench.manager.idle


def test_an_answer_to_what_the_device_does_not_do_now_changes_nothing() -> None:
    bench = Bench()
    bench.executing()
    for activity in (Activity.UNDO, Activity.HALT):
        assert bench.did(activity, Failure("f")) == []
    stranger = Answered(WorkWanted("t1", "nobody", Activity.PERFORM), WorkDone())
    assert bench.manager.handle(stranger, NOW) == []
    assert (bench.state, bench.manager.idle) == (State.EXECUTING, False)
    assert bodies(bench.did(Activity.PERFORM, WorkDone())) == [frp.Completed(situation="")]
    assert bench.did(Activity.PERFORM, WorkDone()) == bench.manager.handle(stranger, NOW) == []
    assert (bench.state, bench.manager.idle) == (State.COMPLETED, True)
