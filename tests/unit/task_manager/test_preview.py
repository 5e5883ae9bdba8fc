"""What a preview asks of services, and what it tells its client that a task would come to."""

from __future__ import annotations

import pytest

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, ErrorAnswer, Received, Send, SetTimer
from somrs.planner.model.plan import Link, NoPlan, Obstacle, Plan, Step
from somrs.protocol.messages import clients, frp
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.clients import Policy, Preview, Previewed, Quotation, StepView, Submit
from somrs.protocol.messages.envelope import Header, Message
from somrs.task_manager.execution.member import Member
from somrs.task_manager.preview import MOST_TIME, PREVIEW_ONLY, PreviewState
from somrs.task_manager.timers import BidsDue, PlanWanted, PreviewDue, Timer
from tests.unit.task_manager.test_manager import answers
from tests.unit.task_manager.transaction.test_participant_events import ONE, TWO, WISH, Desk, bodies

MUTE = "did not answer within 2 s"
LEFT = "was not asked: there was no time left"


def move(id: str, object: str) -> Step:
    return Step(id, "TransferObject", {"Object": Name(object), "Destination": Name("Platform001")}, parse(f"{object} isOn Platform001"))


CHAIN = Plan((move("a", "Jar001"), move("b", "Tin001")), (Link("a", "b", "Jar001 isOn Platform001"),))
APART = Plan((move("a", "Jar001"), move("b", "Tin001")))


class Inquiry:
    """A preview at the desk of a Task Manager whose one task is over, unless it is `under_way`."""

    def __init__(self, desk: Desk, now: float = 10.0, *, under_way: bool = False, **wanted: object) -> None:
        self.desk = desk
        if not under_way:
            desk.says_client(clients.CancelTask(task=desk.task.id), 5.0)
        wish = Preview(**{"effect": WISH, "quotes": True, **wanted})  # type: ignore[arg-type]  # fields of Preview
        self.effects = desk.says_client(wish, now)

    @property
    def state(self) -> PreviewState:
        (state,) = self.desk.manager.state.previews.values()
        return state

    def member(self, service: str = ONE, label: str = "") -> Member:
        """The one of that service that was asked last, or for that step."""
        asked = [one for one in self.state.members if one.offer.service == service and (not label or one.label == label)]
        return asked[-1]

    def says(self, body: FrpBody, now: float, service: str = ONE, label: str = "") -> list[Effect]:
        self.desk.said += 1
        member = self.member(service, label)
        header = Header(
            sender=member.offer.address,
            recipient="tm",
            message_id=f"said {self.desk.said}",
            reply_to=member.offer.address,
            relates_to=member.session.sent_messages["Arrange"].id,
            transaction=self.state.id,
            participant=member.id,
        )
        return self.desk.give(Received(Message(header=header, body=body)), now)

    def offers(self, now: float, service: str = ONE, label: str = "", *, price: float = 10.0, **more: object) -> list[Effect]:
        terms = frp.Terms(**{"effect": WISH, "price": price, "duration": 60.0, **more})  # type: ignore[arg-type]  # fields of Terms
        return self.says(terms, now, service, label)

    def rings(self, timer: Timer, now: float) -> list[Effect]:
        return self.desk.rings(timer, now)


def came(effects: list[Effect]) -> Previewed:
    """The one thing that the client was told."""
    (body,) = answers(effects)
    assert isinstance(body, Previewed)
    return body


def wakes(effects: list[Effect]) -> list[tuple[str, float | None]]:
    """The preview's own timers, as they were set."""
    return [
        (type(one.timer).__name__, one.at) for one in effects if isinstance(one, SetTimer) and isinstance(one.timer, PreviewDue | BidsDue)
    ]


def sent(effects: list[Effect]) -> list[FrpBody]:
    return [one.message.body for one in effects if isinstance(one, Send) and isinstance(one.message.body, FrpBody)]


def quoted(found: Previewed) -> list[tuple[str, str, float | None, bool, bool, str]]:
    return [(one.step, one.service, one.price, one.chosen, one.estimate, one.reason) for one in found.quotations]


def test_services_are_asked_and_the_best_is_taken_on_paper() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"), policy=Policy.TIME)
    assert [one for one in sent(inquiry.effects) if isinstance(one, frp.Arrange)] == [
        frp.Arrange(
            service_type="TransferObject",
            inputs={"Object": "Jar002", "Destination": "Platform001"},
            effect=WISH,
            precondition="Jar002 isOn Cupboard001",
            earliest_start=10.0,
            latest_finish=None,
            reply_by=12.0,
        )
    ] * 2
    assert wakes(inquiry.effects) == [("PreviewDue", 16.0), ("BidsDue", 12.0)]
    assert inquiry.offers(11.0) == []
    effects = inquiry.offers(11.0, TWO, price=20.0, duration=30.0, start_from=12.0)
    assert came(effects) == Previewed(
        steps=(
            StepView(
                step="step1",
                service_type="TransferObject",
                inputs={"Object": "Jar002", "Destination": "Platform001"},
                service=TWO,
                price=20.0,
                duration=30.0,
            ),
        ),
        quotations=(
            Quotation(step="step1", service=ONE, price=10.0, duration=60.0, start=0.0, finish=60.0),
            Quotation(step="step1", service=TWO, price=20.0, duration=30.0, start=2.0, finish=32.0, chosen=True),
        ),
        price=20.0,
        seconds=32.0,
    )
    assert [one for one in sent(effects) if isinstance(one, frp.Cancel)] == [frp.Cancel(reason=PREVIEW_ONLY)] * 2
    assert wakes(effects) == [("BidsDue", None), ("PreviewDue", None)]
    state = inquiry.desk.manager.state
    assert (state.previews, state.reservations.goals, state.reservations.held) == ({}, {}, {})
    assert (state.quotes.prices, state.quotes.durations) == ({ONE: 10.0, TWO: 20.0}, {ONE: 60.0, TWO: 30.0})


def test_it_is_planned_as_the_task_would_be() -> None:
    desk = Desk(held=True)
    before = "Jar002 isOn Cupboard001"
    inquiry = Inquiry(desk, precondition=before, policy=Policy.WEIGHTED, time_value=2.0, deadline=50.0, priority=7)
    assert inquiry.state.task == Submit(effect=WISH, precondition=before, policy=Policy.WEIGHTED, time_value=2.0, deadline=50.0, priority=7)
    (ask,) = [one for one in inquiry.effects if isinstance(one, Ask)]
    assert ask.question == PlanWanted(inquiry.state.id, 0, 0, 1)
    reservations = desk.manager.state.reservations
    assert (reservations.goals, reservations.priorities) == ({inquiry.state.id: WISH}, {inquiry.state.id: 7})
    assert inquiry.desk.give(Answered(PlanWanted(inquiry.state.id, 0, 0, 2), CHAIN), 11.0) == [], "nobody asks for that any more"
    assert bodies(desk.give(Answered(ask.question, CHAIN), 11.0)) == ["Arrange"]
    assert (reservations.goals, reservations.held) == ({}, {})


def test_what_is_stated_twice_by_one_message_is_one_preview() -> None:
    inquiry = Inquiry(Desk())
    request = inquiry.state.request
    assert inquiry.desk.give(Received(request), 11.0) == []
    assert [*inquiry.desk.manager.state.previews] == [inquiry.state.id]


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (Plan(), Previewed(steps=(), explanation="nothing to do: it is so already")),
        (
            NoPlan("no way", separate_reasons=("no", "way"), obstacles=(Obstacle.PROMISED,)),
            Previewed(steps=(), explanation="no way", reasons=("no", "way"), obstacles=(clients.Obstacle.PROMISED,)),
        ),
        (
            ErrorAnswer("out of memory"),
            Previewed(steps=(), explanation="planning failed: out of memory", reasons=("planning failed: out of memory",)),
        ),
    ],
)
def test_without_a_step_nobody_is_asked(found: object, told: Previewed) -> None:
    desk = Desk()
    desk.found = [found]
    inquiry = Inquiry(desk)
    assert came(inquiry.effects) == told
    assert wakes(inquiry.effects) == [("PreviewDue", None)]
    assert desk.manager.state.previews == {}


def test_when_the_registry_cannot_say_who_is_there_the_client_hears_that() -> None:
    desk = Desk()
    desk.registry = frp.Fault(code="env:Receiver", text="it is full")
    why = "the Service Registry answered: it is full"
    assert came(Inquiry(desk).effects) == Previewed(steps=(), explanation=why, reasons=(why,))


def test_without_quotes_the_plan_is_told_and_nobody_is_asked() -> None:
    inquiry = Inquiry(Desk(), quotes=False)
    step = StepView(step="step1", service_type="TransferObject", inputs={"Object": "Jar002", "Destination": "Platform001"})
    assert came(inquiry.effects) == Previewed(steps=(step,))
    assert "Arrange" not in bodies(inquiry.effects)


@pytest.mark.parametrize("quotes", [True, False])
def test_who_has_what_it_needs_is_told_of(quotes: bool) -> None:
    desk = Desk()
    inquiry = Inquiry(desk, under_way=True, effect="Jar002 isOn Cupboard002", quotes=quotes)
    found = came(inquiry.offers(11.0) if quotes else inquiry.effects)
    assert found.waits == f"waiting for task {desk.task.id} ({WISH}) to end, which has Jar002"
    assert (len(found.steps), found.price) == (1, 10.0 if quotes else None)


def test_steps_are_asked_for_on_what_those_before_promise() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.found = [CHAIN]
    inquiry = Inquiry(desk, deadline=200.0)
    assert [(member.label, member.offer.service) for member in inquiry.state.members] == [("a", ONE), ("a", TWO)]
    inquiry.says(frp.Refuse(reason="too heavy"), 11.0, TWO)
    effects = inquiry.offers(11.0)
    asked = [body for body in sent(effects) if isinstance(body, frp.Arrange)]
    assert [(body.effect, body.earliest_start, body.latest_finish, body.reply_by) for body in asked] == [
        ("Tin001 isOn Platform001", 70.0, 210.0, 13.0)
    ] * 2
    inquiry.offers(12.0, price=5.0)
    found = came(inquiry.offers(12.0, TWO, price=2.5, duration=10.0))
    assert quoted(found) == [
        ("a", ONE, 10.0, True, False, ""),
        ("a", TWO, None, False, False, "too heavy"),
        ("b", ONE, 5.0, False, False, ""),
        ("b", TWO, 2.5, True, False, ""),
    ]
    assert [(one.start, one.finish) for one in found.quotations] == [(0.0, 60.0), (None, None), (60.0, 120.0), (60.0, 70.0)]
    assert (found.price, found.currency, found.seconds, found.estimate, found.unserved) == (12.5, "EUR", 70.0, False, {})
    assert [(step.step, step.service, step.price, step.duration, step.after) for step in found.steps] == [
        ("a", ONE, 10.0, 60.0, ()),
        ("b", TWO, 2.5, 10.0, ("a",)),
    ]


@pytest.mark.parametrize(
    ("currencies", "price", "currency"),
    [(("EUR", "EUR"), 20.0, "EUR"), (("PLN", "PLN"), 20.0, "PLN"), (("PLN", "CHF"), None, "CHF")],
)
def test_one_price_is_told_where_all_is_in_one_currency(currencies: tuple[str, str], price: float | None, currency: str) -> None:
    desk = Desk()
    desk.found = [APART]
    inquiry = Inquiry(desk)
    inquiry.offers(11.0, label="a", currency=currencies[0])
    found = came(inquiry.offers(11.0, label="b", currency=currencies[1]))
    assert (found.price, found.currency, found.seconds) == (price, currency, 120.0), "one device does one thing after the other"
    assert [(one.start, one.finish, one.currency) for one in found.quotations] == [(0.0, 60.0, currencies[0]), (60.0, 120.0, currencies[1])]


@pytest.mark.parametrize(("deadline", "chosen"), [(60.0, True), (59.0, False), (None, True)])
def test_who_would_be_done_too_late_is_not_taken(deadline: float | None, chosen: bool) -> None:
    inquiry = Inquiry(Desk(), deadline=deadline)
    found = came(inquiry.offers(11.0))
    assert quoted(found) == [("step1", ONE, 10.0, chosen, False, "")]
    assert found.unserved == ({} if chosen else {"step1": "nobody would be done in time"})
    assert (found.price, found.seconds) == ((10.0, 60.0) if chosen else (None, None))


def test_what_devices_are_committed_to_comes_first() -> None:
    desk = Desk()
    desk.executing()
    found = came(Inquiry(desk, under_way=True, effect="Jar001 isOn Platform001").offers(11.0))
    assert [(one.start, one.finish) for one in found.quotations] == [(50.0, 110.0)]
    assert found.waits == ""


@pytest.mark.parametrize(
    "body", [frp.Refuse(reason="too heavy"), frp.Fault(code="env:Receiver", text="too heavy")], ids=["refuse", "fault"]
)
def test_who_gives_no_terms_says_why(body: FrpBody) -> None:
    found = came(Inquiry(Desk()).says(body, 11.0))
    assert quoted(found) == [("step1", ONE, None, False, False, "too heavy")]
    assert found.unserved == {"step1": f"nobody takes it ({ONE}: too heavy)"}
    assert (found.price, found.seconds, found.estimate, len(found.steps)) == (None, None, False, 1)


def test_all_who_give_no_terms_are_named() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"))
    inquiry.says(frp.Refuse(reason="too heavy"), 11.0)
    found = came(inquiry.says(frp.Refuse(reason="too far"), 11.0, TWO))
    assert found.unserved == {"step1": f"nobody takes it ({ONE}: too heavy; {TWO}: too far)"}


def test_who_cannot_be_reached_gives_no_terms() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"))
    (first, second) = [one.message for one in inquiry.effects if isinstance(one, Send) and isinstance(one.message.body, frp.Arrange)]
    assert bodies(inquiry.desk.give(DeliveryFailed(first, "no route"), 11.0)) == ["Cancel"]
    found = came(inquiry.desk.give(DeliveryFailed(second, "no power"), 11.0))
    assert [reason for *_, reason in quoted(found)] == ["could not be reached: no route", "could not be reached: no power"]


def test_a_step_that_nobody_offers_holds_up_no_other() -> None:
    desk = Desk()
    desk.found, desk.offers = [CHAIN], ()
    effects = Inquiry(desk).effects
    assert came(effects).unserved == {"a": "nobody offers it", "b": "nobody offers it"}
    assert wakes(effects) == [("PreviewDue", 16.0), ("PreviewDue", None)]


def test_who_does_not_answer_in_time_is_put_down_with_what_it_asked_last() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.manager.state.quotes.record_quote(ONE, 8.0, 40.0)
    inquiry = Inquiry(desk)
    assert inquiry.rings(BidsDue(inquiry.state.id, 0), 11.9) == [SetTimer(BidsDue(inquiry.state.id, 0), 12.0)]
    effects = inquiry.rings(BidsDue(inquiry.state.id, 0), 12.0)
    found = came(effects)
    assert quoted(found) == [("step1", ONE, 8.0, True, True, MUTE), ("step1", TWO, None, False, False, MUTE)]
    assert [(one.start, one.finish, one.duration) for one in found.quotations] == [(2.0, 42.0, 40.0), (None, None, None)]
    assert (found.price, found.seconds, found.estimate, found.unserved) == (8.0, 42.0, True, {})
    assert bodies(effects) == ["Cancel", "Cancel", "Previewed"]


def test_who_gave_terms_is_taken_when_the_others_do_not_answer_in_time() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"))
    inquiry.offers(11.0, TWO, price=30.0)
    found = came(inquiry.rings(BidsDue(inquiry.state.id, 0), 12.0))
    assert quoted(found) == [("step1", ONE, None, False, False, MUTE), ("step1", TWO, 30.0, True, False, "")]
    assert (found.price, found.estimate) == (30.0, False)


def test_an_estimate_that_is_not_chosen_makes_no_estimate_of_the_whole() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.manager.state.quotes.record_quote(ONE, 80.0, 40.0)
    inquiry = Inquiry(desk)
    inquiry.offers(11.0, TWO, price=30.0)
    found = came(inquiry.rings(BidsDue(inquiry.state.id, 0), 12.0))
    assert quoted(found) == [("step1", ONE, 80.0, False, True, MUTE), ("step1", TWO, 30.0, True, False, "")]
    assert found.estimate is False


def test_what_could_not_be_asked_in_time_is_put_down_with_what_services_asked_last() -> None:
    desk = Desk("Robot1", "Robot2")
    desk.found = [CHAIN]
    desk.manager.state.quotes.record_quote(TWO, 8.0, 40.0)
    inquiry = Inquiry(desk)
    effects = inquiry.rings(PreviewDue(inquiry.state.id), 10.0 + MOST_TIME)
    found = came(effects)
    assert quoted(found) == [
        ("a", ONE, None, False, False, MUTE),
        ("a", TWO, 8.0, True, True, MUTE),
        ("b", ONE, None, False, False, LEFT),
        ("b", TWO, 8.0, True, True, LEFT),
    ]
    assert [(one.start, one.finish) for one in found.quotations if one.chosen] == [(6.0, 46.0), (46.0, 86.0)]
    assert (found.price, found.seconds, found.estimate) == (16.0, 86.0, True)
    assert bodies(effects) == ["Cancel", "Cancel", "Previewed"], "who was not asked is not sent home"


def test_when_nothing_is_known_of_anybody_every_step_says_so() -> None:
    desk = Desk()
    desk.found = [CHAIN]
    inquiry = Inquiry(desk)
    found = came(inquiry.rings(PreviewDue(inquiry.state.id), 16.0))
    assert found.unserved == {"a": f"nobody takes it ({ONE}: {MUTE})", "b": f"nobody takes it ({ONE}: {LEFT})"}
    assert [step.service for step in found.steps] == [None, None]


def test_what_comes_after_the_end_is_answered_with_a_farewell_and_no_more() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"))
    member, id = inquiry.member(TWO), inquiry.state.id
    came(inquiry.rings(BidsDue(id, 0), 12.0))
    header = Header(sender="Robot2", recipient="tm", message_id="late", reply_to="Robot2", transaction=id, participant=member.id)
    late = inquiry.desk.give(Received(Message(header=header, body=frp.Terms(effect=WISH, price=1.0, duration=1.0))), 13.0)
    assert bodies(late) == ["Cancel"]
    for timer in (BidsDue(id, 0), PreviewDue(id)):
        assert inquiry.rings(timer, 16.0) == []


def test_what_says_nothing_new_changes_nothing() -> None:
    inquiry = Inquiry(Desk("Robot1", "Robot2"))
    inquiry.offers(11.0)
    before = inquiry.member().bid
    inquiry.offers(11.5, price=99.0)
    assert inquiry.member().bid == before
    assert inquiry.desk.manager.state.quotes.prices == {ONE: 10.0}


def test_no_more_than_so_many_steps_are_asked_for_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("somrs.task_manager.preview.AT_ONCE", 2)
    desk = Desk()
    desk.found = [Plan((*APART.steps, move("c", "Jar002")))]
    inquiry = Inquiry(desk)
    assert [member.label for member in inquiry.state.members] == ["a", "b"]
    assert bodies(inquiry.offers(11.0, label="a")) == ["Cancel", "Arrange"]
    assert [member.label for member in inquiry.state.members] == ["a", "b", "c"]
    assert inquiry.offers(12.0, label="c")[-1:] != []
    assert came(inquiry.offers(12.0, label="b")).price == 30.0


def test_what_comes_behind_a_step_that_nobody_takes_is_asked_for_as_if_it_took_no_time() -> None:
    desk = Desk()
    desk.found = [Plan((*CHAIN.steps, move("c", "Jar002")), (*CHAIN.links, Link("b", "c", "")))]
    inquiry = Inquiry(desk)
    inquiry.offers(11.0)
    (asked,) = [body for body in sent(inquiry.says(frp.Refuse(reason="no"), 12.0)) if isinstance(body, frp.Arrange)]
    assert (asked.effect, asked.earliest_start) == (WISH, 70.0)
    assert came(inquiry.offers(13.0)).unserved == {"b": f"nobody takes it ({ONE}: no)"}
