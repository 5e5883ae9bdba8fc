"""What editing an ontology with 5,000 objects on the map costs, and looking back on 10,000 changes, as the windows ask for it.

The times are of processors, of both sides together: asked and answered in one process. Run it as `python benchmarks/editing.py`.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from beside import shown
from maps import hall
from msgspec import structs

from somrs.client.client import Addresses, Client
from somrs.kernel.component import Received, Record
from somrs.kernel.pending import JournaledComponent
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
HERE = "http://here/repository"


def changed(*definitions: Definition) -> Define:
    return Define(definitions=by_kind(definitions))


def considered(repository: Repository) -> None:
    """Inside the Repository, without the way there."""
    ontology = repository.contents.ontology
    types, attributes = ontology.types, ontology.attributes
    narrow = (Constraint(attribute="PositionX", maximum=100.0),)
    asked: dict[str, Alteration] = {
        "another text for people": changed(structs.replace(types["Jar"], doc="x")),
        "a rule that half of the objects break": changed(structs.replace(types["Jar"], constraints=narrow)),
        "an attribute of all objects": changed(structs.replace(attributes["PositionX"], tolerance=0.1)),
        "a relation with 2,500 facts": changed(structs.replace(ontology.relations["isOn"], joins=("Object", "Object"))),
        "what all objects must have": changed(structs.replace(types["PhysicalObject"], required=("Label",))),
        "a type with 2,500 objects removed": Define(removed=(DefinitionKey(section=Section.TYPES, name="Jar"),)),
        "a type with 2,500 objects renamed": Define(renamed=(Renaming(section=Section.TYPES, name="Jar", to="Pot"),)),
        "an object renamed": RenameObject(name="Table7", to="Bench"),
        "an update of the map": UpdateMap(situation="Jar7 isOn Table9"),
    }
    print(f"\nconsidering, {len(repository.contents.map.objects)} objects on the map")
    for what, alteration in asked.items():
        began = time.process_time()
        tell(repository, Consider(change=alteration), what)
        print(f"  {what:46} {shown(time.process_time() - began):>10}")


def tell(repository: Repository, body: Consider | UpdateMap, identity: object) -> None:
    repository.handle(asked(body, identity), 1.0)


def asked(body: Consider | UpdateMap, identity: object) -> Received:
    return Received(Message(header=Header(sender="urn:benchmark", recipient=HERE, message_id=message_id(identity)), body=body))


def begun(journal: Journal) -> JournaledComponent:
    """The Repository that the journal has, or a new one."""
    journaled, _ = journal.begin(HERE, lambda address: Repository(address, Contents(ontology=upper(), map=hall())))
    return journaled


def filled(path: Path) -> None:
    """A file in which much happened, and which is left without a snapshot of it."""
    journal = repository_journal(path)
    journaled = begun(journal)
    assert isinstance(journaled.component, Repository)
    considered(journaled.component)
    began = time.process_time()
    for number in range(EVENTS):
        name, color = f"Jar{number % 2500}", "Red" if number % 5000 < 2500 else "Green"
        update = UpdateMap(changes=(ValueSet(name, "Color", color), ValueSet(name, "Weight", number / EVENTS)))
        entry = journaled.make_entry(asked(update, number), 1.0)
        journal.append(entry)
        for effect, _ in journaled.handle(entry):
            if isinstance(effect, Record):
                journal.store_record(effect.entry)
    journal.close()
    print(f"\n{EVENTS} updates, of which each is kept, in {shown(time.process_time() - began)}")


async def timed(what: str, ask: Callable[[], Awaitable[object]]) -> None:
    began = time.process_time()
    await ask()
    print(f"  {what:46} {shown(time.process_time() - began):>10}")


async def looked_back(path: Path) -> None:
    """Over HTTP, from the same process."""
    began = time.process_time()
    journal = repository_journal(path)
    journaled = begun(journal)
    print(f"\nlooking back on {journaled.number} changes; they were handled again in {shown(time.process_time() - began)}")
    began = time.process_time()
    journal.snapshot(journaled)
    print(f"  {'a snapshot':46} {shown(time.process_time() - began):>10}")
    journal.close()
    began = time.process_time()
    journal = repository_journal(path)
    rim = Host()
    await rim.start()
    node = rim.add_journaled("/repository", _none_made, journal, carry_out=journal.carry_out)
    print(f"  {'the start with a snapshot':46} {shown(time.process_time() - began):>10}")
    async with Client(Addresses(repository=node.address, registry=node.address, task_manager=node.address)) as client:
        await timed("the map now", client.map)
        await timed("the map at version 0", lambda: client.map(0))
        await timed("the map at version 0 again", lambda: client.map(0))
        await timed(f"the map at version {EVENTS - 100}", lambda: client.map(EVENTS - 100))
        await timed("the latest 100 events", lambda: client.read_events(ReadEvents(limit=100)))
        await timed(f"all {EVENTS} events, briefly", lambda: client.read_events(ReadEvents(limit=EVENTS, brief=True)))
        await timed(f"all {EVENTS} events", lambda: client.read_events(ReadEvents(limit=EVENTS)))
        await timed("the history of an object", lambda: client.history("Jar7"))
        await timed("undoing a change", lambda: client.undo(EVENTS))
        await timed("renaming a type with 2,500 objects", lambda: client.define(rename("Jar", "Pot")))
        await timed("undoing that", lambda: client.undo(EVENTS + 2))
    await rim.stop()
    journal.close()


def _none_made(address: str) -> Repository:
    raise AssertionError("the file has one")


def rename(name: str, to: str) -> Define:
    return Define(renamed=(Renaming(section=Section.TYPES, name=name, to=to),))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "repository.sqlite"
        filled(path)
        asyncio.run(looked_back(path))


if __name__ == "__main__":
    main()
