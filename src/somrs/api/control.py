"""What an operator tells devices directly: stop and go on, out of service and back, go there, charge; and the modes of a building.

That a device is stopped or out of service, and a mode, is a value of its object on the map. So the history has who did it and when, it
survives restarts, and all who follow the map act on it: the simulator holds its robots, the Task Manager gives the device no work.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.api.traffic import TrafficService
from somrs.client.client import PATIENCE
from somrs.client.operations import operation
from somrs.client.refusals import NotFound
from somrs.entish.parse import nearest
from somrs.errors import SomrsError, UsageError
from somrs.ontology.modes import BUILDING, BUILDING_MODES, DOOR, LIFT, PASSAGE_MODES, Mode, modes, reason_of
from somrs.ontology.objects import Change, ValueSet
from somrs.ontology.types import IN_SERVICE, MODE, PAUSED, Value
from somrs.ontology.values import value_of
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit, Submitted
from somrs.space.storeys import span_of


class StoppedDevices(msgspec.Struct, frozen=True, kw_only=True):
    """Which devices an operator has stopped. `all`: whether there are devices, and all are stopped. `released`: those that were stopped,
    and go on by this."""

    stopped: tuple[str, ...]
    all: bool
    released: tuple[str, ...] = ()


class ObjectMode(msgspec.Struct, frozen=True, kw_only=True):
    """A building, a lift or a door with its mode. `reason`: why something waits because of it; empty in the mode `Normal`."""

    object: str
    mode: Mode
    reason: str = ""


class Modes(msgspec.Struct, frozen=True, kw_only=True):
    """The modes of all buildings, and the lifts and doors that are out of order."""

    modes: tuple[ObjectMode, ...]


class ControlService:
    def __init__(self, context: Context, traffic: TrafficService) -> None:
        self._context, self._traffic = context, traffic

    @operation("GET", "/control/stop", Right.SEE)
    async def stopping(self) -> StoppedDevices:
        """Which devices an operator has stopped."""
        names = [*self._devices(PAUSED)]
        stopped = tuple(name for name in names if self._is_stopped(name))
        return StoppedDevices(stopped=stopped, all=bool(names) and len(stopped) == len(names))

    @operation("POST", "/control/stop", Right.STOP)
    async def stop(self, device: str | None = None, storey: str | None = None, by: str = "") -> StoppedDevices:
        """Stop a device, all devices of a storey, or without either all devices. They stand still, and keep their work.

        Those of a storey are its parts, and the robots that are on it now. Devices of the simulator stop by themselves. A device of another
        make stops if its program follows `Paused` on the map.
        """
        return await self._set(await self._selected(PAUSED, device, storey), PAUSED, True, by)

    @operation("POST", "/control/release", Right.OPERATE)
    async def release(self, device: str | None = None, storey: str | None = None, by: str = "") -> StoppedDevices:
        """Let a device, all devices of a storey, or all devices go on after a stop."""
        return await self._set(await self._selected(PAUSED, device, storey), PAUSED, False, by)

    @operation("GET", "/control/mode", Right.SEE)
    async def modes(self) -> Modes:
        """The modes of all buildings, and the lifts and doors that are out of order."""
        return self._modes_with({})

    @operation("POST", "/control/mode", Right.OPERATE)
    async def set_mode(
        self, mode: Mode, building: str | None = None, lift: str | None = None, door: str | None = None, by: str = ""
    ) -> Modes:
        """Set the mode of a building, a lift or a door, or without them that of all buildings.

        `Fire` and `Emergency` are modes of buildings: robots stay where they may stand, and get no new work. `OutOfOrder` is one of lifts
        and doors: nobody uses them. `Normal` ends the other ones.
        """
        names = self._with_mode(mode, building, lift, door)
        await self._change(names, MODE, mode.value, by)
        return self._modes_with(dict.fromkeys(names, mode))

    @operation("POST", "/control/service/{device}", Right.OPERATE)
    async def service(self, device: str, active: bool = True, by: str = "") -> None:
        """Take a device out of service (`active=false`), or back. Out of service, it finishes the work that it has, and gets no more."""
        await self._set(await self._selected(IN_SERVICE, device, None), IN_SERVICE, active, by)

    @operation("POST", "/control/go/{device}", Right.OPERATE)
    async def go(self, device: str, place: str, by: str | None = None) -> Submitted:
        """Send a device to a place: a task for `DEVICE isAt PLACE`."""
        self._known(device)
        self._known(place)
        return await self._submit(f"{device} isAt {place}", by)

    @operation("POST", "/control/charge/{device}", Right.OPERATE)
    async def charge(self, device: str, by: str | None = None) -> Submitted:
        """Let a device charge its battery: a task for `DEVICE.Charge = 100`."""
        self._known(device)
        return await self._submit(f"{device}.Charge = 100", by)

    async def _submit(self, effect: str, author: str | None) -> Submitted:
        return Submitted(task=await self._context.client.submit(Submit(effect=effect), patience=PATIENCE, author=author))

    async def _set(self, names: list[str], attribute: str, value: bool, author: str) -> StoppedDevices:
        """Set the attribute of all devices at once."""
        released = tuple(name for name in names if attribute == PAUSED and not value and self._is_stopped(name))
        await self._change(names, attribute, value, author)
        stopped = {name for name in self._devices(PAUSED) if self._is_stopped(name)}
        if attribute == PAUSED:  # the map of this program may not have it yet
            stopped = stopped | {*names} if value else stopped - {*names}
        return StoppedDevices(stopped=tuple(sorted(stopped)), all=bool(stopped) and stopped >= {*self._devices(PAUSED)}, released=released)

    async def _change(self, names: list[str], attribute: str, value: Value, author: str) -> None:
        """Set the attribute of the objects at once, without regard to what others change meanwhile."""
        map, ontology = self._context.map, self._context.ontology
        changes: list[Change] = [ValueSet(name, attribute, value) for name in names if value_of(name, attribute, map, ontology) != value]
        if changes:
            await self._context.client.report(UpdateMap(changes=tuple(changes), author=author))

    def _is_stopped(self, name: str) -> bool:
        return value_of(name, PAUSED, self._context.map, self._context.ontology) is True

    def _devices(self, attribute: str) -> Iterator[str]:
        """The devices that have the attribute, by name."""
        map, ontology = self._context.map, self._context.ontology
        types = {type for type in ontology.types if ontology.is_device(type) and attribute in ontology.attributes_of(type)}
        yield from sorted(name for name, object in map.objects.items() if object.type in types)

    async def _selected(self, attribute: str, device: str | None, storey: str | None) -> list[str]:
        names = [*self._devices(attribute)]
        if not names:
            raise UsageError(f"no device on the map has the attribute {attribute}; add the attribute to the type Device of this site")
        if device is not None and storey is not None:
            raise UsageError("a device or a storey is stopped, and not both; leave one of them out")
        if device is not None:
            if device not in names:
                raise NotFound(f"there is no device {device} on the map; {nearest(device, names) or 'GET /fleet lists the devices'}")
            return [device]
        if storey is not None:
            self._known(storey)
            return await self._on_storey(storey, names)
        return names

    async def _on_storey(self, storey: str, devices: list[str]) -> list[str]:
        """Which of the devices are parts of the storey, or stand at its height and are part of no storey, such as robots. One that is under
        way is where traffic has it. Lifts are for all storeys."""
        map, ontology = self._context.map, self._context.ontology
        span, heights = span_of(storey, map, ontology), {}
        with suppress(SomrsError):  # a stop does not fail because the simulator does not answer
            heights = {robot.robot: robot.granted[0][2] for robot in (await self._traffic.read()).robots if robot.granted}

        def is_there(name: str) -> bool:
            wholes = self._wholes(name)
            if span is None or storey in wholes or any(span_of(whole, map, ontology) is not None for whole in wholes):
                return storey in wholes
            if ontology.is_subtype(map.objects[name].type, LIFT):
                return False
            height = heights.get(name, value_of(name, "PositionZ", map, ontology))
            return isinstance(height, int | float) and span[0] <= height < span[1]

        return [name for name in devices if is_there(name)]

    def _with_mode(self, mode: Mode, building: str | None, lift: str | None, door: str | None) -> list[str]:
        """The objects that are to have a mode. Raises UsageError."""
        chosen = [(type, name) for type, name in ((BUILDING, building), (LIFT, lift), (DOOR, door)) if name is not None]
        if len(chosen) > 1:
            raise UsageError("a building, a lift or a door has a mode; name one of them at a time")
        if not chosen and mode is Mode.OUT_OF_ORDER:
            raise UsageError("a lift or a door is out of order; name it")
        type, name = chosen[0] if chosen else (BUILDING, None)
        names = [*self._of_type(type)]
        if name is None and not names:
            raise UsageError(f"no object of the map is a {type}, so that none can be in the mode {mode}; add a {type} to the map")
        if name is not None and name not in names:
            raise NotFound(f"there is no {type.lower()} {name} on the map; {nearest(name, names) or 'GET /map lists the objects'}")
        if MODE not in self._context.ontology.attributes_of(type):
            raise UsageError(f"the type {type} has no attribute {MODE}; add the attribute to it in the ontology of this site")
        if mode not in (allowed := BUILDING_MODES if type == BUILDING else PASSAGE_MODES):
            raise UsageError(f"a {type.lower()} is in one of the modes {', '.join(allowed)}, and not in {mode}")
        return [name] if name is not None else names

    def _modes_with(self, latest: Mapping[str, Mode]) -> Modes:
        """The modes on the map. `latest`: modes that the map of this program may not have yet."""
        current = {**dict.fromkeys(self._of_type(BUILDING), Mode.NORMAL), **modes(self._context.map), **latest}
        buildings = {*self._of_type(BUILDING)}
        shown = ((name, mode) for name, mode in current.items() if mode is not Mode.NORMAL or name in buildings)
        return Modes(modes=tuple(ObjectMode(object=name, mode=mode, reason=reason_of(name, mode)) for name, mode in shown))

    def _of_type(self, type: str) -> Iterator[str]:
        """The objects of a type or of its subtypes, by name."""
        map, ontology = self._context.map, self._context.ontology
        yield from sorted(name for kind in ontology.types if ontology.is_subtype(kind, type) for name in map.of_type(kind))

    def _wholes(self, name: str) -> set[str]:
        """What the object is part of, directly or indirectly."""
        wholes: set[str] = set()
        whole = self._context.map.whole(name)
        while whole is not None and whole not in wholes:
            wholes.add(whole)
            whole = self._context.map.whole(whole)
        return wholes

    def _known(self, name: str) -> None:
        if name not in self._context.map.objects:
            hint = nearest(name, self._context.map.similar_names(name)) or "GET /map lists the objects"
            raise NotFound(f"there is no {name} on the map; {hint}")
