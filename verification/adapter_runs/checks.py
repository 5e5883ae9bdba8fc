"""What has to hold when a run has ended: the map agrees with the world, and the robots can work again."""

from __future__ import annotations

import asyncio
import math
import time

from somrs.client.client import Client
from somrs.devices.simulator.link.link import OperatorLink
from verification.adapter_runs.site import ROBOTS

SETTLING_TIME = 40.0
"""Within this time after a task the map has to agree with the world, in seconds: an idle robot puts down what it holds."""
MOST_ERROR = 0.8
"""How far from where the map has it a robot or a thing may be, in metres: robots reckon, put
things anywhere on a support, and say of what they lay on the floor that it is where they stand."""


async def until_agreed(client: Client, operator: OperatorLink, things: tuple[str, ...]) -> list[str]:
    """Wait until the map agrees with the world. Returns in what it does not."""
    end = time.monotonic() + SETTLING_TIME
    while (problems := await _differences(client, operator, things)) and time.monotonic() < end:
        await asyncio.sleep(1.0)
    return problems


async def _differences(client: Client, operator: OperatorLink, things: tuple[str, ...]) -> list[str]:
    map, states = await client.map(), await operator.robots()
    problems = []
    for thing in things:
        seen = await operator.observe(thing)
        places = [fact.arguments[1] for relation in ("isOn", "isHeldBy") for fact in map.facts(relation) if fact.arguments[0] == thing]
        if places != [seen.support]:
            holder = f"in the gripper of {seen.held_by}" if seen.held_by else f"on {seen.support}"
            problems.append(f"{thing} is {holder}, and the map has it at {', '.join(places) or 'no place'}")
        elif (error := _error(map.objects[thing].values, (seen.x, seen.y, seen.z))) > MOST_ERROR:
            problems.append(f"{thing} is {error:.2f} m from where the map has it")
    for robot in ROBOTS:
        values, state = map.objects[robot].values, states[robot]
        if values.get("Working") is False:
            problems.append(f"the map has it that {robot} does not work")
        if (error := _error(values, (state.x, state.y, state.z or 0.0))) > MOST_ERROR:
            problems.append(f"{robot} is {error:.2f} m from where the map has it")
    for name, object in map.objects.items():
        if object.type in ("Lift", "AutomaticDoor") and object.values.get("Working") is False:
            problems.append(f"the map has it that {name} does not work")
    return problems


def _error(values: object, point: tuple[float, float, float]) -> float:
    assert isinstance(values, dict)
    return math.dist((values["PositionX"], values["PositionY"], values.get("PositionZ", 0.0)), point)
