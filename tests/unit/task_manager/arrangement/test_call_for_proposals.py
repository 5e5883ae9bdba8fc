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
from somrs.protocol.messages.clients import Policy, Submit
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.task_manager.arrangement.call_for_proposals import Arrangement, CallForProposals, OpenCalls, make_call
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.timers import BidsDue
from tests.unit.task_manager.execution.test_participants import DAY, WORK, Table, carried_out, sends

TIMER = BidsDue("task1", 1)
EFFECT = "Jar1.Clean = TRUE"


def call(key: str, until: float, same: str | None = None) -> CallForProposals:
    return CallForProposals(step=key, key=key, device_group=same, invited=(f"for {key}",), earliest=0.0, latest=None, reply_by=until)


def opened(*calls: CallForProposals) -> OpenCalls:
    found = OpenCalls(timer=TIMER)
    for one in calls:
        carried_out(found.open(one))
    return found


# Which are open, and until when


def test_the_timer_is_set_for_the_call_that_is_over_first() -> None:
    calls, first, second = OpenCalls(timer=TIMER), call("a", 20.0), call("b", 10.0)
    assert [*calls.open(first)] == [SetTimer(TIMER, 20.0)]
    assert [*calls.open(second)] == [SetTimer(TIMER, 10.0)]
    assert [*calls.open(call("c", 30.0))] == []
    assert (len(calls), [one.key for one in calls], calls.timer_at) == (3, ["a", "b", "c"], 10.0)
    assert [*calls.close(second)] == [SetTimer(TIMER, 20.0)]
    assert [one.key for one in calls] == ["a", "c"]
    assert [*calls.close_all()] == [SetTimer(TIMER, None)]
    assert (len(calls), calls.timer_at) == (0, None)
    assert [*calls.close_all()] == []


@pytest.mark.parametrize(("now", "due"), [(9.998, ""), (9.999, "a"), (10.0, "a"), (19.0, "a"), (20.0, "ab")])
def test_a_call_is_due_when_its_time_is_over(now: float, due: str) -> None:
    calls = opened(call("a", 10.0), call("b", 20.0))
    assert "".join(one.key for one in calls.due(now)) == due
    assert [*calls.set_timer()] == [SetTimer(TIMER, 10.0)], "none was closed, and the timer has rung"


def test_a_call_that_is_closed_or_made_anew_meanwhile_is_not_due() -> None:
    calls = opened(*(call(key, 10.0) for key in "abcd"))
    due = []
    for one in calls.due(10.0):
        due.append(one.key)
        if one.key == "a":
            carried_out(calls.close(calls.pending["b"]))
            carried_out(calls.open(call("c", 10.0)))
    assert due == ["a", "d"]


def test_a_participant_answers_the_call_that_it_was_invited_to() -> None:
    table, calls = Table(), opened(call("a", 10.0), call("b", 10.0))
    member = table.invited("a")
    assert calls.find_call(member) is None
    calls.pending["a"].invited = ("somebody", member.id)
    assert calls.find_call(member) is calls.pending["a"]
    member.step = "b"
    assert calls.find_call(member) is None
    member.step = "c"
    assert calls.find_call(member) is None


@pytest.mark.parametrize(
    ("same", "alike", "settles"), [("g", ("Robot2",), True), ("h", ("Robot2",), True), ("i", ("Robot2",), False), ("g", (), False)]
)
def test_one_call_settles_which_device_does_all_steps_that_say_the_same(same: str, alike: tuple[str, ...], settles: bool) -> None:
    calls = opened(call("a", 10.0, "g"), call("b", 10.0, "h"))
    assert calls.settles(Step("c", "Work", {}, parse(EFFECT), provider="Robot1", device_group=same, alternative_providers=alike)) is settles


# One call


def offer(name: str, service_type: ServiceType = WORK) -> Offer:
    return Offer(service=f"{name}.Work", provider=name, provider_type="Robot", address=name, service_type=service_type)


class Asking:
    """Services that are asked at 50 for one step, which can be begun at 100."""

    def __init__(self, *offers: Offer, latest: float | None = None, precondition: str | None = None, **step: Any) -> None:
        self.table = Table()
        wanted = Step("step1", "Work", {"Object": Name("Jar1")}, parse(step.pop("effect", EFFECT)), **step)
        self.workflow = Workflow.from_plan(Plan((wanted,)), "1.1/")
        self.arrangement = Arrangement(self.workflow, self.table.members, self.table.participants)
        self.run = self.workflow.runs["step1"]
        self.run.precondition = parse(precondition) if precondition is not None else None
        self.effects, self.call = carried_out(self.arrangement.invite_services(self.run, offers, 100.0, latest, 50.0))

    def member(self, name: str) -> Member:
        (found,) = [member for member in self.table.members if member.offer.provider == name]
        return found

    def offers(self, name: str, price: float, duration: float = 30.0) -> Member:
        member, terms = self.member(name), frp.Terms(effect=EFFECT, price=price, duration=duration)
        self.table.says(member, terms)
        assert member.session.terms_id is not None
        self.arrangement.add_bid(self.call, member, terms, member.session.terms_id)
        return member

    def award(self, *broken: str, busy: dict[str, tuple[float, float]] | None = None) -> tuple[list[Effect], Member | None]:
        taken = {name: [times] for name, times in (busy or {}).items()}
        task = Submit(effect=EFFECT, policy=Policy.PRICE)
        return carried_out(self.arrangement.award(self.call, task, taken, broken, 60.0))


def said(effects: list[Effect]) -> dict[str, tuple[object, float | None]]:
    """What is said to whom, and until when."""
    return {effect.message.header.recipient: (effect.message.body, effect.expires_at) for effect in effects if isinstance(effect, Send)}


def test_all_are_asked_the_same() -> None:
    fine = ServiceType(name="FineWork", effect=EFFECT, parent="Work")
    asking = Asking(offer("Robot1"), offer("Robot2"), offer("Robot3", fine), latest=200.0, same="g")
    arrange = frp.Arrange(
        service_type="Work", inputs={"Object": "Jar1"}, effect=EFFECT, earliest_start=100.0, latest_finish=200.0, reply_by=60.0
    )
    assert said(asking.effects) == {
        "Robot1": (arrange, 60.0),
        "Robot2": (arrange, 60.0),
        "Robot3": (structs.replace(arrange, service_type="FineWork"), 60.0),
    }
    members = [*asking.table.members]
    assert [(member.step, member.label) for member in members] == [("1.1/step1", "step1")] * 3
    invited = tuple(member.id for member in members)
    expected = CallForProposals(
        step="step1", key="1.1/step1", device_group="g", invited=invited, earliest=100.0, latest=200.0, reply_by=60.0
    )
    assert structs.asdict(asking.call) == structs.asdict(expected)
    assert asking.run.progress is Progress.ARRANGING
    assert (asking.arrangement.invited(asking.call), asking.arrangement.run(asking.call)) == (members, asking.run)


def test_they_have_as_long_as_is_said() -> None:
    asking = Asking()
    effects, made = carried_out(asking.arrangement.invite_services(asking.run, [offer("Robot1")], 100.0, None, 50.0, 3.0))
    ((body, until),) = sends(effects)
    assert isinstance(body, frp.Arrange)
    assert (body.reply_by, until, made.reply_by) == (53.0, 53.0, 53.0)


@pytest.mark.parametrize(
    ("now", "planned", "alike", "asked"),
    [
        (None, None, (), None),
        (None, "Jar1.Open = TRUE", (), "Jar1.Open = TRUE"),
        ("Jar1.Open = FALSE", "Jar1.Open = TRUE", (), "Jar1.Open = FALSE"),
        ("Jar1.Open = FALSE", "Robot1 isInside RoomA", ("Robot2",), "Robot2 isInside RoomA"),
        ("Jar1.Open = FALSE", None, ("Robot2",), None),
    ],
)
def test_the_precondition_is_as_it_is_now_but_for_a_step_that_several_could_do(
    now: str | None, planned: str | None, alike: tuple[str, ...], asked: str | None
) -> None:
    precondition = parse(planned) if planned is not None else None
    asking = Asking(offer("Robot2"), precondition=now)
    asking.run.step = Step(
        "step1", "Work", {}, parse(EFFECT), precondition, provider="Robot1", alternative_providers=alike, device_group="g"
    )
    effects, _ = carried_out(asking.arrangement.invite_services(asking.run, [offer("Robot2")], 100.0, None, 50.0))
    ((body, _),) = sends(effects)
    assert isinstance(body, frp.Arrange)
    assert body.precondition == asked


def test_each_of_those_that_could_do_it_is_asked_for_what_it_would_do_itself() -> None:
    asking = Asking(offer("Robot1"), offer("Robot2"), effect="Jar1 isOn Robot1", provider="Robot1", alike=("Robot2",), same="g")
    assert [body.effect for body, _ in sends(asking.effects) if isinstance(body, frp.Arrange)] == ["Jar1 isOn Robot1", "Jar1 isOn Robot2"]


def test_a_call_is_answered_when_nobody_is_awaited() -> None:
    asking = Asking(offer("Robot1"), offer("Robot2"))
    assert not asking.arrangement.is_answered(asking.call)
    asking.offers("Robot1", 5.0)
    assert not asking.arrangement.is_answered(asking.call)
    asking.table.says(asking.member("Robot2"), frp.Refuse(reason="too heavy"))
    assert asking.arrangement.is_answered(asking.call)


def test_the_bid_that_the_policy_prefers_is_accepted_and_everybody_else_is_dismissed() -> None:
    asking = Asking(*map(offer, ("Robot1", "Robot2", "Robot3", "Robot4", "Robot5")))
    for name, price in (("Robot1", 7.0), ("Robot2", 5.0), ("Robot3", 6.0), ("Robot5", 1.0)):
        asking.offers(name, price)
    asking.table.says(asking.member("Robot5"), frp.Refuse(reason="changed its mind"))
    chosen, late = asking.member("Robot2"), asking.member("Robot4")
    terms = chosen.session.terms_id
    assert terms is not None
    effects, found = asking.award(busy={"Robot2": (90.0, 110.0), "Robot3": (0.0, 500.0)})
    assert found is chosen
    other = frp.Cancel(reason="another service was chosen by price")
    assert said(effects) == {
        "Robot1": (other, 60.0 + DAY),
        "Robot2": (frp.Accept(terms=terms), 80.0),
        "Robot3": (other, 60.0 + DAY),
        "Robot4": (frp.Cancel(reason="no answer in time"), 60.0 + DAY),
    }
    assert (late.exit_reason, asking.run.excluded) == ("did not answer", {"Robot4.Work": "did not answer"})
    run = asking.run
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
    asking = Asking(offer("Robot1"), offer("Robot2"))
    asking.offers("Robot1", 1.0)
    asking.offers("Robot2", 5.0)
    effects, found = asking.award("Robot1.Work")
    assert found is asking.member("Robot2")
    assert said(effects)["Robot1"][0] == frp.Cancel(reason="another service was chosen by price")
    assert asking.run.excluded == {}
    asking = Asking(offer("Robot1"))
    asking.offers("Robot1", 1.0)
    effects, found = asking.award("Robot1.Work")
    assert (said(effects), found) == ({"Robot1": (frp.Cancel(reason="it failed at another step"), 60.0 + DAY)}, None)
    assert asking.run.progress is Progress.OPEN


@pytest.mark.parametrize(
    ("latest", "chosen", "excluded"),
    [
        (150.0, "Robot1", {}),
        (149.0, "Robot2", {"Robot1.Work": "would be done 1 s too late"}),
        (120.0, None, {"Robot1.Work": "would be done 30 s too late", "Robot2.Work": "would be done 20 s too late"}),
    ],
)
def test_who_would_be_done_too_late_is_not_asked_again(latest: float, chosen: str | None, excluded: dict[str, str]) -> None:
    asking = Asking(offer("Robot1"), offer("Robot2"), latest=latest)
    asking.offers("Robot1", 1.0, 50.0)
    asking.offers("Robot2", 5.0, 40.0)
    effects, found = asking.award()
    assert (found.offer.provider if found is not None else None, asking.run.excluded) == (chosen, excluded)
    told = {f"{provider}.Work" for provider, says in said(effects).items() if says[0] == frp.Cancel(reason="it would be done too late")}
    assert told == {*excluded}, "each hears why"
    assert asking.run.progress is (Progress.ARRANGED if chosen is not None else Progress.OPEN)


def test_nobody_is_chosen_while_one_that_came_back_has_the_step() -> None:
    asking = Asking(offer("Robot2"))
    asking.offers("Robot2", 1.0)
    assert asking.table.executing().step == asking.run.key
    effects, found = asking.award()
    reason = "one that had it has come back, and has to stop first"
    assert (said(effects), found) == ({"Robot2": (frp.Cancel(reason=reason), 60.0 + DAY)}, None)
    assert (asking.run.progress, asking.run.excluded) == (Progress.OPEN, {})


def test_when_a_step_is_not_wanted_any_more_all_are_dismissed() -> None:
    asking = Asking(offer("Robot1"), offer("Robot2"))
    asking.offers("Robot1", 1.0)
    effects, _ = carried_out(asking.arrangement.withdraw(asking.call, "not needed", 70.0))
    assert said(effects) == dict.fromkeys(("Robot1", "Robot2"), (frp.Cancel(reason="not needed"), 70.0 + DAY))
    assert asking.run.progress is Progress.OPEN


def test_whose_terms_ran_out_may_be_asked_once_more() -> None:
    asking = Asking(offer("Robot1"), offer("Robot2"))
    arrangement, run = asking.arrangement, asking.run
    arrangement.participant_left(asking.call, asking.member("Robot2"), "too heavy")
    assert (run.excluded, run.lapsed) == ({"Robot2.Work": "too heavy"}, set())
    member = asking.offers("Robot1", 1.0)
    arrangement.participant_left(asking.call, member, "expired")
    assert (run.excluded, run.lapsed, asking.member("Robot1").bid) == ({"Robot2.Work": "too heavy"}, {"Robot1.Work"}, None)
    assert member.session.terms_id is not None
    arrangement.add_bid(asking.call, member, frp.Terms(effect=EFFECT, price=1.0, duration=30.0), member.session.terms_id)
    arrangement.participant_left(asking.call, member, "expired again")
    assert (run.excluded, [one.bid for one in asking.table.members]) == (
        {"Robot2.Work": "too heavy", "Robot1.Work": "expired again"},
        [None, None],
    )


def test_a_bid_says_when_the_step_would_begin_and_end() -> None:
    asking = Asking(offer("Robot1"))
    member = asking.offers("Robot1", 5.0, 30.0)
    assert member.bid is not None
    assert (member.bid.participant, member.bid.terms_id, member.bid.terms.price) == (member.id, member.session.terms_id, 5.0)
    assert (member.bid.start, member.bid.finish) == (100.0, 130.0)


def test_a_call_is_for_its_step() -> None:
    run = StepRun(step=Step("step1", "Work", {}, parse(EFFECT), device_group="g"), label="undo1.step1", key="2.1/step1")
    found = make_call(run, iter(("a", "b")), earliest=1.0, latest=2.0, reply_by=3.0)
    assert structs.astuple(found) == ("step1", "2.1/step1", "g", ("a", "b"), 1.0, 2.0, 3.0)
