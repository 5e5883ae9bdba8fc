"""A plan that is made anew keeps what still stands of the one before."""

from __future__ import annotations

import time
from itertools import islice

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from somrs.entish import Name
from somrs.entish.parse import parse
from somrs.ontology.effects import apply_effect
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import Problem
from somrs.planner.model.validation import apply_step, validate
from somrs.planner.planning import plan
from somrs.planner.repair import prefer_repaired, prefer_shorter, repair_plan
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.runtime.virtual_time import Work
from tests.support.examples import examples
from tests.support.relay import Relay, carried, goal, problem
from tests.unit.planner.test_properties import problems


def interrupted(couriers: int, parcels: int, done_count: int, *situations: str) -> Problem:
    """The plan of a relay, after so many of its steps, and with that on the map."""
    relay_problem, steps = problem(couriers, parcels), carried(couriers, parcels)
    map = relay_problem.map
    for step in steps[:done_count]:
        map = apply_step(step, map, relay_problem)
    for text in situations:
        map = apply_effect(parse(text), map, relay_problem.ontology)
    rest = tuple(steps[done_count:])
    return replace(relay_problem, map=map, rest=rest, promised=frozenset(step.id for step in rest))


def work(steps: tuple[Step, ...]) -> list[str]:
    return [str(step) for step in steps]


def test_the_rest_of_a_plan_is_kept_without_a_search() -> None:
    interrupted_problem = interrupted(5, 10, 40)
    started_at = time.process_time()
    result = prefer_repaired(interrupted_problem, None)
    assert time.process_time() - started_at < 10, "0.2 s where it was measured; a search takes minutes"
    assert isinstance(result, Plan)
    assert validate(result, interrupted_problem) == []
    assert set(work(result.steps)) <= set(work(interrupted_problem.rest))
    assert len(result.steps) == len(interrupted_problem.rest) - 5, "the couriers need not go back at the end"


def test_what_is_so_already_and_what_only_served_that_is_left_out() -> None:
    interrupted_problem = interrupted(2, 2, 8, goal(2, 2).partition(" AND ")[2])
    result = repair_plan(replace(interrupted_problem, goal=parse(goal(2, 2))))
    assert result is not None
    assert result.steps == ()


def test_a_thing_that_lies_elsewhere_is_taken_from_there() -> None:
    """What the inputs leave open is found anew."""
    interrupted_problem = interrupted(1, 1, 0)
    take_service = interrupted_problem.services[0].service_type
    loose = replace(
        interrupted_problem,
        services=(*interrupted_problem.services[1:], type(interrupted_problem.services[0])(take_service, ("Courier0",))),
    )
    step = Step(
        id="step9", service_type="Take", inputs={"Parcel": Name("Parcel0"), "Place": Name("Place0")},
        effect=parse("Parcel0 isHeldBy Courier0"), precondition=parse("Parcel0 isOn Place1 AND Courier0 isAt Place0"), provider="Courier0",
    )  # fmt: skip
    result = repair_plan(replace(loose, rest=(step,), goal=parse("Parcel0 isHeldBy Courier0")))
    assert result is not None
    assert str(result.steps[0].precondition) == "Parcel0 isOn Place0 AND Courier0 isAt Place0"


def test_without_a_device_that_it_needs_a_plan_cannot_be_kept() -> None:
    interrupted_problem = interrupted(2, 1, 2)
    reduced_services = tuple(type(available)(available.service_type, ("Courier0",)) for available in interrupted_problem.services)
    assert repair_plan(replace(interrupted_problem, services=reduced_services)) is None
    assert repair_plan(replace(interrupted_problem, excluded=frozenset({"Parcel0"}))) is None
    assert repair_plan(interrupted_problem) is not None


def test_a_shorter_plan_is_preferred() -> None:
    """One courier may as well go the whole way."""
    interrupted_problem = interrupted(4, 1, 0)
    repaired_plan, result = repair_plan(interrupted_problem), plan(interrupted_problem)
    assert repaired_plan is not None
    assert isinstance(result, Plan)
    assert len(result.steps) < len(repaired_plan.steps)
    assert prefer_shorter(interrupted_problem, result) == result


def test_when_a_search_takes_too_long_what_is_left_is_kept() -> None:
    interrupted_problem = replace(interrupted(4, 1, 0), promised=frozenset())
    assert prefer_repaired(interrupted_problem, None) is None
    repaired_plan = prefer_shorter(interrupted_problem, NoPlan(explanation="it took too long", undecided=True))
    assert repaired_plan == repair_plan(interrupted_problem) is not None


@examples(40)
@given(problems(), st.data())
def test_whatever_is_kept_leads_to_the_goal(problem: Problem, data: st.DataObject) -> None:
    result = plan(problem)
    if not isinstance(result, Plan) or not result.steps:
        return
    count = data.draw(st.integers(0, len(result.steps)))
    map = problem.map
    for step in islice(result.steps, count):
        map = apply_step(step, map, problem)
    rest = result.steps[count:]
    repaired_plan = repair_plan(replace(problem, map=map, rest=rest))
    assert repaired_plan is not None, "nothing went wrong"
    assert len(repaired_plan.steps) <= len(rest)
    assert validate(repaired_plan, replace(problem, map=map)) == []
    missing = data.draw(st.sampled_from(result.steps))
    second_problem = replace(problem, rest=tuple(step for step in result.steps if step is not missing))
    if (second_plan := repair_plan(second_problem)) is not None:
        assert validate(second_plan, second_problem) == []


class Interrupted(Relay):
    """The first plan is the relay's; then the planner makes others."""

    def _plan(self, task: object) -> Work:
        assert isinstance(task, Problem)
        self.problems.append(task)
        yield 0.0, self.plan if len(self.problems) == 1 else prefer_repaired(task, None) or plan(task)


def test_services_committed_to_steps_that_stay_are_not_asked_again() -> None:
    relay = Interrupted(couriers=3, parcels=4)
    task = relay.submit(relay.goal)
    assert relay.world.run(1000, lambda: len(relay.started) > 12)
    arrange_count = sum(isinstance(message.body, frp.Arrange) for message in relay.world.messages)
    assert arrange_count == len(relay.plan.steps)
    header = Header(sender="client", recipient="repository", message_id=message_id("person"), reply_to="client")
    relay.world.send(Message(header=header, body=UpdateMap(situation="Parcel3 isOn Place3", author="a person")))
    relay.learn("Parcel3 isOn Place3")
    (view,) = relay.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert len(relay.problems) == 2
    assert sum(isinstance(message.body, frp.Arrange) for message in relay.world.messages) == arrange_count
    assert relay.wrong == []
    assert not any(order.endswith("Parcel3") for order in relay.started)
