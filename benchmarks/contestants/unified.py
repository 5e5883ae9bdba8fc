"""unified-planning (https://github.com/aiplan4eu/unified-planning) with Fast Downward on the tasks of `planning.py`: all objects of the
map, and the same services as actions."""

from __future__ import annotations

from typing import Any

from somrs.planner.model.problem import Problem


def unified_task(problem: Problem, washed: tuple[str, ...], places: dict[str, str]) -> Any:
    """Return the task of `problem` in unified-planning's form. The goal is that jars are washed and stand on places."""
    from unified_planning.shortcuts import BoolType, Equals, Fluent, InstantaneousAction, Not, Object, UserType
    from unified_planning.shortcuts import Problem as Task

    place = UserType("Place")
    jar, shelf, washer = UserType("Jar", place), UserType("Shelf", place), UserType("Washer", place)
    kinds = {"Jar": jar, "Shelf": shelf, "Washer": washer}
    placed_on, clean = Fluent("is_on", BoolType(), thing=jar, place=place), Fluent("clean", BoolType(), jar=jar)

    transfer = InstantaneousAction("transfer", thing=jar, source=place, destination=place)
    thing, source, destination = transfer.parameters
    transfer.add_precondition(placed_on(thing, source))
    transfer.add_precondition(Not(Equals(thing, destination)))
    transfer.add_effect(placed_on(thing, source), False)
    transfer.add_effect(placed_on(thing, destination), True)
    wash = InstantaneousAction("wash", thing=jar, provider=washer)
    wash.add_precondition(placed_on(wash.parameters[0], wash.parameters[1]))
    wash.add_effect(clean(wash.parameters[0]), True)

    task = Task("store")
    for fluent in (placed_on, clean):
        task.add_fluent(fluent, default_initial_value=False)
    task.add_actions([transfer, wash])
    objects = {name: Object(name, kinds[object.type]) for name, object in problem.map.objects.items()}
    task.add_objects(objects.values())
    for fact in problem.map.facts("isOn"):
        task.set_initial_value(placed_on(objects[fact.arguments[0]], objects[fact.arguments[1]]), True)
    for name in washed:
        task.add_goal(clean(objects[name]))
    for name, place_name in places.items():
        task.add_goal(placed_on(objects[name], objects[place_name]))
    return task


def steps(task: Any, seconds: float) -> int | None:
    """Return the number of steps of its plan, or None without a plan in time."""
    from unified_planning.shortcuts import OneshotPlanner, get_environment

    get_environment().credits_stream = None
    with OneshotPlanner(name="fast-downward") as planner:
        planner.skip_checks = True
        plan = planner.solve(task, timeout=seconds).plan
    return len(plan.actions) if plan is not None else None
