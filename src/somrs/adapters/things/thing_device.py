"""A thing with services, as a device."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from somrs.adapters.things.connector import FIRST_PAUSE, LONGEST_PAUSE, Rejection
from somrs.adapters.things.hub import Hub
from somrs.adapters.things.messages import check_message
from somrs.adapters.things.model import Command, Thing, ThingService
from somrs.adapters.things.thing_objects import whereabouts
from somrs.entish.formula import Formula
from somrs.errors import InputError
from somrs.service_manager.sdk.device import Device, Result, Service, Situation, Task
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import fill_in


class _Refusals(NamedTuple):
    """The pause after the last message that the thing refused, s, and when it ends, in the time of the event loop."""

    pause: float
    resting_until: float


class ThingDevice(Device):
    """A thing whose services are messages."""

    def __init__(self, thing: Thing, hub: Hub) -> None:
        super().__init__(thing.name)
        self.thing, self.hub = thing, hub
        self.values = thing.values
        self._refusals: dict[str, _Refusals] = {}
        """By types of service, what the thing refused lately."""
        self._services = MappingProxyType({plan.type: _service(plan) for plan in thing.services})

    def services(self) -> Mapping[str, Service]:
        return self._services

    async def open(self) -> None:
        self.situation = await whereabouts(self.map, self.thing)
        self.hub.resample(self.name)

    async def check_ability(self, plan: ThingService, task: Task) -> None:
        """Check that the thing works, and that the service is possible now. Raises Refusal."""
        state = self.hub.states.get(self.name)
        if state is None:
            raise Refusal(f"{self.name} has gone", not_now=True)
        if state.is_online is False:
            raise Refusal(f"{self.name} does not work", not_now=True)
        if state.is_online is None and self.thing.availabilities:
            places = [str(place.source) for place in self.thing.availabilities if not state.availability.get(place)]
            raise Refusal(f"{self.name} has not said yet that it works, at {', '.join(places)}", not_now=True)
        for connection in dict.fromkeys(command.connection for command in plan.commands):
            if connection in self.hub.lost_connections:
                raise Refusal(f"the connection {connection} of {self.name} is not there", not_now=True)
        for command in plan.commands:
            try:
                check_message(command, task.order.inputs)
            except InputError as error:
                raise Refusal(f"{self.name}: {error}") from error
        if plan.demand is not None and not await task.map.holds(demand := self._formula(plan.demand, task)):
            raise Refusal(f"{demand} does not hold", condition=demand)
        if plan.condition is not None and not state.holds(condition := self._formula(plan.condition, task)):
            raise Refusal(f"{condition} does not hold", not_now=True)

    async def perform(self, plan: ThingService, task: Task) -> Situation | Result:
        """Send the messages of a service, and wait until it is done. Raises ServiceFailed."""
        await self._carry_out(plan, task)
        values = self.hub.states[self.name].values
        return Result(outputs={name: values[path] for name, path in plan.outputs.items()}) if plan.outputs else None

    async def _carry_out(self, plan: ThingService, task: Task) -> None:
        done = self._formula(plan.done_when, task) if plan.done_when is not None else None
        failed = self._formula(plan.failed_when, task) if plan.failed_when is not None else None
        state = self.hub.states[self.name]
        news = asyncio.Event()
        self.hub.observe(self.name, news.set)
        try:
            await self._send_in_time(plan, task)
            while any(path not in state.values for path in plan.outputs.values()):
                await news.wait()
                news.clear()
            has_failed = failed is not None and state.holds(failed)  # which may be of before: the next message tells
            if done is None or (plan.done_when == plan.effect and state.holds(done) and not has_failed):
                return
            while True:
                await news.wait()
                news.clear()
                if failed is not None and state.holds(failed):
                    raise ServiceFailed(f"{self.name} says {failed}", self._whereabouts())
                if state.holds(done):
                    return
                if state.is_online is False:
                    raise ServiceFailed(f"{self.name} does not work any more", self._whereabouts())
        finally:
            self.hub.unobserve(self.name, news.set)
            self.hub.resample(self.name)  # the task changes the map, too

    async def interrupt(self, plan: ThingService, task: Task) -> Situation:
        """Send what is to be sent when the service is stopped."""
        try:
            await self._send(plan.interrupt, task)
        except ServiceFailed as error:
            raise ServiceFailed(error.description, self._whereabouts()) from error
        return self._whereabouts()

    async def _send_in_time(self, plan: ThingService, task: Task) -> None:
        """Send the messages of a service; after the thing has refused them, not before a pause: it would refuse them again."""
        clock, refusals = asyncio.get_running_loop(), self._refusals.get(plan.type)
        if refusals is not None:
            await asyncio.sleep(max(0.0, refusals.resting_until - clock.time()))
        try:
            await self._send(plan.commands, task)
        except ServiceFailed:
            pause = min(2 * refusals.pause, LONGEST_PAUSE) if refusals is not None else FIRST_PAUSE
            self._refusals[plan.type] = _Refusals(pause, clock.time() + pause)
            raise
        self._refusals.pop(plan.type, None)

    async def _send(self, commands: Iterable[Command], task: Task) -> None:
        was_begun = False
        for command in commands:
            try:
                await self.hub.send(command, task.order.inputs)
            except Rejection as error:
                raise ServiceFailed(error.description, self._whereabouts(), tried=was_begun or error.is_received) from error
            except InputError as error:
                raise ServiceFailed(str(error), self._whereabouts(), tried=was_begun) from error
            was_begun = True

    def _formula(self, text: str, task: Task) -> Formula:
        return fill_in(text, self.name, task.order.inputs)

    def _whereabouts(self) -> str | None:
        """What the thing says, as a formula."""
        state = self.hub.states.get(self.name)
        situation = state.situation() if state is not None else None
        return str(situation) if situation is not None else None


def thing_device(thing: Thing, hub: Hub) -> ThingDevice:
    """The device of a thing, whose class has its type and brings its definitions."""
    kind: type[ThingDevice] = type(thing.type, (ThingDevice,), {"type": thing.type, "types": thing.definitions})
    return kind(thing, hub)


def _service(plan: ThingService) -> Service:
    async def perform(device: ThingDevice, task: Task) -> Situation | Result:
        return await device.perform(plan, task)

    async def stop(device: ThingDevice, task: Task) -> Situation:
        return await device.interrupt(plan, task)

    async def able(device: ThingDevice, task: Task) -> None:
        await device.check_ability(plan, task)

    offered_service = Service(perform, plan.type, plan.price, plan.duration, able, inputs=plan.inputs, outputs=tuple(plan.outputs))
    offered_service.name = plan.type
    offered_service.stopping(stop)
    return offered_service
