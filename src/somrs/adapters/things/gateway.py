"""The device that stands for the adapter: it reports what things say to the map, many at once, and recognizes their state when asked."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

from somrs.adapters.things.hub import Hub
from somrs.adapters.things.model import Thing
from somrs.adapters.things.state import situation_of
from somrs.adapters.things.thing_objects import whereabouts
from somrs.entish.formula import Formula, conjunction
from somrs.errors import RemoteError
from somrs.ontology.objects import Object, ObjectAdded, ValueSet
from somrs.ontology.types import PROBLEM, Definition, Value
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Device, Result, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed

log = logging.getLogger(__name__)

BETWEEN_REPORTS = 1.0
"""Seconds from one report to the next at least: what things say meanwhile goes together."""
BETWEEN_COMPARISONS = 30.0
"""Seconds from one comparison of the map with what devices say to the next."""
ABSENT = 1.0
"""Seconds after which it is looked again whether a device is on the map, which puts itself there."""


def _is_its_thing(device: GatewayDevice, task: Task) -> None:
    """Check that the order is about a thing of which it is known how it is now. Raises Refusal."""
    name = str(task.inputs["Object"])
    if name not in device.hub.states:
        raise Refusal(f"no mapping of things has {name}, so that {device.name} hears nothing of it")
    if (silence := device.hub.silence(name)) is not None:
        raise Refusal(f"{name} {silence}", not_now=True)


class GatewayDevice(Device):
    """Reports what things say. Things without services are objects that it puts on the map."""

    type = "Gateway"

    def __init__(self, name: str, hub: Hub) -> None:
        super().__init__(name)
        self.hub = hub
        self._present: set[str] = set()
        """Things that are known to be on the map."""
        self._absent_until: dict[str, float] = {}
        self._refused: set[str] = set()
        self._workers: list[asyncio.Task[None]] = []

    async def open(self) -> None:
        self.situation = await whereabouts(self.map, Thing(name=self.name, type=GatewayDevice.type))
        self._present, self._absent_until = set(), {}
        for name in self.hub.states:
            self.hub.resample(name)
        self._workers = [asyncio.create_task(work()) for work in (self._report_all, self._compare_all)]

    async def close(self) -> None:
        for worker in self._workers:
            worker.cancel()
        await asyncio.gather(*self._workers, return_exceptions=True)

    @service("RecognizeSituation", duration="1 s", able=_is_its_thing, occupies=False, inputs=("Object",))
    async def recognize(self, task: Task) -> Result:
        """Report what the thing has said, as of when it said it: its messages are its state."""
        name = str(task.inputs["Object"])
        if (silence := self.hub.silence(name)) is not None:
            raise ServiceFailed(f"{name} {silence}")
        state = self.hub.states[name]
        for heard_at in sorted({*state.heard_at.values()}):
            paths = [path for path, at_time in state.heard_at.items() if at_time == heard_at]
            try:
                await self.report(state.situation(paths), Observation(as_of=heard_at))
            except RemoteError as error:
                self._note_refusal(name, error)
        return Result(situation=task.effect, observation=Observation(as_of=state.known_at))

    async def _report_all(self) -> None:
        """Report what is due, until it is cancelled."""
        loop, sampler = asyncio.get_running_loop(), self.hub.sampler
        while True:
            self.hub.sampled.clear()
            names = [name for name in sampler.pending_objects() if await self._is_on_map(name)]
            values = sampler.take_due(loop.time(), names)
            if values:
                await self._report(values)
                await asyncio.sleep(BETWEEN_REPORTS)
                continue
            next_due = sampler.next_due()
            try:
                async with asyncio.timeout(max(next_due - loop.time(), BETWEEN_REPORTS) if next_due is not None else None):
                    await self.hub.sampled.wait()
            except TimeoutError:
                continue

    async def _compare_all(self) -> None:
        """Compare the map with what devices say: tasks and people change it, too."""
        while True:
            await asyncio.sleep(BETWEEN_COMPARISONS)
            for name, state in [*self.hub.states.items()]:
                readings = state.situation() if state.thing.services and name in self._present else None
                try:
                    if readings is not None and not await self.map.holds(readings):
                        self.hub.resample(name)
                except RemoteError as error:
                    self._note_refusal(name, error)

    async def _is_on_map(self, name: str) -> bool:
        """Whether a thing is on the map. One that is no device is put there."""
        now = asyncio.get_running_loop().time()
        if name in self._present:
            return True
        state = self.hub.states.get(name)
        if state is None or self._absent_until.get(name, now) > now:
            return False
        try:
            object = await self.map.object(name)
            is_on_map = object is not None or (not state.thing.is_device and await self._put_on_map(state.thing))
            if object is not None and (problem := object.values.get(PROBLEM)):  # an earlier run of this program has left it
                self.hub.note_problem(name, str(problem))
        except RemoteError as error:
            self._note_refusal(name, error)
            is_on_map = False
        if is_on_map:
            self._present.add(name)
        else:
            self._absent_until[name] = now + ABSENT
        return is_on_map

    async def _put_on_map(self, thing: Thing) -> bool:
        addition = ObjectAdded(Object(name=thing.name, type=thing.type, values=thing.values))
        situation = await whereabouts(self.map, thing)
        await self.map.report(UpdateMap(changes=(addition,), situation=situation, author=self.name))
        return True

    async def _report(self, values: Mapping[tuple[str, str], Value | None]) -> None:
        """Report the values at once; if the Repository rejects them, those of each thing, and then each by itself, so that one mistake
        does not stop the others."""
        things = {name: self.hub.states[name].thing for name, _ in values if name in self.hub.states}
        try:
            await self._report_of(values, things)
        except RemoteError as error:
            if not things:
                return  # they have left
            if len(values) == 1:
                self._note_refusal(next(iter(things)), error)
                self._present -= things.keys()  # it may have been removed from the map
                return
            parts = [{key: value} for key, value in values.items()]
            if len(things) > 1:
                parts = [{key: value for key, value in values.items() if key[0] == name} for name in things]
            for part in parts:
                await self._report(part)

    async def _report_of(self, values: Mapping[tuple[str, str], Value | None], things: Mapping[str, Thing]) -> None:
        known_values = {key: value for key, value in values.items() if value is not None}
        withdrawn = tuple(ValueSet(name, path, None) for (name, path), value in values.items() if value is None and name in things)
        situation = self._situation(known_values, things)
        if situation is not None or withdrawn:
            text = str(situation) if situation is not None else None
            await self.map.report(UpdateMap(changes=withdrawn, situation=text, author=self.name))

    def _situation(self, values: Mapping[tuple[str, str], Value], things: Mapping[str, Thing]) -> Formula | None:
        parts = [
            situation_of({key: value for key, value in values.items() if key[0] == name}, things, self.hub.ontologies[name])
            for name in things
        ]
        formulas = [part for part in parts if part is not None]
        return conjunction(*formulas) if formulas else None

    def _note_refusal(self, name: str, error: Exception) -> None:
        """Log what the Repository rejects, once for each thing."""
        if name not in self._refused:
            self._refused.add(name)
            log.warning("%s: what it says does not come onto the map: %s", name, error)


def gateway(name: str, hub: Hub, definitions: tuple[Definition, ...]) -> GatewayDevice:
    """The device for an adapter, which brings these definitions."""
    kind: type[GatewayDevice] = type(GatewayDevice.__name__, (GatewayDevice,), {"types": definitions})
    return kind(name, hub)
