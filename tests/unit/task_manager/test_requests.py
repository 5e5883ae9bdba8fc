"""What the Repository and the Registry are asked, again and again, and what comes of their answers."""

from __future__ import annotations

import pytest

from somrs.kernel.component import Send, SetTimer
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered, Offer
from somrs.protocol.messages.envelope import Message, message_id, reply
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.task_manager.requests import PAUSE, SETTLING_TIME, ForPlan, ForReport, ReportAnswered, Requests, ServicesKnown, answer_problems
from somrs.task_manager.timers import AnswerDue
from tests.support.effects import run_effects

WORK = ServiceType(name="Work", effect="Jar1.Clean = TRUE")
PLAN, REPORT = ForPlan("task1", 1, 0), ForReport("task1")
UPDATE = UpdateMap(situation="Jar1.Clean = TRUE")
EMPTY = Ontology()


def offer(number: int) -> Offer:
    return Offer(service=f"R{number}.Work", provider=f"R{number}", provider_type="Robot", address="", service_type=WORK)


def make_requests() -> Requests:
    requests = Requests(address="tm", repository="repository", registry="registry")
    requests.start(100.0)
    return requests


def pending_message(requests: Requests) -> Message:
    (request,) = requests.pending.values()
    return request.message


def answer(requests: Requests, body: Body, now: float = 105.0, ontology: Ontology = EMPTY) -> tuple[list[object], object]:
    message = reply(pending_message(requests), body, "somebody")
    assert requests.is_answer(message)
    effects, result = run_effects(requests.answered(message, ontology, now))
    assert not requests.is_answer(message)
    return [*effects], result


def test_a_request_has_an_id_of_its_own_and_is_sent_for_a_while() -> None:
    requests = make_requests()
    send, wake = requests.update(UPDATE, REPORT, 100.0)
    id = message_id("tm", 100.0, 1)
    assert isinstance(send, Send)
    header = send.message.header
    assert (header.sender, header.recipient, header.message_id, header.reply_to) == ("tm", "repository", id, "tm")
    assert (send.message.body, send.expires_at) == (UPDATE, 110.0)
    assert wake == SetTimer(AnswerDue(id), 115.0)
    requests.start(900.0)
    assert requests.incarnation == 100.0
    send, _ = requests.discover(PLAN, 200.0)
    assert isinstance(send, Send)
    assert (send.message.header.message_id, send.message.header.recipient) == (message_id("tm", 100.0, 2), "registry")
    assert send.message.body == Discover()


def test_what_was_reported_is_answered() -> None:
    requests = make_requests()
    run_effects(requests.update(UPDATE, REPORT, 100.0))
    id = pending_message(requests).header.message_id
    effects, result = answer(requests, Updated(version=3))
    assert effects == [SetTimer(AnswerDue(id), None)]
    assert isinstance(result, ReportAnswered)
    assert (result.purpose, result.answer.body) == (REPORT, Updated(version=3))


def test_all_pages_of_services_come_together() -> None:
    requests = make_requests()
    run_effects(requests.discover(PLAN, 100.0))
    effects, result = answer(requests, Discovered(offers=(offer(1), offer(2)), more=True))
    assert result is None
    (next_message,) = [effect.message for effect in effects if isinstance(effect, Send)]
    assert next_message.body == Discover(after="R2.Work")
    _, result = answer(requests, Discovered(offers=(offer(3),)))
    assert result == ServicesKnown(PLAN, (offer(1), offer(2), offer(3)))


CHANGED = Ontology([ServiceType(name="Work", effect="Jar1.Clean = FALSE")])


@pytest.mark.parametrize(
    ("unsettled", "ontology"), [(Discovered(offers=(), unsettled=True), EMPTY), (Discovered(offers=(offer(1),)), CHANGED)]
)
def test_while_a_service_type_changes_the_registry_is_asked_again_for_some_seconds(unsettled: Discovered, ontology: Ontology) -> None:
    requests = make_requests()
    run_effects(requests.discover(PLAN, 100.0))
    effects, result = answer(requests, unsettled, 101.0, ontology)
    timer = AnswerDue(pending_message(requests).header.message_id)
    assert (effects[1:], result) == ([SetTimer(timer, 101.0 + PAUSE)], None)
    (send, _), _ = run_effects(requests.timer_fired(timer, 101.0 + PAUSE))
    assert isinstance(send, Send)
    assert send.message.body == Discover()
    assert answer(requests, unsettled, 100.0 + SETTLING_TIME, ontology)[1] == ServicesKnown(PLAN, unsettled.offers)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (Discovered(offers=(), more=True), ()),
        (Fault(code="", text="out of order"), "the Service Registry answered: out of order"),
        (Updated(version=3), "the Service Registry answered: Updated"),
    ],
)
def test_an_answer_that_names_no_services_ends_the_question(body: Body, expected: object) -> None:
    requests = make_requests()
    run_effects(requests.discover(PLAN, 100.0))
    assert answer(requests, body)[1] == ServicesKnown(PLAN, expected)  # type: ignore[arg-type]  # as it is
    assert requests.pending == {}


def test_a_request_without_an_answer_is_sent_again_until_its_time_is_over() -> None:
    requests = make_requests()
    run_effects(requests.discover(PLAN, 100.0))
    message, timer = pending_message(requests), AnswerDue(pending_message(requests).header.message_id)
    assert run_effects(requests.timer_fired(timer, 115.0)) == ([Send(message, 125.0), SetTimer(timer, 130.0)], None)
    assert run_effects(requests.timer_fired(timer, 129.0)) == ([Send(message, 130.0), SetTimer(timer, 135.0)], None)
    effects, result = run_effects(requests.timer_fired(timer, 130.0))
    assert effects == [SetTimer(timer, None)]
    assert result == ServicesKnown(PLAN, "the Service Registry answered: registry does not answer")
    assert run_effects(requests.timer_fired(timer, 145.0)) == ([], None)


def test_a_request_that_does_not_arrive_is_sent_again_too() -> None:
    requests = make_requests()
    run_effects(requests.update(UPDATE, REPORT, 100.0))
    message, timer = pending_message(requests), AnswerDue(pending_message(requests).header.message_id)
    assert run_effects(requests.delivery_failed(message, "no route", 86_499.0)) == (
        [Send(message, 86_500.0), SetTimer(timer, 86_505.0)],
        None,
    )
    _, result = run_effects(requests.delivery_failed(message, "no route", 86_500.0))
    assert isinstance(result, ReportAnswered)
    assert result.answer.body == Fault(code="env:Receiver", text="repository could not be reached: no route")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (Rejected(problems=("one", "two")), ("one", "two")),
        (Fault(code="", text="why"), ("why",)),
        (Updated(version=1), ("Updated",)),
    ],
)
def test_what_an_unwanted_answer_says(body: Body, words: tuple[str, ...]) -> None:
    requests = make_requests()
    run_effects(requests.update(UPDATE, REPORT, 100.0))
    assert answer_problems(reply(pending_message(requests), body, "somebody")) == words
