"""What a preview asks of services, and what it tells its client that a task would come to."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, ErrorAnswer, Received, Send, SetTimer
from somrs.planner.model.plan import Link, NoPlan, Obstacle, Plan, Step
from somrs.protocol.messages import frp, previews, submission
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.previews import Preview, Previewed, Quotation
from somrs.protocol.messages.submission import Policy, Submit
from somrs.protocol.messages.task_views import StepView
from somrs.protocol.messages.waits import Holder, WaitsForTasks
from somrs.task_manager.execution.member import Member
from somrs.task_manager.preview import MOST_ROUNDS, PREVIEW_ONLY, REPLY_TIME
from somrs.task_manager.preview_state import PreviewState
from somrs.task_manager.timers import BidsDue, DiscoveryDue, PlanWanted, PreviewDue, Timer
from tests.unit.task_manager.test_manager import answers
from tests.unit.task_manager.transaction.test_participant_events import FIRST_SERVICE, GOAL, SECOND_SERVICE, TaskManagerHarness, bodies

NO_ANSWER = "has not answered yet"
NO_TIME = "was not asked: there was no time left"


def move(id: str, object: str) -> Step:
    return Step(id, "TransferObject", {"Object": Name(object), "Destination": Name("Platform001")}, parse(f"{object} isOn Platform001"))


CHAIN = Plan((move("a", "Jar001"), move("b", "Tin001")), (Link("a", "b", "Jar001 isOn Platform001"),))
APART = Plan((move("a", "Jar001"), move("b", "Tin001")))


class PreviewHarness:
    """A preview at the desk of a Task Manager whose one task is over, unless it is `under_way`."""

    def __init__(self, harness: TaskManagerHarness, now: float = 10.0, *, under_way: bool = False, **options: object) -> None:
        self.harness = harness
        if not under_way:
            harness.client_says(submission.CancelTask(task=harness.task.id), 5.0)
        query = Preview(**{"effect": GOAL, "quotes": True, **options})  # type: ignore[arg-type]  # fields of Preview
        self.effects = harness.client_says(query, now)

    @property
    def state(self) -> PreviewState:
        (state,) = self.harness.manager.state.previews.values()
        return state

    def member(self, service: str = FIRST_SERVICE, label: str = "") -> Member:
        """The one of that service that was asked last, or for that step."""
        members = [member for member in self.state.members if member.offer.service == service and (not label or member.label == label)]
        return members[-1]

    def service_says(self, body: FrpBody, now: float, service: str = FIRST_SERVICE, label: str = "") -> list[Effect]:
        self.harness.message_count += 1
        member = self.member(service, label)
        header = Header(
            sender=member.offer.address,
            recipient="tm",
            message_id=f"said {self.harness.message_count}",
            reply_to=member.offer.address,
            relates_to=member.session.sent_messages["Arrange"].id,
            transaction=self.state.id,
            participant=member.id,
        )
        return self.harness.feed(Received(Message(header=header, body=body)), now)

    def offers(self, now: float, service: str = FIRST_SERVICE, label: str = "", *, price: float = 10.0, **options: object) -> list[Effect]:
        terms = frp.Terms(**{"effect": GOAL, "price": price, "duration": 60.0, **options})  # type: ignore[arg-type]  # fields of Terms
        return self.service_says(terms, now, service, label)

    def rings(self, timer: Timer, now: float) -> list[Effect]:
        return self.harness.rings(timer, now)


def client_reply(effects: list[Effect]) -> Previewed:
    """The one thing that the client was told."""
    (body,) = answers(effects)
    assert isinstance(body, Previewed)
    return body


def timer_times(effects: list[Effect]) -> list[tuple[str, float | None]]:
    """The preview's own timers, as they were set."""
    return [
        (type(effect.timer).__name__, effect.at)
        for effect in effects
        if isinstance(effect, SetTimer) and isinstance(effect.timer, PreviewDue | BidsDue)
    ]


def sent_bodies(effects: list[Effect]) -> list[FrpBody]:
    return [effect.message.body for effect in effects if isinstance(effect, Send) and isinstance(effect.message.body, FrpBody)]


def quoted(answer: Previewed) -> list[tuple[str, str, float | None, bool, bool, str]]:
    return [
        (quotation.step, quotation.service, quotation.price, quotation.chosen, quotation.estimate, quotation.reason)
        for quotation in answer.quotations
    ]


def test_services_are_asked_and_the_best_is_taken_on_paper() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"), policy=Policy.TIME)
    assert [body for body in sent_bodies(preview.effects) if isinstance(body, frp.Arrange)] == [
        frp.Arrange(
            service_type="TransferObject",
            inputs={"Object": "Jar002", "Destination": "Platform001"},
            effect=GOAL,
            precondition="Jar002 isOn Cupboard001 AND Platform001.Supporting = TRUE",
            earliest_start=10.0,
            latest_finish=None,
            reply_by=12.0,
        )
    ] * 2
    assert timer_times(preview.effects) == [("PreviewDue", 16.0), ("BidsDue", 12.0)]
    assert preview.offers(11.0) == []
    effects = preview.offers(11.0, SECOND_SERVICE, price=20.0, duration=30.0, start_from=12.0)
    assert client_reply(effects) == Previewed(
        steps=(
            StepView(
                step="step1",
                service_type="TransferObject",
                inputs={"Object": "Jar002", "Destination": "Platform001"},
                service=SECOND_SERVICE,
                price=20.0,
                duration=30.0,
            ),
        ),
        quotations=(
            Quotation(step="step1", service=FIRST_SERVICE, price=10.0, duration=60.0, start=0.0, finish=60.0),
            Quotation(step="step1", service=SECOND_SERVICE, price=20.0, duration=30.0, start=2.0, finish=32.0, chosen=True),
        ),
        price=20.0,
        seconds=32.0,
    )
    assert [body for body in sent_bodies(effects) if isinstance(body, frp.Cancel)] == [frp.Cancel(reason=PREVIEW_ONLY)] * 2
    assert timer_times(effects) == [("BidsDue", None), ("PreviewDue", None)]
    state = preview.harness.manager.state
    assert (state.previews, preview.harness.reservations.claimants) == ({}, {})
    assert (state.quotes.prices, state.quotes.durations) == (
        {FIRST_SERVICE: 10.0, SECOND_SERVICE: 20.0},
        {FIRST_SERVICE: 60.0, SECOND_SERVICE: 30.0},
    )


def test_it_is_planned_as_the_task_would_be() -> None:
    harness = TaskManagerHarness(held=True)
    precondition = "Jar002 isOn Cupboard001 AND Platform001.Supporting = TRUE"
    preview = PreviewHarness(harness, precondition=precondition, policy=Policy.WEIGHTED, time_value=2.0, deadline=50.0, priority=7)
    assert preview.state.task == Submit(
        effect=GOAL, precondition=precondition, policy=Policy.WEIGHTED, time_value=2.0, deadline=50.0, priority=7
    )
    (ask,) = [effect for effect in preview.effects if isinstance(effect, Ask)]
    assert ask.question == PlanWanted(preview.state.id, 0, 0, 1)
    assert preview.harness.feed(Answered(PlanWanted(preview.state.id, 0, 0, 2), CHAIN), 11.0) == [], "nobody asks for that any more"
    assert bodies(harness.feed(Answered(ask.question, CHAIN), 11.0)) == ["Arrange"]
    assert harness.reservations.claimants == {}, "it only asks"


def test_what_is_stated_twice_by_one_message_is_one_preview() -> None:
    preview = PreviewHarness(TaskManagerHarness())
    request = preview.state.request
    assert request is not None
    assert preview.harness.feed(Received(request), 11.0) == []
    assert [*preview.harness.manager.state.previews] == [preview.state.id]


@pytest.mark.parametrize(
    ("plan_result", "expected"),
    [
        (Plan(), Previewed(steps=(), explanation="nothing to do: it is so already")),
        (
            NoPlan("no way", separate_reasons=("no", "way"), obstacles=(Obstacle.PROMISED,)),
            Previewed(steps=(), explanation="no way", reasons=("no", "way"), obstacles=(previews.Obstacle.PROMISED,)),
        ),
        (
            ErrorAnswer("out of memory"),
            Previewed(steps=(), explanation="planning failed: out of memory", reasons=("planning failed: out of memory",)),
        ),
    ],
)
def test_without_a_step_nobody_is_asked(plan_result: object, expected: Previewed) -> None:
    harness = TaskManagerHarness()
    harness.plan_results = [plan_result]
    preview = PreviewHarness(harness)
    assert client_reply(preview.effects) == expected
    assert timer_times(preview.effects) == [("PreviewDue", None)]
    assert harness.manager.state.previews == {}


def test_when_the_registry_cannot_say_who_is_there_the_client_hears_that() -> None:
    harness = TaskManagerHarness()
    harness.directory.version = -1
    preview = PreviewHarness(harness)
    (due,) = [effect.at for effect in preview.effects if isinstance(effect, SetTimer) and effect.timer == DiscoveryDue()]
    assert due is not None
    reason = "the Service Registry does not answer"
    (due,) = [effect.at for effect in harness.rings(DiscoveryDue(), due) if isinstance(effect, SetTimer)]
    assert due is not None
    assert client_reply(harness.rings(DiscoveryDue(), due)) == Previewed(steps=(), explanation=reason, reasons=(reason,))


def test_without_quotes_the_plan_is_told_and_nobody_is_asked() -> None:
    preview = PreviewHarness(TaskManagerHarness(), quotes=False)
    step = StepView(step="step1", service_type="TransferObject", inputs={"Object": "Jar002", "Destination": "Platform001"})
    assert client_reply(preview.effects) == Previewed(steps=(step,))
    assert "Arrange" not in bodies(preview.effects)


@pytest.mark.parametrize("quotes", [True, False])
def test_who_has_what_it_needs_is_told_of(quotes: bool) -> None:
    harness = TaskManagerHarness()
    preview = PreviewHarness(harness, under_way=True, effect="Jar002 isOn Cupboard002", quotes=quotes)
    answer = client_reply(preview.offers(11.0) if quotes else preview.effects)
    assert answer.waits == f"waiting for task {short_id(harness.task.id)} ({GOAL}), which has reserved Jar002"
    assert answer.waiting_for == WaitsForTasks.on((Holder(task=harness.task.id, goal=GOAL, objects=("Jar002",)),))
    assert (len(answer.steps), answer.price) == (1, 10.0 if quotes else None)


def test_steps_are_asked_for_on_what_those_before_promise() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.plan_results = [CHAIN]
    preview = PreviewHarness(harness, deadline=200.0)
    assert [(member.label, member.offer.service) for member in preview.state.members] == [("a", FIRST_SERVICE), ("a", SECOND_SERVICE)]
    preview.service_says(frp.Refuse(reason="too heavy"), 11.0, SECOND_SERVICE)
    effects = preview.offers(11.0)
    arrange_bodies = [body for body in sent_bodies(effects) if isinstance(body, frp.Arrange)]
    assert [(body.effect, body.earliest_start, body.latest_finish, body.reply_by) for body in arrange_bodies] == [
        ("Tin001 isOn Platform001", 70.0, 210.0, 13.0)
    ] * 2
    preview.offers(12.0, price=5.0)
    answer = client_reply(preview.offers(12.0, SECOND_SERVICE, price=2.5, duration=10.0))
    assert quoted(answer) == [
        ("a", FIRST_SERVICE, 10.0, True, False, ""),
        ("a", SECOND_SERVICE, None, False, False, "too heavy"),
        ("b", FIRST_SERVICE, 5.0, False, False, ""),
        ("b", SECOND_SERVICE, 2.5, True, False, ""),
    ]
    assert [(quotation.start, quotation.finish) for quotation in answer.quotations] == [
        (0.0, 60.0),
        (None, None),
        (60.0, 120.0),
        (60.0, 70.0),
    ]
    assert (answer.price, answer.currency, answer.seconds, answer.estimate, answer.unserved) == (12.5, "EUR", 70.0, False, {})
    assert [(step.step, step.service, step.price, step.duration, step.after) for step in answer.steps] == [
        ("a", FIRST_SERVICE, 10.0, 60.0, ()),
        ("b", SECOND_SERVICE, 2.5, 10.0, ("a",)),
    ]


@pytest.mark.parametrize(
    ("currencies", "price", "currency"),
    [(("EUR", "EUR"), 20.0, "EUR"), (("PLN", "PLN"), 20.0, "PLN"), (("PLN", "CHF"), None, "CHF")],
)
def test_one_price_is_told_where_all_is_in_one_currency(currencies: tuple[str, str], price: float | None, currency: str) -> None:
    harness = TaskManagerHarness()
    harness.plan_results = [APART]
    preview = PreviewHarness(harness)
    preview.offers(11.0, label="a", currency=currencies[0])
    answer = client_reply(preview.offers(11.0, label="b", currency=currencies[1]))
    assert (answer.price, answer.currency, answer.seconds) == (price, currency, 120.0), "one device does one thing after the other"
    assert [(quotation.start, quotation.finish, quotation.currency) for quotation in answer.quotations] == [
        (0.0, 60.0, currencies[0]),
        (60.0, 120.0, currencies[1]),
    ]


@pytest.mark.parametrize(("deadline", "chosen"), [(60.0, True), (59.0, False), (None, True)])
def test_who_would_be_done_too_late_is_not_taken(deadline: float | None, chosen: bool) -> None:
    preview = PreviewHarness(TaskManagerHarness(), deadline=deadline)
    answer = client_reply(preview.offers(11.0))
    assert quoted(answer) == [("step1", FIRST_SERVICE, 10.0, chosen, False, "")]
    assert answer.unserved == ({} if chosen else {"step1": "no service would finish in time"})
    assert (answer.price, answer.seconds) == ((10.0, 60.0) if chosen else (None, None))


def test_what_devices_are_committed_to_comes_first() -> None:
    harness = TaskManagerHarness()
    harness.executing()
    answer = client_reply(PreviewHarness(harness, under_way=True, effect="Jar001 isOn Platform001").offers(11.0))
    assert [(quotation.start, quotation.finish) for quotation in answer.quotations] == [(50.0, 110.0)]
    assert answer.waits == ""


@pytest.mark.parametrize(
    "body", [frp.Refuse(reason="too heavy"), frp.Fault(code="env:Receiver", text="too heavy")], ids=["refuse", "fault"]
)
def test_who_gives_no_terms_says_why(body: FrpBody) -> None:
    answer = client_reply(PreviewHarness(TaskManagerHarness()).service_says(body, 11.0))
    assert quoted(answer) == [("step1", FIRST_SERVICE, None, False, False, "too heavy")]
    assert answer.unserved == {"step1": f"no service takes it ({FIRST_SERVICE}: too heavy)"}
    assert (answer.price, answer.seconds, answer.estimate, len(answer.steps)) == (None, None, False, 1)


def test_all_who_give_no_terms_are_named() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"))
    preview.service_says(frp.Refuse(reason="too heavy"), 11.0)
    answer = client_reply(preview.service_says(frp.Refuse(reason="too far"), 11.0, SECOND_SERVICE))
    assert answer.unserved == {"step1": f"no service takes it ({FIRST_SERVICE}: too heavy; {SECOND_SERVICE}: too far)"}


def test_who_cannot_be_reached_gives_no_terms() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"))
    (first, second) = [
        effect.message for effect in preview.effects if isinstance(effect, Send) and isinstance(effect.message.body, frp.Arrange)
    ]
    assert bodies(preview.harness.feed(DeliveryFailed(first, "no route"), 11.0)) == ["Cancel"]
    answer = client_reply(preview.harness.feed(DeliveryFailed(second, "no power"), 11.0))
    assert [reason for *_, reason in quoted(answer)] == ["could not be reached: no route", "could not be reached: no power"]


def test_a_step_that_nobody_offers_holds_up_no_other() -> None:
    harness = TaskManagerHarness()
    harness.plan_results, harness.offers = [CHAIN], ()
    effects = PreviewHarness(harness).effects
    assert client_reply(effects).unserved == {"a": "no device offers it", "b": "no device offers it"}
    assert timer_times(effects) == [("PreviewDue", 16.0), ("PreviewDue", None)]


def test_who_does_not_answer_in_time_is_put_down_with_what_it_asked_last() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.manager.state.quotes.record_quote(FIRST_SERVICE, 8.0, 40.0)
    preview = PreviewHarness(harness)
    assert preview.rings(BidsDue(preview.state.id, 0), 11.9) == [SetTimer(BidsDue(preview.state.id, 0), 12.0)]
    effects = preview.rings(BidsDue(preview.state.id, 0), 12.0)
    answer = client_reply(effects)
    assert quoted(answer) == [
        ("step1", FIRST_SERVICE, 8.0, True, True, NO_ANSWER),
        ("step1", SECOND_SERVICE, None, False, False, NO_ANSWER),
    ]
    assert [(quotation.start, quotation.finish, quotation.duration) for quotation in answer.quotations] == [
        (2.0, 42.0, 40.0),
        (None, None, None),
    ]
    assert (answer.price, answer.seconds, answer.estimate, answer.unserved) == (8.0, 42.0, True, {})
    assert bodies(effects) == ["Cancel", "Cancel", "Previewed"]


def test_who_gave_terms_is_taken_when_the_others_do_not_answer_in_time() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"))
    preview.offers(11.0, SECOND_SERVICE, price=30.0)
    answer = client_reply(preview.rings(BidsDue(preview.state.id, 0), 12.0))
    assert quoted(answer) == [("step1", FIRST_SERVICE, None, False, False, NO_ANSWER), ("step1", SECOND_SERVICE, 30.0, True, False, "")]
    assert (answer.price, answer.estimate) == (30.0, False)


def test_an_estimate_that_is_not_chosen_makes_no_estimate_of_the_whole() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.manager.state.quotes.record_quote(FIRST_SERVICE, 80.0, 40.0)
    preview = PreviewHarness(harness)
    preview.offers(11.0, SECOND_SERVICE, price=30.0)
    answer = client_reply(preview.rings(BidsDue(preview.state.id, 0), 12.0))
    assert quoted(answer) == [("step1", FIRST_SERVICE, 80.0, False, True, NO_ANSWER), ("step1", SECOND_SERVICE, 30.0, True, False, "")]
    assert answer.estimate is False


def test_what_could_not_be_asked_in_time_is_put_down_with_what_services_asked_last() -> None:
    harness = TaskManagerHarness("Robot1", "Robot2")
    harness.plan_results = [CHAIN]
    harness.manager.state.quotes.record_quote(SECOND_SERVICE, 8.0, 40.0)
    preview = PreviewHarness(harness)
    effects = preview.rings(PreviewDue(preview.state.id), 10.0 + MOST_ROUNDS * REPLY_TIME)
    answer = client_reply(effects)
    assert quoted(answer) == [
        ("a", FIRST_SERVICE, None, False, False, NO_ANSWER),
        ("a", SECOND_SERVICE, 8.0, True, True, NO_ANSWER),
        ("b", FIRST_SERVICE, None, False, False, NO_TIME),
        ("b", SECOND_SERVICE, 8.0, True, True, NO_TIME),
    ]
    assert [(quotation.start, quotation.finish) for quotation in answer.quotations if quotation.chosen] == [(6.0, 46.0), (46.0, 86.0)]
    assert (answer.price, answer.seconds, answer.estimate) == (16.0, 86.0, True)
    assert bodies(effects) == ["Cancel", "Cancel", "Previewed"], "who was not asked is not sent home"


def test_when_nothing_is_known_of_anybody_every_step_says_so() -> None:
    harness = TaskManagerHarness()
    harness.plan_results = [CHAIN]
    preview = PreviewHarness(harness)
    answer = client_reply(preview.rings(PreviewDue(preview.state.id), 16.0))
    assert answer.unserved == {
        "a": f"no service takes it ({FIRST_SERVICE}: {NO_ANSWER})",
        "b": f"no service takes it ({FIRST_SERVICE}: {NO_TIME})",
    }
    assert [step.service for step in answer.steps] == [None, None]


def test_what_comes_after_the_end_is_answered_with_a_farewell_and_no_more() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"))
    member, id = preview.member(SECOND_SERVICE), preview.state.id
    client_reply(preview.rings(BidsDue(id, 0), 12.0))
    header = Header(sender="Robot2", recipient="tm", message_id="late", reply_to="Robot2", transaction=id, participant=member.id)
    late = preview.harness.feed(Received(Message(header=header, body=frp.Terms(effect=GOAL, price=1.0, duration=1.0))), 13.0)
    assert bodies(late) == ["Cancel"]
    for timer in (BidsDue(id, 0), PreviewDue(id)):
        assert preview.rings(timer, 16.0) == []


def test_what_says_nothing_new_changes_nothing() -> None:
    preview = PreviewHarness(TaskManagerHarness("Robot1", "Robot2"))
    preview.offers(11.0)
    bid_before = preview.member().bid
    preview.offers(11.5, price=99.0)
    assert preview.member().bid == bid_before
    assert preview.harness.manager.state.quotes.prices == {FIRST_SERVICE: 10.0}


def test_no_more_than_so_many_steps_are_asked_for_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.preview.MAX_OPEN_CALLS", 2)
    harness = TaskManagerHarness()
    harness.plan_results = [Plan((*APART.steps, move("c", "Jar002")))]
    preview = PreviewHarness(harness)
    assert [member.label for member in preview.state.members] == ["a", "b"]
    assert bodies(preview.offers(11.0, label="a")) == ["Cancel", "Arrange"]
    assert [member.label for member in preview.state.members] == ["a", "b", "c"]
    assert preview.offers(12.0, label="c")[-1:] != []
    assert client_reply(preview.offers(12.0, label="b")).price == 30.0


def test_what_comes_behind_a_step_that_nobody_takes_is_asked_for_as_if_it_took_no_time() -> None:
    harness = TaskManagerHarness()
    harness.plan_results = [Plan((*CHAIN.steps, move("c", "Jar002")), (*CHAIN.links, Link("b", "c", "")))]
    preview = PreviewHarness(harness)
    preview.offers(11.0)
    (arrange,) = [body for body in sent_bodies(preview.service_says(frp.Refuse(reason="no"), 12.0)) if isinstance(body, frp.Arrange)]
    assert (arrange.effect, arrange.earliest_start) == (GOAL, 70.0)
    assert client_reply(preview.offers(13.0)).unserved == {"b": f"no service takes it ({FIRST_SERVICE}: no)"}
