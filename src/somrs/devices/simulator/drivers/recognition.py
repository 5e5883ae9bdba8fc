"""What a camera makes of its sightings: it reports them to the Repository, which finds out which objects of the map they are.

Things and robots are sighted without names. Landmarks, such as furniture, are known by name, and so need no sighting.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from somrs.devices.simulator.drivers.simulated import SimulatedDevice, format_number, is_of_type
from somrs.devices.simulator.link.commands import CommandDone, Likeness, ObjectState, Sighting
from somrs.entish.formula import Number
from somrs.errors import RemoteError
from somrs.ontology.types import Value
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.values import as_term, term

LOOKS = ("Color", "Shape.Form", "Shape.Width", "Shape.Depth", "Shape.Radius", "Shape.Height")
"""The attributes by which cameras recognise things and robots."""

SEEN = "Seen"
"""The variable of a sighting is this word with its number."""

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Search:
    """The search of a device for an object. `like`: what it looks like; None for a landmark, which is known by name."""

    device: SimulatedDevice
    task: Task
    object: str
    like: Likeness | None
    situation: str | None = None
    """The situation of the object, when it is found."""
    seen_at: float = 0.0
    """When it was found, in seconds since 1970."""
    mistaken: bool = False
    """Whether something that looks alike turned out to be another object. It is still there, so only whole looks lead on."""

    @classmethod
    async def begin(cls, device: SimulatedDevice, task: Task) -> Search:
        object = str(task.inputs["Object"])
        recognised = [kind for kind in ("Graspable", "MobileRobot") if await is_of_type(task, object, kind)]
        return cls(device, task, object, await likeness(task, object) if recognised else None)

    @property
    def landmark(self) -> str | None:
        """The name by which the object is recognised, if it is a landmark."""
        return self.object if self.like is None else None

    @property
    def observation(self) -> Observation:
        """How the object was observed. The news of others since then are newer."""
        return Observation(as_of=self.seen_at)

    async def note(self, result: CommandDone, first_look: float, last_look: float) -> None:
        """Report what was seen, and find out whether the object is among it.

        The times are those of the first and the last picture. A command that ends when it sees the object sees it in the last one.
        """
        states = [state for state in result.object_states if state.object == self.landmark]
        if states:
            self.situation, self.seen_at = landmark_situation(states[0]), last_look
        sightings = result.sightings
        report = [part for number in reported(sightings) for part in sighting_parts(sightings, number)]
        if not report:
            return
        try:
            reception = await self.device.report(" AND ".join(report), Observation(as_of=first_look, sought=(self.object,)))
        except RemoteError as error:
            log.warning("%s: what it saw cannot be put on the map: %s", self.device.name, error)
            return
        number = next((int(variable.removeprefix(SEEN)) for variable, name in reception.names.items() if name == self.object), None)
        if number is not None:
            self.situation, self.seen_at = named_situation(sightings, number, reception.names), last_look
        elif any(sighting.alike for sighting in sightings):
            self.mistaken = True


async def likeness(task: Task, object: str) -> Likeness:
    """What the object looks like, according to the map."""
    on_map = await task.map.object(object)
    values: dict[str, Value] = {}
    for path in LOOKS:
        for row in await task.map.query(f"{object}.{path} = ?Value", limit=1):
            value = term(str(row["Value"]))
            values[path] = value.value if isinstance(value, Number) else str(row["Value"])
    return Likeness(type=on_map.type if on_map is not None else "PhysicalObject", values=values)


def reported(sightings: Sequence[Sighting]) -> list[int]:
    """The sightings to report: things that stand somewhere, what is alike, what a robot that is alike holds, and who holds what is alike.

    Other robots report themselves, and what they hold.
    """
    numbers: set[int] = set()
    for number, sighting in enumerate(sightings):
        stands = not sighting.robot and (sighting.support is not None or sighting.container is not None)
        holder = sightings[sighting.held_by] if sighting.held_by is not None else None
        if stands or sighting.alike or (holder is not None and holder.alike):
            numbers.add(number)
            if sighting.held_by is not None:
                numbers.add(sighting.held_by)
    return sorted(numbers)


def sighting_parts(sightings: Sequence[Sighting], number: int) -> Iterator[str]:
    """A sighting as parts of a formula about the variable of its number."""
    sighting = sightings[number]
    variable = f"?{SEEN}{number}"
    yield f"{variable}: {sighting.type}.PositionX = {format_number(sighting.x)}"
    yield from _pose_parts(variable, sighting, ("PositionY", "PositionZ", "RotationZ"))
    yield from (f"{variable}.{path} = {_format(value)}" for path, value in sighting.values.items())
    if sighting.held_by is not None:
        yield f"{variable} isHeldBy ?{SEEN}{sighting.held_by}"
    yield from _place_parts(variable, sighting)


def named_situation(sightings: Sequence[Sighting], number: int, names: Mapping[str, str]) -> str:
    """The situation of a sighted object: its place, its pose, its holder, what it holds, and that its position is known."""
    sighting, object = sightings[number], names[f"{SEEN}{number}"]
    parts = [*_place_parts(object, sighting)]
    holder = names.get(f"{SEEN}{sighting.held_by}")
    if holder is not None:
        parts.append(f"{object} isHeldBy {holder}")
    parts += [*_pose_parts(object, sighting, ("PositionX", "PositionY", "PositionZ", "RotationZ")), f"{object}.Unknown = FALSE"]
    if holder is not None and sighting.held_by is not None:
        parts += _pose_parts(holder, sightings[sighting.held_by], ("PositionX", "PositionY", "RotationZ"))
    held = (names.get(f"{SEEN}{i}") for i, other in enumerate(sightings) if other.held_by == number)
    return " AND ".join([*parts, *(f"{name} isHeldBy {object}" for name in held if name is not None)])


def landmark_situation(state: ObjectState) -> str:
    """The situation of a landmark: what it stands on, its pose, and that its position is known."""
    parts = [f"{state.object} isOn {state.support}"] if state.support is not None else []
    parts += _pose_parts(state.object, state, ("PositionX", "PositionY", "PositionZ", "RotationZ"))
    return " AND ".join([*parts, f"{state.object}.Unknown = FALSE"])


def _place_parts(object: str, sighting: Sighting) -> Iterator[str]:
    """What a thing is in or on. Robots stand on the floor, which is not said."""
    if sighting.container is not None:
        yield f"{object} isIn {sighting.container}"
    elif sighting.support is not None and not sighting.robot:
        yield f"{object} isOn {sighting.support}"


def _pose_parts(object: str, seen: Sighting | ObjectState, paths: Iterable[str]) -> Iterator[str]:
    pose = {"PositionX": seen.x, "PositionY": seen.y, "PositionZ": seen.z, "RotationZ": seen.yaw}
    yield from (f"{object}.{path} = {format_number(pose[path])}" for path in paths)


def _format(value: Value) -> str:
    return format_number(value) if isinstance(value, float) else str(as_term(value))
