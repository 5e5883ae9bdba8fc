"""Measures changes of an ontology with 5,000 objects on the map, and queries of a history of 10,000 changes, as the windows make them.

The times are CPU times of both sides together, as both are in one process. Run it as `python benchmarks/editing.py`.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from maps import hall
from msgspec import structs
from timing import format_time

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.kernel.component import Received, Record
from somrs.kernel.durability import JournaledComponent
from somrs.ontology.files.loading import upper
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import ValueSet
from somrs.ontology.types import Constraint, Definition
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import Alteration, Consider, Define, ReadEvents, RenameObject, UpdateMap, by_kind
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal

EVENTS = 10_000
REPOSITORY_ADDRESS = "http://here/repository"


def definition_change(*definitions: Definition) -> Define:
    return Define(definitions=by_kind(definitions))


def measure_changes(repository: Repository) -> None:
    """Measure changes in the Repository itself, without the transport."""
    ontology = repository.contents.ontology
    types, attributes = ontology.types, ontology.attributes
    narrow = (Constraint(attribute="PositionX", maximum=100.0),)
    alterations: dict[str, Alteration] = {
        "another text for people": definition_change(structs.replace(types["Jar"], doc="x")),
        "a rule that half of the objects break": definition_change(structs.replace(types["Jar"], constraints=narrow)),
        "an attribute of all objects": definition_change(structs.replace(attributes["PositionX"], tolerance=0.1)),
        "a relation with 2,500 facts": definition_change(structs.replace(ontology.relations["isOn"], joins=("Object", "Object"))),
        "what all objects must have": definition_change(structs.replace(types["PhysicalObject"], required=("Label",))),
        "a type with 2,500 objects removed": Define(removed=(DefinitionKey(section=Section.TYPES, name="Jar"),)),
        "a type with 2,500 objects renamed": Define(renamed=(Renaming(section=Section.TYPES, name="Jar", to="Pot"),)),
        "an object renamed": RenameObject(name="Table7", to="Bench"),
        "an update of the map": UpdateMap(situation="Jar7 isOn Table9"),
    }
    print(f"\nconsidering, {len(repository.contents.map.objects)} objects on the map")
    for title, alteration in alterations.items():
        started_at = time.process_time()
        handle_message(repository, Consider(change=alteration), title)
        print(f"  {title:46} {format_time(time.process_time() - started_at):>10}")


def handle_message(repository: Repository, body: Consider | UpdateMap, identity: object) -> None:
    repository.handle(received_message(body, identity), 1.0)


def received_message(body: Consider | UpdateMap, identity: object) -> Received:
    return Received(
        Message(header=Header(sender="urn:benchmark", recipient=REPOSITORY_ADDRESS, message_id=message_id(identity)), body=body)
    )


def open_repository(journal: Journal) -> JournaledComponent:
    """Return the Repository that the journal contains, or a new one."""
    journaled, _ = journal.begin(REPOSITORY_ADDRESS, lambda address: Repository(address, Contents(ontology=upper(), map=hall())))
    return journaled


def fill_journal(path: Path) -> None:
    """Write a journal with many changes and without a snapshot."""
    journal = repository_journal(path)
    journaled = open_repository(journal)
    assert isinstance(journaled.component, Repository)
    measure_changes(journaled.component)
    started_at = time.process_time()
    for number in range(EVENTS):
        name, color = f"Jar{number % 2500}", "Red" if number % 5000 < 2500 else "Green"
        update = UpdateMap(changes=(ValueSet(name, "Color", color), ValueSet(name, "Weight", number / EVENTS)))
        entry = journaled.make_entry(received_message(update, number), 1.0)
        journal.append(entry)
        for effect, _ in journaled.handle(entry):
            if isinstance(effect, Record):
                journal.store_record(effect.entry)
    journal.close()
    print(f"\n{EVENTS} updates, each stored, in {format_time(time.process_time() - started_at)}")


async def time_request(title: str, ask: Callable[[], Awaitable[object]]) -> None:
    started_at = time.process_time()
    await ask()
    print(f"  {title:46} {format_time(time.process_time() - started_at):>10}")


async def measure_history(path: Path) -> None:
    """Measure queries over HTTP from the same process."""
    started_at = time.process_time()
    journal = repository_journal(path)
    journaled = open_repository(journal)
    print(f"\nqueries of {journaled.number} changes; they were replayed in {format_time(time.process_time() - started_at)}")
    started_at = time.process_time()
    journal.snapshot(journaled)
    print(f"  {'a snapshot':46} {format_time(time.process_time() - started_at):>10}")
    journal.close()
    started_at = time.process_time()
    journal = repository_journal(path)
    host = Host()
    await host.start()
    node = host.add_journaled("/repository", _refuse_new, journal, carry_out=journal.carry_out)
    print(f"  {'the start with a snapshot':46} {format_time(time.process_time() - started_at):>10}")
    async with Client(Addresses(repository=node.address, registry=node.address, task_manager=node.address)) as client:
        await time_request("the map now", client.map)
        await time_request("the map at version 0", lambda: client.map(0))
        await time_request("the map at version 0 again", lambda: client.map(0))
        await time_request(f"the map at version {EVENTS - 100}", lambda: client.map(EVENTS - 100))
        await time_request("the latest 100 events", lambda: client.read_events(ReadEvents(limit=100)))
        await time_request(f"all {EVENTS} events, briefly", lambda: client.read_events(ReadEvents(limit=EVENTS, brief=True)))
        await time_request(f"all {EVENTS} events", lambda: client.read_events(ReadEvents(limit=EVENTS)))
        await time_request("the history of an object", lambda: client.history("Jar7"))
        await time_request("undoing a change", lambda: client.undo(EVENTS))
        await time_request("renaming a type with 2,500 objects", lambda: client.define(rename("Jar", "Pot")))
        await time_request("undoing that", lambda: client.undo(EVENTS + 2))
    await host.stop()
    journal.close()


def _refuse_new(address: str) -> Repository:
    raise AssertionError("the journal contains a Repository")


def rename(name: str, new_name: str) -> Define:
    return Define(renamed=(Renaming(section=Section.TYPES, name=name, to=new_name),))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "repository.sqlite"
        fill_journal(path)
        asyncio.run(measure_history(path))


if __name__ == "__main__":
    main()
