"""A Repository with its journal on a real disk and a replica that follows it, in one process, for tests of changes and history."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TypeVar

from somrs.errors import UsageError
from somrs.kernel.component import Answered, Ask, Effect, Input, Received, Record, Send, SetTimer, Started, TimerFired
from somrs.kernel.replica import Replica, ReplicaDue
from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import (
    Alteration,
    BrokenRule,
    Consider,
    Considered,
    Define,
    Event,
    Events,
    MapPage,
    OntologyPage,
    ReadEvents,
    ReadMap,
    ReadOntology,
    Rejected,
)
from somrs.repository.component import SCHEMA, Repository
from somrs.repository.state import Contents
from somrs.storage.repository_store import repository_journal
from tests.support.lab import REPOSITORY, lab, request

B = TypeVar("B")
FOLLOWER = "http://here/follower"


class Keeper:
    """Delivers messages immediately. Entries are on disk before any effect is carried out."""

    def __init__(self, path: Path, ontology: Ontology | None = None, map: Map | None = None) -> None:
        self._initial_contents = lab() if ontology is None or map is None else (ontology, map)
        self._runner = asyncio.Runner()
        self.now = 1.0
        self._open(path)
        self.effects(Started(REPOSITORY))
        self.replica = Replica(FOLLOWER, REPOSITORY)
        self._rings_at: float | None = None
        self._follow(self.replica.start(self.now))

    def _open(self, path: Path) -> None:
        self.journal = repository_journal(path)
        try:
            self.journaled, _ = self.journal.begin(REPOSITORY, self._make_repository)
        except UsageError:
            self.journal.close()
            raise
        assert isinstance(self.journaled.component, Repository)
        self.repository = self.journaled.component

    def _make_repository(self, address: str) -> Repository:
        ontology, map = self._initial_contents
        return Repository(address, Contents(ontology=ontology, map=map))

    @property
    def contents(self) -> Contents:
        return self.repository.contents

    def restart(self, *, snapshot: bool = False) -> list[Send]:
        """Restart as after a kill or, with a snapshot, after an orderly stop. Return the messages to others than the replica."""
        if snapshot:
            self.journal.snapshot(self.journaled)
        self.journal.close()
        self._open(self.journal.disk.path)
        questions = [*self.journaled.pending.questions.items()]
        sends = [send for question, task in questions for send in self._feed(Answered(question, self.look(task)))]
        return [*sends, *self._feed(Started(REPOSITORY))]

    def close(self) -> None:
        self.journal.close()
        self._runner.close()

    def look(self, task: object) -> object:
        """Return the archive's answer to the task."""
        return self._runner.run(self._carry_out(task))

    async def _carry_out(self, task: object) -> object:
        return await self.journal.carry_out(task)

    def ask(self, body: Body, answer: type[B], identity: str | None = None) -> B:
        """Return the answer to a request. It has to be a single one, of that type."""
        self.now += 1.0
        message = request(body, identity=identity)
        replies = [reply for reply in self._feed(Received(message)) if reply.message.header.relates_to == message.header.message_id]
        (send,) = replies
        assert isinstance(send.message.body, answer), send.message.body
        return send.message.body

    def broken(self, change: Alteration) -> tuple[BrokenRule, ...]:
        """Return the rules that a rejected change violates. Consider has to return the same ones, and the change must have no effect."""
        map_before, version = self.contents.map, self.contents.version
        considered = self.ask(Consider(change=change), Considered)
        rejected = self.ask(change, Rejected)
        assert rejected.broken == considered.broken
        assert (self.contents.map, self.contents.version) == (map_before, version)
        return rejected.broken

    def events(self, query: ReadEvents | None = None) -> tuple[Event, ...]:
        return self.ask(query if query is not None else ReadEvents(limit=1000), Events).events

    def read_version(self, version: int) -> tuple[Ontology, Map]:
        """Return the ontology and the map of a version."""
        pages = [self.ask(ReadOntology(at_version=version), OntologyPage)]
        while pages[-1].more:
            pages.append(self.ask(ReadOntology(at_version=version, after=pages[-1].next), OntologyPage))
        maps = [self.ask(ReadMap(at_version=version), MapPage)]
        while maps[-1].more:
            maps.append(self.ask(ReadMap(at_version=version, after=maps[-1].objects[-1].name), MapPage))
        ontology = Ontology(definition for page in pages for definition in page.definitions.all_definitions())
        return ontology, Map([o for page in maps for o in page.objects], [f for page in maps for f in page.facts])

    def settle(self) -> None:
        """Let time pass until the replica has noticed and repaired missed updates."""
        for _ in range(20):
            if self.replica.version == self.contents.version:
                return
            self.now = max(self.now, self._rings_at or 0.0)
            self._hear(TimerFired(ReplicaDue()))
        raise AssertionError(f"the replica stays at {self.replica.version}, and the Repository is at {self.contents.version}")

    def _feed(self, event: Input) -> list[Send]:
        """Handle the input, and return the messages to others than the replica."""
        sends: list[Send] = []
        for effect in self.effects(event):
            if isinstance(effect, Ask):
                sends += self._feed(Answered(effect.question, self.look(effect.task)))
            elif isinstance(effect, Send) and effect.message.header.recipient == FOLLOWER:
                self._hear(Received(effect.message))
            elif isinstance(effect, Send):
                sends.append(effect)
        return sends

    def effects(self, event: Input) -> list[Effect]:
        """Handle the input, store it if necessary, and return the effects."""
        if SCHEMA.is_read_only(event):
            return self.repository.handle(event, self.now)
        entry = self.journaled.make_entry(event, self.now)
        self.journal.append(entry)
        effects = [effect for effect, _ in self.journaled.handle(entry)]
        for effect in effects:
            if isinstance(effect, Record):
                self.journal.store_record(effect.entry)
        return effects

    def _hear(self, event: Input) -> None:
        news = self.replica.handle(event, self.now)
        assert news is not None
        self._follow(news.effects)

    def _follow(self, effects: list[Effect]) -> None:
        for effect in effects:
            match effect:
                case Send(message):
                    self._feed(Received(message))
                case SetTimer(_, wake_time):
                    self._rings_at = wake_time


def definitions(ontology: Ontology) -> dict[tuple[str, str], object]:
    """Return the ontology in a form that can be compared independently of the order of its definitions."""
    return {(type(definition).__name__, definition.name): definition for definition in ontology}


def renaming(section: Section, name: str, new_name: str) -> Define:
    return Define(renamed=(Renaming(section=section, name=name, to=new_name),), author="Anna")
