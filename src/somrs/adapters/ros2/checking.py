"""Checks bindings against the robots that run: whether there is what they name, with the types and fields that they say.

Nothing is sent to the robots.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

from somrs.adapters.ros2.binding_file import read_binding
from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.lines import EndpointKind, Examine, Examined
from somrs.adapters.ros2.poses import goal_values
from somrs.adapters.ros2.process import BridgeProcess, missing_programs
from somrs.adapters.ros2.settings import Binding, Level, RobotSettings, Step, Topic, full_name, read_settings
from somrs.adapters.ros2.templates import fill_in
from somrs.errors import InputError, SettingsError

PAUSE = 0.5
"""Seconds between two looks for what is not there yet."""
SAMPLE: Mapping[str, Any] = {
    **goal_values((0.0, 0.0), [Pose(1.0, 0.0, 0.0)], Level()),
    **dict.fromkeys(("robot", "thing", "support", "charger"), "Name"),
    "speed": 0.5,
}
"""Values of templates: what is sent is made of them, to see whether its type has such fields."""


class Endpoint(Struct, frozen=True):
    """Something that a binding names. `place`: where in the binding; `is_needed`: it is a problem if it is not there; or else it is left
    out then."""

    robot: str
    place: str
    examination: Examine
    is_needed: bool = True


class EndpointRow(Struct, frozen=True):
    """What was found of it. `problem`: empty if it is as it should be."""

    robot: str
    place: str
    name: str
    type: str
    problem: str


def endpoints_of(robot: str, settings: RobotSettings, binding: Binding) -> Iterator[Endpoint]:
    """All that the binding of a robot names."""

    def named(
        place: str,
        kind: EndpointKind,
        name: str,
        type: str,
        template: Mapping[str, Any],
        fields: Sequence[str] = (),
        *,
        needed: bool = True,
    ) -> Endpoint:
        values = fill_in(template, SAMPLE)
        name = full_name(name, settings.namespace)
        return Endpoint(robot, place, Examine(id=0, kind=kind, name=name, type=type, template=values, fields=tuple(fields)), needed)

    def read(place: str, topic: Topic, *, needed: bool = True) -> Endpoint:
        return named(place, EndpointKind.TOPIC, topic.topic, topic.type, {}, [topic.field] if topic.field else (), needed=needed)

    def carried_out(place: str, steps: Sequence[Step]) -> Iterator[Endpoint]:
        for index, step in enumerate(steps):
            kind, name = (
                (EndpointKind.ACTION, step.action)
                if step.action is not None
                else (EndpointKind.SERVICE, step.service)
                if step.service is not None
                else (EndpointKind.PUBLICATION, step.topic)
            )
            yield named(f"{place}.{index}", kind, name or "", step.type, step.template, [*step.succeeds])

    if binding.pose is not None:
        yield read("pose", binding.pose)
    else:
        yield named("transform.tf", EndpointKind.TOPIC, binding.transform.tf, binding.transform.type, {})
    if binding.covariance is not None:
        yield read("localization", binding.covariance, needed="localization" in binding.model_fields_set)
    if binding.odometry is not None:
        yield read("odometry", binding.odometry)
    navigate = binding.navigate
    fields = [navigate.problem] if "problem" in navigate.model_fields_set else []
    yield named("navigate", EndpointKind.ACTION, navigate.action, navigate.type, navigate.template, fields)
    if (limit := binding.speed_limit) is not None:
        yield named("speed_limit", EndpointKind.PUBLICATION, limit.topic, limit.type, limit.message)
    yield from carried_out("pick", binding.pick)
    yield from carried_out("drop", binding.drop)
    if binding.put_down is not None:
        yield from carried_out("put_down.steps", binding.put_down.steps)
    if binding.charge is not None:
        yield from carried_out("charge.begin", binding.charge.begin)
        yield from carried_out("charge.end", binding.charge.end)
    for index, level in enumerate(settings.levels):
        yield from carried_out(f"levels.{index}.enter", level.enter)
    for attribute, topic in binding.attributes.items():
        yield read(f"attributes.{attribute}", topic)
    for index, fault in enumerate(binding.faults):
        yield read(f"faults.{index}", fault)


async def check_bindings(settings: Mapping[str, Any], folder: Path, patience: float) -> list[EndpointRow]:
    """Check the bindings of the settings of a site. `patience`: for how long what is not there is looked for, s. Raises InputError."""
    read = read_settings(settings)
    endpoints = [
        endpoint for name, robot in read.robots.items() for endpoint in endpoints_of(name, robot, read_binding(folder / robot.binding))
    ]
    if mistakes := [*missing_programs(read, folder)]:
        raise SettingsError("ros2", mistakes)
    bridge = BridgeProcess(read, folder)
    running = asyncio.create_task(bridge.run_once())
    checking = asyncio.create_task(_rows(bridge, endpoints, patience))
    try:
        await asyncio.wait({running, checking}, return_when=asyncio.FIRST_COMPLETED)
        if not checking.done():
            raise InputError(
                f"adapters.ros2: the bridge does not run with {bridge.python}; what it says is above; is it the Python of your ROS?"
            )
        return checking.result()
    finally:
        checking.cancel()
        running.cancel()
        await asyncio.wait({running, checking})


async def _rows(bridge: BridgeProcess, endpoints: Sequence[Endpoint], patience: float) -> list[EndpointRow]:
    loop = asyncio.get_running_loop()
    end_time = loop.time() + patience
    answers: dict[int, Examined] = {}
    while True:
        for index, endpoint in enumerate(endpoints):
            if index not in answers or answers[index].problem:
                answers[index] = await _examined(bridge, endpoint.examination)
        if loop.time() >= end_time or not any(answer.problem and answer.may_pass for answer in answers.values()):
            break
        await asyncio.sleep(PAUSE)
    return [
        EndpointRow(
            robot=endpoint.robot,
            place=endpoint.place,
            name=endpoint.examination.name,
            type=endpoint.examination.type,
            problem=answers[index].problem,
        )
        for index, endpoint in enumerate(endpoints)
        if endpoint.is_needed or not (answers[index].problem and answers[index].may_pass)
    ]


async def _examined(bridge: BridgeProcess, request: Examine) -> Examined:
    answer: asyncio.Future[Examined] = asyncio.get_running_loop().create_future()
    bridge.session.examine(request, answer.set_result)
    return await answer
