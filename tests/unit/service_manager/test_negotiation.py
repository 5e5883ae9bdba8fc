"""How a device answers an Arrange: its quote, its terms, its refusals."""

from __future__ import annotations

import msgspec
import pytest

from somrs.kernel.component import Answered, Ask, SetTimer
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.messaging import REPORT_TIME
from somrs.service_manager.participant.timers import Activity, TermsDue, WorkWanted
from somrs.service_manager.sdk.orders import Advance, Answer, Failure, Quote, Quoted, Refused
from tests.support.effects import bodies
from tests.support.service_manager_harness import ARRANGE, NOW, ServiceManagerHarness, expiry_times, order, rest, timers


def test_an_arrange_has_the_device_quote_what_was_asked_for() -> None:
    harness = ServiceManagerHarness()
    effects = harness.ask(msgspec.structs.replace(ARRANGE, earliest_start=120.0, latest_finish=900.0))
    assert effects == [Ask(harness.question_for(Activity.QUOTE), Quote(order(earliest_start=120.0, latest_finish=900.0)))]


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
    effects = ServiceManagerHarness(participant).ask(msgspec.structs.replace(ARRANGE, service_type=service_type))
    assert [effect.task.order.method for effect in effects if isinstance(effect, Ask) and isinstance(effect.task, Quote)] == [method] * (
        method is not None
    )


def test_terms_say_what_was_quoted_and_when_it_is_possible() -> None:
    harness = ServiceManagerHarness()
    harness.ask(msgspec.structs.replace(ARRANGE, latest_finish=900.0))
    effects = harness.device_answers(Activity.QUOTE, Quoted(price=2.0, currency="PLN", duration=60.0))
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
    assert expiry_times(effects) == [NOW + REPORT_TIME]
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
    answer = ServiceManagerHarness().offered(**order)
    assert (answer.start_from if isinstance(answer, frp.Terms) else None) == start
    if isinstance(answer, frp.Refuse):
        assert answer.reason == "Washer1 would finish at least 1 s after the latest finish"


@pytest.mark.parametrize(
    ("answer", "reason"),
    [(Refused("too big"), "too big"), (Failure("no water"), str(Failure("no water"))), (None, "None")],
)
def test_whatever_else_a_quote_comes_to_is_refused_with_it(answer: Answer, reason: str) -> None:
    harness = ServiceManagerHarness()
    harness.ask(ARRANGE)
    effects = harness.device_answers(Activity.QUOTE, answer)
    assert bodies(effects) == [frp.Refuse(reason=reason)]
    assert rest(effects) == []
    assert (harness.state, harness.manager.state.jobs.live) == (State.ENDED, {})


def test_an_effect_that_cannot_be_read_is_refused_and_not_fatal() -> None:
    harness = ServiceManagerHarness()
    harness.ask(msgspec.structs.replace(ARRANGE, effect="Jar1 isOn ("))
    [body] = bodies(harness.device_answers(Activity.QUOTE, Quoted(price=1.0, duration=1.0)))
    assert isinstance(body, frp.Refuse)
    assert harness.state is State.ENDED


def test_a_quote_that_nobody_waits_for_any_more_says_nothing() -> None:
    harness = ServiceManagerHarness()
    harness.ask(ARRANGE)
    assert harness.device_answers(Activity.QUOTE, Advance(fraction=0.5)) == []
    harness.ask(frp.Cancel(reason="another is cheaper"))
    assert list(harness.manager.state.jobs.live) == [("t1", harness.participant)], "the device still works it out"
    assert harness.device_answers(Activity.QUOTE, Quoted(price=1.0, duration=1.0)) == []
    assert harness.manager.state.jobs.live == {}
    assert harness.device_answers(Activity.QUOTE, Quoted(price=1.0, duration=1.0)) == []
    assert harness.manager.handle(Answered(WorkWanted("t1", "nobody", Activity.QUOTE), Quoted(price=1.0, duration=1.0)), NOW) == []


def test_what_is_offered_is_named_to_who_wants_something_else() -> None:
    effects = ServiceManagerHarness("Washer2.Fly#s1").ask(msgspec.structs.replace(ARRANGE, service_type="Fly"))
    assert bodies(effects) == [frp.Refuse(reason="Washer1 offers WashObject, WashObject, DryObject, and not Fly")]
