"""Previews with current quotes: what a task would come to, asked of services that nobody commits to anything."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.records import TaskRecord
from somrs.protocol.messages.submission import Policy
from somrs.runtime.virtual_network import LATENCY
from somrs.task_manager.pace import LEAST_VALUES
from tests.integration.test_task_manager import GOAL
from tests.support.examples import examples
from tests.support.lab import request
from tests.support.relay import SECONDS, Relay, longest
from tests.support.virtual_system import Robot, VirtualSystem

TWO_GOALS = "Jar001 isOn Platform001 AND Tin001 isOn Platform001"


def preview(system: VirtualSystem, effect: str, **options: object) -> Previewed:
    result = system.ask(Preview(effect=effect, quotes=True, **options))  # type: ignore[arg-type]  # keyword arguments of Preview
    assert isinstance(result, Previewed), result
    return result


def all_contracts_ended(system: VirtualSystem) -> bool:
    """Whether nobody who was asked thinks that anything is under way."""
    system.world.run(2)
    arrange_headers = [message.header for message in system.world.messages if isinstance(message.body, frp.Arrange)]
    assert arrange_headers

    def state(header: Header) -> State:
        return system.device(header.recipient.removeprefix("devices/")).state_of(header.transaction or "", header.participant or "")

    return all(state(header) in (State.ENDED, State.NEW) for header in arrange_headers)


def test_services_are_asked_and_the_policy_chooses() -> None:
    for policy, chosen, price, seconds in ((Policy.PRICE, "Robot1", 10, 60), (Policy.TIME, "Robot2", 25, 30)):
        system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
        result = preview(system, GOAL, policy=policy)
        assert [
            (quotation.service, quotation.price, quotation.duration, quotation.chosen, quotation.estimate)
            for quotation in result.quotations
        ] == [
            ("Robot1.TransferObject", 10, 60, chosen == "Robot1", False),
            ("Robot2.TransferObject", 25, 30, chosen == "Robot2", False),
        ]
        (step,) = result.steps
        assert (step.service, step.price, step.duration) == (f"{chosen}.TransferObject", price, seconds)
        assert result.price == price
        assert result.seconds == pytest.approx(seconds, abs=0.2)
        assert (result.currency, result.estimate, result.unserved) == ("EUR", False, {})


def test_nobody_is_committed_and_nothing_is_left_of_it() -> None:
    robot = Robot("Robot1", 10, 60)
    system = VirtualSystem(robot)
    preview(system, GOAL)
    message_types = {
        type(message.body).__name__
        for message in system.world.messages
        if isinstance(message.body, frp.Arrange | frp.Accept | frp.Execute | frp.Cancel)
    }
    assert message_types == {"Arrange", "Cancel"}
    assert all_contracts_ended(system)
    assert system.device("Robot1").calendar(system.world.now) == []
    assert system.manager.state.tasks == {}
    assert system.manager.state.previews == {}
    assert not [entry for entry in system.world.records["tm"] if isinstance(entry, TaskRecord)]
    assert not [timer for timer in system.world.timers("tm") if getattr(timer, "owner", "")], "nothing is going to ring for it"
    (view,) = system.finish(system.submit(GOAL))
    assert view.outcome is Outcome.ACCOMPLISHED


def test_steps_that_one_device_would_do_are_put_one_after_the_other() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    result = preview(system, TWO_GOALS)
    assert result.price == 20
    assert result.seconds == pytest.approx(120, abs=0.5)
    starts = sorted(quotation.start or 0.0 for quotation in result.quotations if quotation.chosen)
    assert starts == pytest.approx([0, 60], abs=0.5)


def test_steps_that_two_devices_would_do_are_put_side_by_side() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 10, 60))
    result = preview(system, TWO_GOALS, policy=Policy.TIME)
    assert result.price == 20
    assert result.seconds == pytest.approx(60, abs=0.5)
    assert {quotation.service for quotation in result.quotations if quotation.chosen} == {"Robot1.TransferObject", "Robot2.TransferObject"}


def test_what_a_device_is_committed_to_is_minded() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit("Jar001 isOn Platform001")
    system.world.run(10)
    result = preview(system, "Tin001 isOn Platform001")
    assert result.seconds == pytest.approx(110, abs=2)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_steps_that_need_each_other_are_asked_on_what_is_promised() -> None:
    relay = Relay(couriers=3, parcels=1)
    result = preview(relay, relay.goal)
    assert len(result.steps) == 12
    assert result.seconds == pytest.approx(longest(relay.plan) * SECONDS, abs=3)
    arranges = [message.body for message in relay.world.messages if isinstance(message.body, frp.Arrange)]
    later_arranges = [arrange for arrange in arranges if (arrange.earliest_start or 0) > relay.world.now]
    assert len(later_arranges) >= 11
    assert not relay.started
    assert all_contracts_ended(relay)


def test_who_refuses_says_why_and_if_all_do_there_is_no_price() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="the battery is low"), Robot("Robot2", 25, 30))
    result = preview(system, GOAL)
    assert {quotation.service: quotation.reason for quotation in result.quotations} == {
        "Robot1.TransferObject": "the battery is low",
        "Robot2.TransferObject": "",
    }
    assert result.price == 25
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="the battery is low"))
    result = preview(system, GOAL)
    assert (result.price, result.seconds) == (None, None)
    assert result.unserved == {"step1": "no service takes it (Robot1.TransferObject: the battery is low)"}
    assert len(result.steps) == 1


def test_what_nobody_offers_is_said() -> None:
    system = VirtualSystem()
    result = preview(system, GOAL)
    assert result.steps == ()
    assert "TransferObject" in result.explanation


def test_who_would_be_done_too_late_is_out() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
    result = preview(system, GOAL, deadline=40)
    assert [quotation.service for quotation in result.quotations if quotation.chosen] == ["Robot2.TransferObject"]
    result = preview(system, GOAL, deadline=10)
    assert "latest finish" in result.unserved["step1"]


def test_who_does_not_answer_is_put_down_with_what_it_asked_last() -> None:
    mute = Robot("Robot1", 10, 60)
    system = VirtualSystem(mute, Robot("Robot2", 25, 30))
    preview(system, GOAL)
    mute.mute, start_time = True, system.world.now
    result = preview(system, GOAL)
    assert system.world.now - start_time < 3
    (guessed,) = [quotation for quotation in result.quotations if quotation.estimate]
    assert (guessed.service, guessed.price, guessed.duration, guessed.chosen) == ("Robot1.TransferObject", 10, 60, True)
    assert guessed.reason == "has not answered yet"
    assert result.estimate
    assert all_contracts_ended(system)


def test_who_never_said_anything_is_not_guessed_at() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    result = preview(system, GOAL)
    assert result.unserved == {"step1": "no service takes it (Robot1.TransferObject: has not answered yet)"}


def test_it_takes_a_few_seconds_however_long_the_plan_is_and_however_slow_the_services() -> None:
    relay = Relay(couriers=10, parcels=1)
    for address in [address for address in relay.world.components if address.startswith("devices/")]:
        relay.world.cut_off(address)
    start_time = relay.world.now
    result = preview(relay, relay.goal)
    assert relay.world.now - start_time < 7
    assert len(result.unserved) == len(result.steps)
    assert {quotation.reason for quotation in result.quotations} == {"has not answered yet", "was not asked: there was no time left"}


def test_services_that_are_all_slow_have_more_time_in_later_previews() -> None:
    def slow_terms(message: Message) -> tuple[float, ...]:
        return (6.0 if isinstance(message.body, frp.Terms) else LATENCY,)

    system = VirtualSystem(Robot("Robot1", 10, 60), medium=slow_terms)
    prices = [preview(system, GOAL).price for _ in range(LEAST_VALUES + 1)]
    assert prices == [None] * LEAST_VALUES + [10]


def test_services_that_stay_silent_are_never_awaited_longer_than_a_client_waits() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    for _ in range(20):
        start_time = system.world.now
        assert "has not answered yet" in preview(system, GOAL).unserved["step1"]
        assert system.world.now - start_time < 20


def test_a_task_that_would_wait_says_for_whom() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 20, 60))
    task = system.submit(GOAL)
    system.world.run(10)
    result = preview(system, "Jar002 isOn Cupboard002")
    assert result.waiting_for is not None
    assert [*result.waiting_for.tasks] == [task]
    assert result.waits == f"waiting for task {short_id(task)} ({GOAL}), which has reserved Jar002"
    assert len(result.steps) == 1
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    other_task = system.submit("Jar002 isOn Cupboard002")
    (view,) = system.finish(other_task)
    assert view.outcome is Outcome.ACCOMPLISHED, "the preview holds nothing"


def test_without_quotes_nobody_is_asked() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    result = system.ask(Preview(effect=GOAL))
    assert isinstance(result, Previewed)
    assert (len(result.steps), result.quotations, result.price) == (1, (), None)
    assert not [message for message in system.world.messages if isinstance(message.body, frp.Arrange)]


def test_what_is_so_already_costs_nothing() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    result = preview(system, "Jar002 isOn Cupboard001")
    assert (result.steps, result.explanation) == ((), "nothing to do: it is so already")


def test_a_wrong_formula_is_told_of() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    assert "Jarr002" in preview(system, "Jarr002 isOn Cupboard001").explanation
    assert "deadline" in preview(system, GOAL, deadline=-1.0).explanation


@pytest.mark.parametrize("snapshot", [False, True])
def test_a_task_manager_that_is_killed_while_it_asks_sends_everybody_home(snapshot: bool) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 20, 60, mute=True))
    system.world.send(request(Preview(effect=GOAL, quotes=True), sender="client", recipient="tm", identity="urn:uuid:preview"))
    assert system.world.run(5, lambda: any(isinstance(message.body, frp.Terms) for message in system.world.messages))
    system.restart_manager(snapshot=snapshot)
    system.world.run(30)
    answers = [message.body for message in system.client.received if isinstance(message.body, Previewed)]
    assert [answer.price for answer in answers] == [10]
    assert all_contracts_ended(system)
    assert system.manager.state.previews == {}


@examples(25)
@given(
    robots=st.lists(
        st.tuples(st.integers(1, 50), st.integers(5, 90), st.sampled_from(("", "", "no")), st.booleans()), min_size=1, max_size=4
    ),
    policy=st.sampled_from(Policy),
)
def test_a_task_costs_what_its_preview_said(robots: list[tuple[int, int, str, bool]], policy: Policy) -> None:
    """When nothing happens in between, whoever the preview chose does it, at the price that it said, in the time that it said."""
    system = VirtualSystem(
        *(
            Robot(f"Robot{n}", float(price), float(seconds), refuses=refusal, mute=mute)
            for n, (price, seconds, refusal, mute) in enumerate(robots, 1)
        )
    )
    result = preview(system, TWO_GOALS, policy=policy, time_value=0.3)
    if result.price is None:
        assert result.unserved
        return
    (view,) = system.finish(system.submit(TWO_GOALS, policy=policy, time_value=0.3))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert sum(step.price or 0 for step in view.steps) == result.price
    assert view.ended_at is not None
    late = 10.0 if any(mute for *_, mute in robots) else 0.0  # a task waits longer for those that say nothing
    assert result.seconds is not None
    assert view.ended_at - view.submitted_at == pytest.approx(result.seconds + late, abs=late + 2)
