"""Automatic doors and lifts among things: by messages that open and close a door, and by the session interface."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from typing import cast

import msgspec

from somrs.adapters.things.connector import Rejection
from somrs.adapters.things.http import HttpConnector
from somrs.adapters.things.hub import Hub, connections_of
from somrs.adapters.things.model import Command, Door, Session, Source, Thing
from somrs.adapters.things.mqtt import MqttConnector
from somrs.adapters.things.session import REPEAT, PassageSession
from somrs.adapters.things.session_messages import SessionRequest
from somrs.adapters.things.state import Payload, SourceKey, ThingState
from somrs.adapters.things.thing_objects import whereabouts
from somrs.devices.passage import DoorDevice, LiftDevice, PassageDevice
from somrs.traffic.passage_call import PassageCall

log = logging.getLogger(__name__)


class MappedDoor(DoorDevice):
    """A door that messages open and close. While it is wanted, and does not say that it is open, the messages are sent again."""

    def __init__(self, thing: Thing, door: Door, hub: Hub) -> None:
        super().__init__(thing.name)
        self.values, self._thing = thing.values, thing
        self._door, self._hub = door, hub
        self._connections = connections_of(thing) | {command.connection for command in (*door.open, *door.close)}
        self._news = asyncio.Event()
        self._repeater: asyncio.Task[None] | None = None
        """Opens it again, while it is wanted."""

    async def open(self) -> None:
        self.situation = await whereabouts(self.map, self._thing)
        self._hub.observe(self.name, self._heard)
        self._hub.reach_observers.append(self._reached)
        self._heard()

    async def close(self) -> None:
        self._hub.unobserve(self.name, self._heard)
        if self._reached in self._hub.reach_observers:
            self._hub.reach_observers.remove(self._reached)
        self._repeat_no_more()

    async def serve(self, call: PassageCall) -> None:
        self._repeat_no_more()
        await self._send(self._door.open)
        self._repeater = asyncio.create_task(self._repeat())
        try:
            while not self._is_open:
                self._news.clear()
                await self._news.wait()
        except asyncio.CancelledError:
            self._repeat_no_more()
            raise

    async def release(self) -> None:
        self._repeat_no_more()
        await self._send(self._door.close)

    async def _send(self, commands: Sequence[Command]) -> None:
        for command in commands:
            await self._hub.send(command, {})

    async def _repeat(self) -> None:
        """Open it again and again: the message may be lost, and a door may close by itself."""
        while True:
            await asyncio.sleep(REPEAT)
            if not self._is_open:
                try:
                    await self._send(self._door.open)
                except Rejection as error:
                    log.warning("%s: %s", self.name, error)

    def _repeat_no_more(self) -> None:
        if self._repeater is not None:
            self._repeater.cancel()
            self._repeater = None

    @property
    def _is_open(self) -> bool:
        state = self._hub.states.get(self.name)
        return state is not None and state.values.get("Open") is True

    def _heard(self) -> None:
        self._news.set()
        state = self._hub.states.get(self.name)
        is_reachable = self._connections.isdisjoint(self._hub.lost_connections)
        is_working = is_reachable and state is not None and state.is_online is not False and "Open" in state.values
        problem = self._hub.silence(self.name)
        if self.current_status is None or self.current_status.working != is_working:
            self.status(working=is_working, problem=problem)
        elif not is_working:
            self.report_problem(problem)

    def _reached(self, connection: str, is_reached: bool) -> None:
        if connection in self._connections:
            self._heard()


class SessionLink:
    """The session interface of a lift or a door: sends requests, and takes in states."""

    def __init__(self, device: PassageDevice, thing: Thing, session: Session, hub: Hub) -> None:
        self._device, self._settings, self._hub = device, session, hub
        self.session = PassageSession(f"somrs-{thing.name}", {})
        self._news = asyncio.Event()
        self._last_complaint = ""
        self._senders: set[asyncio.Task[None]] = set()
        self._repeater: asyncio.Task[None] | None = None

    @property
    def _source(self) -> Source:
        return Source(connection=self._settings.connection, place=f"{self._settings.place}/state", poll=self._settings.poll)

    async def open(self, levels: Mapping[float, str]) -> None:
        """Take in states from now on. `levels`: of a lift, the names of the levels by the heights of their floors, m."""
        call = self.session.call
        self.session = PassageSession(self.session.name, levels)
        self.session.call = call
        self._hub.observe_messages((self._settings.connection, self._source.place, None), self._heard)
        self._hub.reach_observers.append(self._reached)
        self._hub.observe(self._device.name, self._tell)
        self._hub.connectors[self._settings.connection].follow(self._source)
        self._repeater = asyncio.create_task(self._repeat())
        self._tell()

    async def close(self) -> None:
        if self._reached in self._hub.reach_observers:
            self._hub.reach_observers.remove(self._reached)
        self._hub.unobserve(self._device.name, self._tell)
        tasks = [*self._senders, *((self._repeater,) if self._repeater is not None else ())]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def serve(self, call: PassageCall) -> None:
        await self._send(self.session.called(call, self._now()))
        while not self.session.is_ready:
            self._news.clear()
            await self._news.wait()

    async def release(self) -> None:
        await self._send(self.session.called(None, self._now()))

    def _heard(self, key: SourceKey, payload: Payload) -> None:
        try:
            repeated = self.session.heard(payload if isinstance(payload, bytes) else str(payload).encode(), self._now())
        except ValueError as error:
            self._complain(str(error))
            return
        if (level := self.session.unknown_level) is not None:
            expected = ", ".join(self._settings.levels.values())
            self._complain(f"its cabin stands at the level {level!r}, which is none of {expected}; if it has a storey, correct levels:")
        if repeated is not None:
            self._send_soon(repeated)
        self._tell()

    def _complain(self, text: str) -> None:
        """Log what is wrong, once until something else is."""
        if text != self._last_complaint:
            log.warning("%s: %s", self._device.name, text)
        self._last_complaint = text

    def _tell(self) -> None:
        state = self._hub.states.get(self._device.name)
        self.session.is_reachable = state is not None and state.is_online is not False and not self._is_lost
        status = self.session.status()
        problem = self._problem(state) if not status.working else None
        if status != self._device.current_status:
            self._device.status(level=status.level, working=status.working, shared=status.shared, problem=problem)
        elif problem is not None:
            self._device.report_problem(problem)
        self._news.set()

    def _problem(self, state: ThingState | None) -> str:
        """Why the passage does not work, if it does not."""
        if self._is_lost:
            return f"cannot be reached: its connection {self._settings.connection} is not there"
        if state is None or state.is_online is False:
            return self._hub.silence(self._device.name) or "does not work"
        return f"is in the mode {self.session.state.mode}" if self.session.state is not None else "has not said anything yet"

    def _reached(self, connection: str, is_reached: bool) -> None:
        if connection == self._settings.connection:
            self._tell()

    @property
    def _is_lost(self) -> bool:
        return self._settings.connection in self._hub.lost_connections

    async def _repeat(self) -> None:
        """Send a request again that has no effect, although no state says so."""
        while True:
            await asyncio.sleep(REPEAT)
            if (request := self.session.repeat(self._now())) is not None:
                self._send_soon(request)

    def _send_soon(self, request: SessionRequest) -> None:
        sender = asyncio.create_task(self._send_again(request))
        self._senders.add(sender)
        sender.add_done_callback(self._senders.discard)

    async def _send_again(self, request: SessionRequest) -> None:
        try:
            await self._send(request)
        except Rejection as error:
            log.warning("%s: %s", self._device.name, error)

    async def _send(self, request: SessionRequest) -> None:
        connector, body = self._hub.connectors[self._settings.connection], msgspec.json.encode(request)
        if isinstance(connector, MqttConnector):
            await connector.publish(f"{self._settings.place}/request", body)
        else:
            await cast(HttpConnector, connector).request("PUT", f"{self._settings.place}/session", body)

    def _now(self) -> float:
        return asyncio.get_running_loop().time()


class SessionPassage(PassageDevice):
    """A passage with the session interface."""

    def __init__(self, thing: Thing, session: Session, hub: Hub) -> None:
        super().__init__(thing.name)
        self.values, self._thing = thing.values, thing
        self._levels = session.levels
        self._link = SessionLink(self, thing, session, hub)

    async def close(self) -> None:
        await self._link.close()

    async def serve(self, call: PassageCall) -> None:
        await self._link.serve(call)

    async def release(self) -> None:
        await self._link.release()


class SessionDoor(SessionPassage, DoorDevice):
    """A door with the session interface."""

    async def open(self) -> None:
        self.situation = await whereabouts(self.map, self._thing)
        await self._link.open({})


class SessionLift(SessionPassage, LiftDevice):
    """A lift with the session interface."""

    async def open(self) -> None:
        self.situation = await whereabouts(self.map, self._thing)
        storeys = await self.stops()
        if unknown_storeys := [storey for storey in storeys if storey not in self._levels]:
            log.warning("%s: levels: lacks %s, to which nobody rides", self.name, ", ".join(unknown_storeys))
        await self._link.open({storeys[storey]: level for storey, level in self._levels.items() if storey in storeys})


def passage_device(thing: Thing, hub: Hub) -> PassageDevice:
    """The device of a door or a lift, whose class has its type and brings its definitions."""
    attributes = {"type": thing.type, "types": thing.definitions}
    if thing.session is None:
        assert thing.door is not None, "only doors and lifts are passages"
        door: type[MappedDoor] = type(thing.type, (MappedDoor,), attributes)
        return door(thing, thing.door, hub)
    if thing.is_lift:
        lift: type[SessionLift] = type(thing.type, (SessionLift,), attributes)
        return lift(thing, thing.session, hub)
    session_door: type[SessionDoor] = type(thing.type, (SessionDoor,), attributes)
    return session_door(thing, thing.session, hub)
