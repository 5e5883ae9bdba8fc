"""Who is asked for a step, until when, and whose terms are taken."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.kernel.component import Effect, Send, SetTimer
from somrs.ontology.services import ServiceType
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.submission import Policy, Submit
from somrs.task_manager.arrangement.call_for_proposals import REPLY_TIME, Arrangement, CallForProposals, OpenCalls, make_call
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.timers import BidsDue
from tests.support.effects import run_effects
from tests.unit.task_manager.execution.test_participants import DAY, WORK, TransactionHarness, sends

TIMER = BidsDue("task1", 1)
EFFECT = "Jar1.Clean = TRUE"


def call(key: str, reply_by: float, device_group: str | None = None) -> CallForProposals:
    return CallForProposals(
        step=key, key=key, device_group=device_group, invited=(f"for {key}",), earliest=0.0, latest=None, reply_by=reply_by
    )


def opened(*calls: CallForProposals) -> OpenCalls:
    open_calls = OpenCalls(timer=TIMER)
    for proposal_call in calls:
        run_effects(open_calls.open(proposal_call))
    return open_calls


# Which are open, and until when


def test_the_timer_is_set_for_the_call_that_is_over_first() -> None:
    calls, first, second = OpenCalls(timer=TIMER), call("a", 20.0), call("b", 10.0)
    assert [*calls.open(first)] == [SetTimer(TIMER, 20.0)]
    assert [*calls.open(second)] == [SetTimer(TIMER, 10.0)]
    assert [*calls.open(call("c", 30.0))] == []
    assert (len(calls), [open_call.key for open_call in calls], calls.timer_at) == (3, ["a", "b", "c"], 10.0)
    assert [*calls.close(second)] == [SetTimer(TIMER, 20.0)]
    assert [open_call.key for open_call in calls] == ["a", "c"]
    assert [*calls.close_all()] == [SetTimer(TIMER, None)]
    assert (len(calls), calls.timer_at) == (0, None)
    assert [*calls.close_all()] == []


@pytest.mark.parametrize(("now", "due"), [(9.998, ""), (9.999, "a"), (10.0, "a"), (19.0, "a"), (20.0, "ab")])
def test_a_call_is_due_when_its_time_is_over(now: float, due: str) -> None:
    calls = opened(call("a", 10.0), call("b", 20.0))
    assert "".join(due_call.key for due_call in calls.due(now)) == due
    assert [*calls.set_timer()] == [SetTimer(TIMER, 10.0)], "none was closed, and the timer has rung"


def test_a_call_that_is_closed_or_made_anew_meanwhile_is_not_due() -> None:
    calls = opened(*(call(key, 10.0) for key in "abcd"))
    due = []
    for due_call in calls.due(10.0):
        due.append(due_call.key)
        if due_call.key == "a":
            run_effects(calls.close(calls.pending["b"]))
            run_effects(calls.open(call("c", 10.0)))
    assert due == ["a", "d"]


def test_a_participant_answers_the_call_that_it_was_invited_to() -> None:
    transaction, calls = TransactionHarness(), opened(call("a", 10.0), call("b", 10.0))
    member = transaction.invited("a")
    assert calls.find_call(member) is None
    calls.pending["a"].invited = ("somebody", member.id)
    assert calls.find_call(member) is calls.pending["a"]
    member.step = "b"
    assert calls.find_call(member) is None
    member.step = "c"
    assert calls.find_call(member) is None


@pytest.mark.parametrize(
    ("device_group", "alike", "settles"), [("g", ("Robot2",), True), ("h", ("Robot2",), True), ("i", ("Robot2",), False), ("g", (), False)]
)
def test_one_call_settles_which_device_does_all_steps_that_say_the_same(device_group: str, alike: tuple[str, ...], settles: bool) -> None:
    calls = opened(call("a", 10.0, "g"), call("b", 10.0, "h"))
    assert (
        calls.settles(Step("c", "Work", {}, parse(EFFECT), provider="Robot1", device_group=device_group, alternative_providers=alike))
        is settles
    )


# One call


def offer(name: str, service_type: ServiceType = WORK) -> Offer:
    return Offer(service=f"{name}.Work", provider=name, provider_type="Robot", address=name, service_type=service_type)


class CallHarness:
    """Services that are asked at 50 for one step, which can be begun at 100."""

    def __init__(self, *offers: Offer, latest: float | None = None, precondition: str | None = None, **step: Any) -> None:
        self.transaction = TransactionHarness()
        planned_step = Step("step1", "Work", {"Object": Name("Jar1")}, parse(step.pop("effect", EFFECT)), **step)
        self.workflow = Workflow.from_plan(Plan((planned_step,)), "1.1/")
        self.arrangement = Arrangement(self.workflow, self.transaction.members, self.transaction.participants, self.transaction.replica)
        self.run = self.workflow.runs["step1"]
        self.run.precondition = parse(precondition) if precondition is not None else None
        self.effects, self.call = run_effects(self.arrangement.invite_services(self.run, offers, 100.0, latest, 50.0, REPLY_TIME))

    def member(self, name: str) -> Member:
        (invited_member,) = [member for member in self.transaction.members if member.offer.provider == name]
        return invited_member

    def offers(self, name: str, price: float, duration: float = 30.0) -> Member:
        member, terms = self.member(name), frp.Terms(effect=EFFECT, price=price, duration=duration)
        self.transaction.member_says(member, terms)
        assert member.session.terms_id is not None
        self.arrangement.add_bid(self.call, member, terms, member.session.terms_id)
        return member

    def award(self, *broken: str, busy: dict[str, tuple[float, float]] | None = None) -> tuple[list[Effect], Member | None]:
        commitments = {name: [times] for name, times in (busy or {}).items()}
        task = Submit(effect=EFFECT, policy=Policy.PRICE)
        return run_effects(self.arrangement.award(self.call, task, commitments, broken, 60.0))


def sent_bodies(effects: list[Effect]) -> dict[str, tuple[object, float | None]]:
    """What is said to whom, and until when."""
    return {effect.message.header.recipient: (effect.message.body, effect.expires_at) for effect in effects if isinstance(effect, Send)}


def test_all_are_asked_the_same() -> None:
    fine = ServiceType(name="FineWork", effect=EFFECT, parent="Work")
    harness = CallHarness(offer("Robot1"), offer("Robot2"), offer("Robot3", fine), latest=200.0, device_group="g")
    arrange = frp.Arrange(
        service_type="Work", inputs={"Object": "Jar1"}, effect=EFFECT, earliest_start=100.0, latest_finish=200.0, reply_by=60.0
    )
    assert sent_bodies(harness.effects) == {
        "Robot1": (arrange, 60.0),
        "Robot2": (arrange, 60.0),
        "Robot3": (structs.replace(arrange, service_type="FineWork"), 60.0),
    }
    members = [*harness.transaction.members]
    assert [(member.step, member.label) for member in members] == [("1.1/step1", "step1")] * 3
    invited = tuple(member.id for member in members)
    expected = CallForProposals(
        step="step1", key="1.1/step1", device_group="g", invited=invited, earliest=100.0, latest=200.0, reply_by=60.0, asked_at=50.0
    )
    assert structs.asdict(harness.call) == structs.asdict(expected)
    assert harness.run.progress is Progress.ARRANGING
    assert (harness.arrangement.invited(harness.call), harness.arrangement.run(harness.call)) == (members, harness.run)


def test_they_have_as_long_as_is_said() -> None:
    harness = CallHarness()
    effects, new_call = run_effects(harness.arrangement.invite_services(harness.run, [offer("Robot1")], 100.0, None, 50.0, 3.0))
    ((body, expires_at),) = sends(effects)
    assert isinstance(body, frp.Arrange)
    assert (body.reply_by, expires_at, new_call.reply_by) == (53.0, 53.0, 53.0)


@pytest.mark.parametrize(
    ("now", "planned", "alike", "expected"),
    [
        (None, None, (), None),
        (None, "Jar1.Open = TRUE", (), "Jar1.Open = TRUE"),
        ("Jar1.Open = FALSE", "Jar1.Open = TRUE", (), "Jar1.Open = FALSE"),
        ("Jar1.Open = FALSE", "Robot1 isInside RoomA", ("Robot2",), "Robot2 isInside RoomA"),
        ("Jar1.Open = FALSE", None, ("Robot2",), None),
    ],
)
def test_the_precondition_is_as_it_is_now_but_for_a_step_that_several_could_do(
    now: str | None, planned: str | None, alike: tuple[str, ...], expected: str | None
) -> None:
    precondition = parse(planned) if planned is not None else None
    harness = CallHarness(offer("Robot2"), precondition=now)
    harness.run.step = Step(
        "step1", "Work", {}, parse(EFFECT), precondition, provider="Robot1", alternative_providers=alike, device_group="g"
    )
    effects, _ = run_effects(harness.arrangement.invite_services(harness.run, [offer("Robot2")], 100.0, None, 50.0, REPLY_TIME))
    ((body, _),) = sends(effects)
    assert isinstance(body, frp.Arrange)
    assert body.precondition == expected


def test_each_of_those_that_could_do_it_is_asked_for_what_it_would_do_itself() -> None:
    harness = CallHarness(
        offer("Robot1"), offer("Robot2"), effect="Jar1 isOn Robot1", provider="Robot1", alternative_providers=("Robot2",), device_group="g"
    )
    assert [body.effect for body, _ in sends(harness.effects) if isinstance(body, frp.Arrange)] == ["Jar1 isOn Robot1", "Jar1 isOn Robot2"]


def test_a_call_is_answered_when_nobody_is_awaited() -> None:
    harness = CallHarness(offer("Robot1"), offer("Robot2"))
    assert not harness.arrangement.is_answered(harness.call)
    harness.offers("Robot1", 5.0)
    assert not harness.arrangement.is_answered(harness.call)
    harness.transaction.member_says(harness.member("Robot2"), frp.Refuse(reason="too heavy"))
    assert harness.arrangement.is_answered(harness.call)


def test_the_bid_that_the_policy_prefers_is_accepted_and_everybody_else_is_dismissed() -> None:
    harness = CallHarness(*map(offer, ("Robot1", "Robot2", "Robot3", "Robot4", "Robot5")))
    for name, price in (("Robot1", 7.0), ("Robot2", 5.0), ("Robot3", 6.0), ("Robot5", 1.0)):
        harness.offers(name, price)
    harness.transaction.member_says(harness.member("Robot5"), frp.Refuse(reason="changed its mind"))
    chosen, late = harness.member("Robot2"), harness.member("Robot4")
    terms = chosen.session.terms_id
    assert terms is not None
    effects, winner = harness.award(busy={"Robot2": (90.0, 110.0), "Robot3": (0.0, 500.0)})
    assert winner is chosen
    rejection = frp.Cancel(reason="another service was chosen by price")
    assert sent_bodies(effects) == {
        "Robot1": (rejection, 60.0 + DAY),
        "Robot2": (frp.Accept(terms=terms), 80.0),
        "Robot3": (rejection, 60.0 + DAY),
        "Robot4": (frp.Cancel(reason="no answer in time"), 60.0 + DAY),
    }
    assert (late.exit_reason, harness.run.excluded) == ("did not answer", {"Robot4.Work": "did not answer"})
    run = harness.run
    assert (run.progress, run.participant, run.provider, run.start, run.finish) == (
        Progress.ARRANGED,
        chosen.id,
        "Robot2",
        110.0,
        140.0,
    )
    assert chosen.bid is not None
    assert (chosen.bid.start, chosen.bid.finish, chosen.state) == (110.0, 140.0, State.COMMITTED)


def test_what_broke_at_other_work_meanwhile_is_not_chosen() -> None:
    harness = CallHarness(offer("Robot1"), offer("Robot2"))
    harness.offers("Robot1", 1.0)
    harness.offers("Robot2", 5.0)
    effects, winner = harness.award("Robot1.Work")
    assert winner is harness.member("Robot2")
    assert sent_bodies(effects)["Robot1"][0] == frp.Cancel(reason="another service was chosen by price")
    assert harness.run.excluded == {}
    harness = CallHarness(offer("Robot1"))
    harness.offers("Robot1", 1.0)
    effects, winner = harness.award("Robot1.Work")
    assert (sent_bodies(effects), winner) == ({"Robot1": (frp.Cancel(reason="it failed at another step"), 60.0 + DAY)}, None)
    assert harness.run.progress is Progress.OPEN


@pytest.mark.parametrize(
    ("latest", "chosen", "excluded"),
    [
        (150.0, "Robot1", {}),
        (149.0, "Robot2", {"Robot1.Work": "would be done 1 s too late"}),
        (120.0, None, {"Robot1.Work": "would be done 30 s too late", "Robot2.Work": "would be done 20 s too late"}),
    ],
)
def test_who_would_be_done_too_late_is_not_asked_again(latest: float, chosen: str | None, excluded: dict[str, str]) -> None:
    harness = CallHarness(offer("Robot1"), offer("Robot2"), latest=latest)
    harness.offers("Robot1", 1.0, 50.0)
    harness.offers("Robot2", 5.0, 40.0)
    effects, winner = harness.award()
    assert (winner.offer.provider if winner is not None else None, harness.run.excluded) == (chosen, excluded)
    notified = {
        f"{provider}.Work"
        for provider, sent_body in sent_bodies(effects).items()
        if sent_body[0] == frp.Cancel(reason="it would be done too late")
    }
    assert notified == {*excluded}, "each hears why"
    assert harness.run.progress is (Progress.ARRANGED if chosen is not None else Progress.OPEN)


def test_nobody_is_chosen_while_one_that_came_back_has_the_step() -> None:
    harness = CallHarness(offer("Robot2"))
    harness.offers("Robot2", 1.0)
    assert harness.transaction.executing().step == harness.run.key
    effects, winner = harness.award()
    reason = "another service still holds the step, and has to stop first"
    assert (sent_bodies(effects), winner) == ({"Robot2": (frp.Cancel(reason=reason), 60.0 + DAY)}, None)
    assert (harness.run.progress, harness.run.excluded) == (Progress.OPEN, {})


def test_when_a_step_is_not_wanted_any_more_all_are_dismissed() -> None:
    harness = CallHarness(offer("Robot1"), offer("Robot2"))
    harness.offers("Robot1", 1.0)
    effects, _ = run_effects(harness.arrangement.withdraw(harness.call, "not needed", 70.0))
    assert sent_bodies(effects) == dict.fromkeys(("Robot1", "Robot2"), (frp.Cancel(reason="not needed"), 70.0 + DAY))
    assert harness.run.progress is Progress.OPEN


def test_whose_terms_ran_out_may_be_asked_once_more() -> None:
    harness = CallHarness(offer("Robot1"), offer("Robot2"))
    arrangement, run = harness.arrangement, harness.run
    arrangement.participant_left(harness.call, harness.member("Robot2"), "too heavy")
    assert (run.excluded, run.lapsed) == ({"Robot2.Work": "too heavy"}, set())
    member = harness.offers("Robot1", 1.0)
    arrangement.participant_left(harness.call, member, "expired")
    assert (run.excluded, run.lapsed, harness.member("Robot1").bid) == ({"Robot2.Work": "too heavy"}, {"Robot1.Work"}, None)
    assert member.session.terms_id is not None
    arrangement.add_bid(harness.call, member, frp.Terms(effect=EFFECT, price=1.0, duration=30.0), member.session.terms_id)
    arrangement.participant_left(harness.call, member, "expired again")
    assert (run.excluded, [invited_member.bid for invited_member in harness.transaction.members]) == (
        {"Robot2.Work": "too heavy", "Robot1.Work": "expired again"},
        [None, None],
    )


def test_a_bid_says_when_the_step_would_begin_and_end() -> None:
    harness = CallHarness(offer("Robot1"))
    member = harness.offers("Robot1", 5.0, 30.0)
    assert member.bid is not None
    assert (member.bid.participant, member.bid.terms_id, member.bid.terms.price) == (member.id, member.session.terms_id, 5.0)
    assert (member.bid.start, member.bid.finish) == (100.0, 130.0)


def test_a_call_is_for_its_step() -> None:
    run = StepRun(step=Step("step1", "Work", {}, parse(EFFECT), device_group="g"), label="undo1.step1", key="2.1/step1")
    new_call = make_call(run, iter(("a", "b")), earliest=1.0, latest=2.0, reply_by=3.0, asked_at=0.5)
    assert structs.astuple(new_call) == ("step1", "2.1/step1", "g", ("a", "b"), 1.0, 2.0, 3.0, 0.5)
