"""Brings connections and things together: passes messages on, keeps what things said, and lets services wait for it."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping

from somrs.adapters.things.connector import Connector
from somrs.adapters.things.http import HttpConnector
from somrs.adapters.things.lapsing import Lapses
from somrs.adapters.things.messages import render
from somrs.adapters.things.model import Command, Connection, Signal, Source, Thing
from somrs.adapters.things.mqtt import MqttConnector
from somrs.adapters.things.sampling import Sampler
from somrs.adapters.things.state import News, Payload, Router, SourceKey, ThingState, readers_of, source_key
from somrs.ontology.types import PROBLEM, WORKING, Ontology, Value

log = logging.getLogger(__name__)

Observer = Callable[[], None]
ABSENCE = 5.0
"""Seconds after which people are told that nothing is heard of a thing."""

MessageObserver = Callable[[SourceKey, Payload], None]


class Hub:
    """The things of an adapter, and the connections to them."""

    def __init__(self) -> None:
        self.connectors: dict[str, Connector] = {}
        self._connections: dict[str, Connection] = {}
        self._reached_connections: set[str] = set()
        self.lost_connections: set[str] = set()
        """Those of which it is known that they are not there."""
        self.states: dict[str, ThingState] = {}
        self.ontologies: dict[str, Ontology] = {}
        """By things, what they are defined by."""
        self.sampler = Sampler()
        self.sampled = asyncio.Event()
        """Set when there may be something to report to the map."""
        self._unreadable: dict[SourceKey, str] = {}
        """The sources that cannot be read, and why."""
        self._router = Router()
        self._lapses = Lapses(self._reset, self._expire)
        self._observers: dict[str, dict[Observer, None]] = {}
        self._message_observers: dict[SourceKey, MessageObserver] = {}
        self.any_message_observers: list[MessageObserver] = []
        """Receive what no thing has as its source."""
        self.reach_observers: list[Callable[[str, bool], None]] = []

    def connect(self, connection: Connection) -> Connector:
        """The connector of a connection; it has to be run."""
        if (connector := self.connectors.get(connection.name)) is None:
            connector = self.connectors[connection.name] = self._connector(connection)
            self._connections[connection.name] = connection
        return connector

    def _connector(self, connection: Connection) -> Connector:
        match connection.kind:
            case "mqtt":
                return MqttConnector(connection, self)
            case "http":
                return HttpConnector(connection, self)
        from somrs.adapters.things.modbus import ModbusConnector  # which only few need, and takes a while to import

        return ModbusConnector(connection, self)

    # Things

    def add(self, thing: Thing, ontology: Ontology) -> ThingState:
        """Let a thing take part: its messages are received from now on. It takes the place of one of this name."""
        earlier_values = self.states[thing.name].values if thing.name in self.states else {}
        self.remove(thing.name)
        state = self.states[thing.name] = ThingState(thing, ontology)
        self.note_problem(thing.name, "")
        self.ontologies[thing.name] = ontology
        self._router.add(state)
        for source in sources_of(thing):
            self.connectors[source.connection].follow(source)
        for path, value in earlier_values.items():
            if all(signal.path != path for signal in thing.signals):
                self.sampler.note((thing.name, path), value, -math.inf)
                self._withdraw(thing.name, path)
        return state

    def remove(self, name: str) -> None:
        state = self.states.pop(name, None)
        if state is None:
            return
        self._router.remove(state)
        self.sampler.drop(name)
        self._lapses.drop(name)
        for source in sources_of(state.thing):
            if not self._router.reads(source_key(source)):
                self.connectors[source.connection].unfollow(source)

    # Messages

    def received(self, key: SourceKey, payload: Payload) -> None:
        if (observer := self._message_observers.get(key)) is not None:
            observer(key, payload)
            return
        if self._unreadable.pop(key, None) is not None:
            self._judge_readers(key)
        if self._router.reads(key):
            names: dict[str, None] = {}
            for news in self._router.received(key, payload, time.time()):
                self._take(news)
                self._lapses.heard(news)
                names[news.state.thing.name] = None
            for name in names:
                self._judge(self.states[name])
                self._tell(name)
            while self._router.complaints:
                log.warning("%s", self._router.complaints.pop())
        else:
            for any_observer in self.any_message_observers:
                any_observer(key, payload)

    def _reset(self, state: ThingState, signal: Signal) -> None:
        """A value that was TRUE for its time is FALSE."""
        state.values[signal.path], state.heard_at[signal.path] = False, time.time()
        self._take(News(state=state, signal=signal, value=False))
        self._tell(state.thing.name)

    def _expire(self, state: ThingState, signal: Signal) -> None:
        """A value of which nothing was heard for its time is not known any more."""
        state.values.pop(signal.path, None)
        state.expired.add(signal.path)
        self._withdraw(state.thing.name, signal.path)
        self._judge(state)
        self._tell(state.thing.name)

    def _withdraw(self, name: str, path: str) -> None:
        """Have the map told that a value is not known any more."""
        self.sampler.offer((name, path), None, asyncio.get_running_loop().time())
        self.sampled.set()

    def _take(self, news: News) -> None:
        """Have the map told of the news, in time."""
        thing, signal = news.state.thing, news.signal
        if signal is None:
            self._sample(thing, WORKING, news.value)
        elif thing.door is None:  # Open on the map means that a door is to stay open, and not that it is open now
            self._sample(thing, signal.path, news.value, dead_band=signal.dead_band, interval=signal.interval)

    def _sample(self, thing: Thing, path: str, value: Value, *, dead_band: float = 0.0, interval: float = 0.0) -> None:
        if path != WORKING or thing.has_working:
            self.sampler.offer((thing.name, path), value, asyncio.get_running_loop().time(), dead_band=dead_band, interval=interval)
            self.sampled.set()

    def resample(self, name: str) -> None:
        """Have the map told of all that a thing has said: it may know otherwise."""
        self.sampler.drop(name)
        if (state := self.states.get(name)) is None:
            return
        self.note_problem(name, "")
        if state.is_online is not None:
            self._sample(state.thing, WORKING, state.is_online)
        if state.thing.door is None:
            for path, value in state.values.items():
                self._sample(state.thing, path, value)

    def unreadable(self, key: SourceKey, problem: str) -> None:
        if self._unreadable.get(key) != problem:
            self._unreadable[key] = problem
            self._judge_readers(key)

    def _judge_readers(self, key: SourceKey) -> None:
        for state in self._router.states_of(key):
            self._judge(state)
            self._tell(state.thing.name)

    def reached(self, connection: str, is_reached: bool) -> None:
        if is_reached and connection in self._reached_connections:
            return
        gained, lost = self._reached_connections, self.lost_connections
        (gained if is_reached else lost).add(connection)
        (lost if is_reached else gained).discard(connection)
        for observer in self.reach_observers:
            observer(connection, is_reached)
        says_whether_they_work = self._connections[connection].kind != "mqtt"  # that the broker is away says nothing of the things
        for state in self.states.values():
            thing = state.thing
            is_only_connection = not thing.availabilities and connections_of(thing) == {connection}
            if says_whether_they_work and is_only_connection and state.is_online != is_reached:
                state.is_online = is_reached
                self._sample(thing, WORKING, is_reached)
                self._tell(thing.name)
            if connection in connections_of(thing) | orders_of(thing):
                self._judge(state)

    def silence(self, name: str) -> str | None:
        """Why it is not known how a thing is now, after its name, although it may have said something; None: it is known."""
        state = self.states.get(name)
        if state is None:
            return "has gone"
        if lost := sorted(connections_of(state.thing) & self.lost_connections):
            return f"cannot be reached: its connection {lost[0]} is not there"
        if problems := [problem for source in sources_of(state.thing) if (problem := self._unreadable.get(source_key(source)))]:
            return f"cannot be read: {problems[0]}"
        if state.is_online is False:
            places = [place.source for place, is_online in state.availability.items() if not is_online]
            return f"does not work: it says so at {places[0]}" if places else "does not work"
        if not state.values and not state.expired:
            return "has not said anything yet"
        if state.values.keys() <= state.misread and state.misread:
            return f"says of {', '.join(sorted(state.misread))} what is not understood"
        if state.values.keys() <= state.doubtful:
            return f"has said nothing of {', '.join(sorted(state.expired))} for too long"
        return None

    def _judge(self, state: ThingState) -> None:
        """Have the map told why a thing cannot be used. Doors and lifts tell it themselves. What may be over in a moment is told after a
        while."""
        thing = state.thing
        if not thing.has_problem or thing.door is not None or thing.session is not None:
            return
        problem = self.silence(thing.name) if thing.signals else None
        if problem is None and (lost := sorted(orders_of(thing) & self.lost_connections)):
            problem = f"cannot be reached: its connection {lost[0]} is not there"
        delay = ABSENCE if state.is_online is not False else 0.0
        key, now = (thing.name, PROBLEM), asyncio.get_running_loop().time()
        self.sampler.offer(key, problem or "", now + delay if problem is not None else now)
        self.sampled.set()

    def note_problem(self, name: str, problem: str) -> None:
        """The map has this problem of a thing, or none: it is told of another one."""
        self.sampler.note((name, PROBLEM), problem, -math.inf)
        if (state := self.states.get(name)) is not None:
            self._judge(state)

    def observe_messages(self, key: SourceKey, observer: MessageObserver) -> None:
        """Pass the messages of a source on."""
        self._message_observers[key] = observer

    # Services

    async def send(self, command: Command, inputs: Mapping[str, str]) -> None:
        """Send a command with the inputs of an order. Raises Rejection and InputError."""
        await self.connectors[command.connection].send(command, render(command, inputs))

    def observe(self, name: str, observer: Observer) -> None:
        """Call the observer with each message of a thing."""
        self._observers.setdefault(name, {})[observer] = None

    def unobserve(self, name: str, observer: Observer) -> None:
        self._observers.get(name, {}).pop(observer, None)

    def _tell(self, name: str) -> None:
        for observer in [*self._observers.get(name, ())]:
            observer()


def sources_of(thing: Thing) -> Iterable[Source]:
    """Where the messages of a thing come from, each once."""
    return dict.fromkeys(reader.source for reader in readers_of(thing))


def connections_of(thing: Thing) -> set[str]:
    """The connections over which a thing speaks."""
    return {source.connection for source in sources_of(thing)}


def orders_of(thing: Thing) -> set[str]:
    """The connections over which a thing gets what its services send."""
    return {command.connection for service in thing.services for command in service.commands}
