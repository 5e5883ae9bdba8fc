"""Previews with current quotes: what a task would come to, asked of services that nobody commits to anything."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import Policy, Preview, Previewed
from somrs.protocol.messages.envelope import Header
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import TaskRecord
from tests.integration.test_task_manager import WISH
from tests.support.examples import examples
from tests.support.lab import request
from tests.support.relay import SECONDS, Relay, longest
from tests.support.virtual_system import Robot, VirtualSystem

TWO = "Jar001 isOn Platform001 AND Tin001 isOn Platform001"


def preview(system: VirtualSystem, effect: str, **more: object) -> Previewed:
    found = system.ask(Preview(effect=effect, quotes=True, **more))  # type: ignore[arg-type]  # keyword arguments of Preview
    assert isinstance(found, Previewed), found
    return found


def at_home(system: VirtualSystem) -> bool:
    """Whether nobody who was asked thinks that anything is under way."""
    system.world.run(2)
    asked = [message.header for message in system.world.messages if isinstance(message.body, frp.Arrange)]
    assert asked

    def state(header: Header) -> State:
        return system.device(header.recipient.removeprefix("devices/")).state_of(header.transaction or "", header.participant or "")

    return all(state(header) in (State.ENDED, State.NEW) for header in asked)


def test_services_are_asked_and_the_policy_chooses() -> None:
    for policy, chosen, price, seconds in ((Policy.PRICE, "Robot1", 10, 60), (Policy.TIME, "Robot2", 25, 30)):
        system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
        found = preview(system, WISH, policy=policy)
        assert [(one.service, one.price, one.duration, one.chosen, one.estimate) for one in found.quotations] == [
            ("Robot1.TransferObject", 10, 60, chosen == "Robot1", False),
            ("Robot2.TransferObject", 25, 30, chosen == "Robot2", False),
        ]
        (step,) = found.steps
        assert (step.service, step.price, step.duration) == (f"{chosen}.TransferObject", price, seconds)
        assert found.price == price
        assert found.seconds == pytest.approx(seconds, abs=0.2)
        assert (found.currency, found.estimate, found.unserved) == ("EUR", False, {})


def test_nobody_is_committed_and_nothing_is_left_of_it() -> None:
    robot = Robot("Robot1", 10, 60)
    system = VirtualSystem(robot)
    preview(system, WISH)
    said = {
        type(message.body).__name__
        for message in system.world.messages
        if isinstance(message.body, frp.Arrange | frp.Accept | frp.Execute | frp.Cancel)
    }
    assert said == {"Arrange", "Cancel"}
    assert at_home(system)
    assert system.device("Robot1").calendar(system.world.now) == []
    assert system.manager.state.tasks == {}
    assert system.manager.state.previews == {}
    assert not [one for one in system.world.records["tm"] if isinstance(one, TaskRecord)]
    assert not [timer for timer in system.world.timers("tm") if getattr(timer, "owner", "")], "nothing is going to ring for it"
    (view,) = system.finish(system.submit(WISH))
    assert view.outcome is Outcome.ACCOMPLISHED


def test_steps_that_one_device_would_do_are_put_one_after_the_other() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    found = preview(system, TWO)
    assert found.price == 20
    assert found.seconds == pytest.approx(120, abs=0.5)
    starts = sorted(one.start or 0.0 for one in found.quotations if one.chosen)
    assert starts == pytest.approx([0, 60], abs=0.5)


def test_steps_that_two_devices_would_do_are_put_side_by_side() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 10, 60))
    found = preview(system, TWO, policy=Policy.TIME)
    assert found.price == 20
    assert found.seconds == pytest.approx(60, abs=0.5)
    assert {one.service for one in found.quotations if one.chosen} == {"Robot1.TransferObject", "Robot2.TransferObject"}


def test_what_a_device_is_committed_to_is_minded() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    task = system.submit("Jar001 isOn Platform001")
    system.world.run(10)
    found = preview(system, "Tin001 isOn Platform001")
    assert found.seconds == pytest.approx(110, abs=2)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED


def test_steps_that_need_each_other_are_asked_on_what_is_promised() -> None:
    relay = Relay(couriers=3, parcels=1)
    found = preview(relay, relay.goal)
    assert len(found.steps) == 12
    assert found.seconds == pytest.approx(longest(relay.plan) * SECONDS, abs=3)
    asked = [message.body for message in relay.world.messages if isinstance(message.body, frp.Arrange)]
    later = [arrange for arrange in asked if (arrange.earliest_start or 0) > relay.world.now]
    assert len(later) >= 11
    assert not relay.begun
    assert at_home(relay)


def test_who_refuses_says_why_and_if_all_do_there_is_no_price() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="the battery is low"), Robot("Robot2", 25, 30))
    found = preview(system, WISH)
    assert {one.service: one.reason for one in found.quotations} == {
        "Robot1.TransferObject": "the battery is low",
        "Robot2.TransferObject": "",
    }
    assert found.price == 25
    system = VirtualSystem(Robot("Robot1", 10, 60, refuses="the battery is low"))
    found = preview(system, WISH)
    assert (found.price, found.seconds) == (None, None)
    assert found.unserved == {"step1": "nobody takes it (Robot1.TransferObject: the battery is low)"}
    assert len(found.steps) == 1


def test_what_nobody_offers_is_said() -> None:
    system = VirtualSystem()
    found = preview(system, WISH)
    assert found.steps == ()
    assert "TransferObject" in found.explanation


def test_who_would_be_done_too_late_is_out() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 25, 30))
    found = preview(system, WISH, deadline=40)
    assert [one.service for one in found.quotations if one.chosen] == ["Robot2.TransferObject"]
    found = preview(system, WISH, deadline=10)
    assert "latest finish" in found.unserved["step1"]


def test_who_does_not_answer_is_put_down_with_what_it_asked_last() -> None:
    mute = Robot("Robot1", 10, 60)
    system = VirtualSystem(mute, Robot("Robot2", 25, 30))
    preview(system, WISH)
    mute.mute, began = True, system.world.now
    found = preview(system, WISH)
    assert system.world.now - began < 3
    (guessed,) = [one for one in found.quotations if one.estimate]
    assert (guessed.service, guessed.price, guessed.duration, guessed.chosen) == ("Robot1.TransferObject", 10, 60, True)
    assert guessed.reason == "did not answer within 2 s"
    assert found.estimate
    assert at_home(system)


def test_who_never_said_anything_is_not_guessed_at() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, mute=True))
    found = preview(system, WISH)
    assert found.unserved == {"step1": "nobody takes it (Robot1.TransferObject: did not answer within 2 s)"}


def test_it_takes_a_few_seconds_however_long_the_plan_is_and_however_slow_the_services() -> None:
    relay = Relay(couriers=10, parcels=1)
    for address in [address for address in relay.world.components if address.startswith("devices/")]:
        relay.world.cut_off(address)
    began = relay.world.now
    found = preview(relay, relay.goal)
    assert relay.world.now - began < 7
    assert len(found.unserved) == len(found.steps)
    assert {one.reason for one in found.quotations} == {"did not answer within 2 s", "was not asked: there was no time left"}


def test_a_task_that_would_wait_says_for_whom() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 20, 60))
    task = system.submit(WISH)
    system.world.run(10)
    found = preview(system, "Jar002 isOn Cupboard002")
    assert task in found.waits
    assert "has Jar002" in found.waits
    assert len(found.steps) == 1
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    other = system.submit("Jar002 isOn Cupboard002")
    (view,) = system.finish(other)
    assert view.outcome is Outcome.ACCOMPLISHED, "the preview holds nothing"


def test_without_quotes_nobody_is_asked() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    found = system.ask(Preview(effect=WISH))
    assert isinstance(found, Previewed)
    assert (len(found.steps), found.quotations, found.price) == (1, (), None)
    assert not [message for message in system.world.messages if isinstance(message.body, frp.Arrange)]


def test_what_is_so_already_costs_nothing() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    found = preview(system, "Jar002 isOn Cupboard001")
    assert (found.steps, found.explanation) == ((), "nothing to do: it is so already")


def test_a_wrong_formula_is_told_of() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60))
    assert "Jarr002" in preview(system, "Jarr002 isOn Cupboard001").explanation
    assert "deadline" in preview(system, WISH, deadline=-1.0).explanation


@pytest.mark.parametrize("snapshot", [False, True])
def test_a_task_manager_that_is_killed_while_it_asks_sends_everybody_home(snapshot: bool) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 20, 60, mute=True))
    system.world.send(request(Preview(effect=WISH, quotes=True), sender="client", to="tm", identity="urn:uuid:preview"))
    assert system.world.run(5, lambda: any(isinstance(message.body, frp.Terms) for message in system.world.messages))
    system.restart_manager(snapshot=snapshot)
    system.world.run(30)
    answers = [message.body for message in system.client.heard if isinstance(message.body, Previewed)]
    assert [answer.price for answer in answers] == [10]
    assert at_home(system)
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
        *(Robot(f"Robot{n}", float(price), float(seconds), refuses=no, mute=mute) for n, (price, seconds, no, mute) in enumerate(robots, 1))
    )
    found = preview(system, TWO, policy=policy, time_value=0.3)
    if found.price is None:
        assert found.unserved
        return
    (view,) = system.finish(system.submit(TWO, policy=policy, time_value=0.3))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert sum(step.price or 0 for step in view.steps) == found.price
    assert view.ended_at is not None
    late = 10.0 if any(mute for *_, mute in robots) else 0.0  # a task waits longer for those that say nothing
    assert found.seconds is not None
    assert view.ended_at - view.submitted_at == pytest.approx(found.seconds + late, abs=late + 2)
