"""Editing the ontology and the map from the command line: what changed, what would come of a change, undoing, and files."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.client import terminal
from somrs.client.client import Addresses, Client
from somrs.errors import RemoteError, UsageError
from somrs.ontology.naming import SINGULAR, DefinitionKey, Renaming, Section, key_of
from somrs.protocol.messages.knowledge import Alteration, Considered, Define, Event, ReadEvents, RenameObject, Revision, Undo
from somrs.protocol.messages.people import person_name
from somrs.repository.ontology_diff import diff_ontologies

if TYPE_CHECKING:
    from somrs.api.ontology import Consequences

LONG = 12
"""So many lines of what an event changed are shown."""


def section_called(text: str) -> Section:
    """The section of an ontology that a person means: `type`, `types`, `service`."""
    known = {section.value: section for section in Section if section is not Section.OBJECTS}
    by_one = {SINGULAR[section].partition(" ")[0]: section for section in known.values()}
    found = known.get(text) or by_one.get(text)
    if found is None:
        raise UsageError(f"{text!r} is no part of an ontology; say one of {', '.join(by_one)}")
    return found


async def history(limit: int, data: Path, *, ontology: bool, before: int | None, json: bool) -> None:
    """What happened to the map and the ontology, or to that only, newest first."""
    async with Client(Addresses.read(data)) as client:
        found = await client.read_events(ReadEvents(limit=limit, before=before, ontology=ontology))
    if json:
        terminal.print_json(found.events)
    elif not found.events:
        print("nothing changed yet" if before is None else f"nothing changed before version {before}")
    else:
        rows = (
            (event.version, terminal.moment(event.at), person_name(event.author), "\n".join(_shortened(event))) for event in found.events
        )
        terminal.console().print(terminal.table("the ontology" if ontology else "the map", ("version", "when", "who", "what"), rows))
        if found.more:
            print(f"and more before version {found.events[-1].version}; --before {found.events[-1].version} shows them")


def _shortened(event: Event) -> list[str]:
    lines = [*told(event)]
    count = (event.all_changes or len(event.changes)) - len(event.changes)
    left = max(len(lines) - LONG, 0) + count
    return [*lines[:LONG], *([f"and {left} more"] if left else [])]


def told(event: Event) -> Iterator[str]:
    """What an event changed, a line each."""
    if event.undoes is not None:
        yield f"undid version {event.undoes}"
    yield from (f"renamed {renaming}" for renaming in event.renamed)
    if event.revision is not None:
        yield from revised(
            event.revision, {(one.section, one.to) for one in event.renamed} | {(one.section, one.name) for one in event.renamed}
        )
    yield from map(terminal.change, event.changes)


def revised(revision: Revision, known: set[tuple[Section, str]]) -> Iterator[str]:
    """What became of definitions, but for those of which it is `known`."""
    before, after = ({key_of(one): one for one in side.all_definitions()} for side in (revision.before, revision.after))
    for what in dict.fromkeys((*before, *after)):
        if (what.section, what.name) in known:
            continue
        old, new = before.get(what), after.get(what)
        if old is None:
            yield f"added {what}"
        elif new is None:
            yield f"removed {what}"
        else:
            keys = [key for key in new.__struct_fields__ if getattr(old, key) != getattr(new, key)]
            yield f"changed {what}: {', '.join(keys)}"


# Changing


async def alter(alteration: Alteration, data: Path, *, dry: bool, json: bool) -> int:
    """Make the change, or only say what would come of it; 0 when it is made, or could be."""
    async with Client(Addresses.read(data)) as client:
        return await _altered(client, alteration, dry=dry, json=json)


async def _altered(client: Client, alteration: Alteration, *, dry: bool, json: bool) -> int:
    if dry:
        return _considered(await _consider(client, alteration), json=json)
    match alteration:
        case Define():
            version = await client.define(alteration)
        case RenameObject():
            version = await client.rename(alteration)
        case Undo(version=undone, author=author):
            version = await client.undo(undone, author)
        case _:
            version = await client.update(alteration)
    if json:
        terminal.print_json({"version": version})
    else:
        print(f"done: version {version}")
    return 0


async def _consider(client: Client, alteration: Alteration) -> Considered | Consequences:
    """What would come of it: as the API knows it, where it runs, since it knows of tasks, orders and templates, too."""
    from somrs.api.remote import api_of

    if client.addresses.api is not None:
        try:
            async with api_of(client.addresses) as api:
                match alteration:
                    case Define():
                        return await api.ontology.consider(alteration)
                    case Undo(version=undone):
                        return await api.ontology.consider_undo(undone)
        except RemoteError as error:
            print(f"without the tasks, orders and templates that it would concern: {error}", file=sys.stderr)
    return await client.consider(alteration)


def _considered(found: Considered | Consequences, *, json: bool) -> int:
    if json:
        terminal.print_json(found)
        return 1 if found.broken else 0
    lines = [*(revised(found.revision, set()) if found.revision is not None else ()), *map(terminal.change, found.changes)]
    left = found.all_changes - len(found.changes)
    for line in lines or ["nothing would change"]:
        print(line)
    if left:
        print(f"and {left} more changes of the map")
    if not isinstance(found, Considered):
        for offer in found.offers:
            print(f"service {offer.service}: it could not be planned with any more: {offer.problem}")
        for one in found.affected:
            print(f"{one.user_kind} {one.display_name}: {one}")
        if found.affected:
            print("tasks, orders and templates keep the words that they have")
    for rule in found.broken:
        print(f"{rule.section} {rule.subject}: {rule.message} [{rule.rule}]")
    if found.broken:
        print(f"{found.all_broken} problem{'s' if found.all_broken != 1 else ''}: it would not be done")
    return 1 if found.broken else 0


def renaming(section: str, name: str, to: str, author: str) -> Define:
    return Define(renamed=(Renaming(section=section_called(section), name=name, to=to),), author=author)


def removing(section: str, names: Sequence[str], author: str) -> Define:
    of = section_called(section)
    return Define(removed=tuple(DefinitionKey(section=of, name=name) for name in names), author=author)


# Files


async def export(out: Path, data: Path, *, whole: bool) -> None:
    from somrs.ontology.files.dump import dump_ontology
    from somrs.ontology.files.loading import upper

    async with Client(Addresses.read(data)) as client:
        ontology = await client.ontology()
    out.write_text(dump_ontology(ontology, upper(), "ontology", whole=whole), encoding="utf-8")
    print(f"{out}: {'all' if whole else 'what the upper ontology does not have'}")


async def take_over(file: Path, author: str, data: Path, *, dry: bool, json: bool) -> int:
    """Have the definitions of a file added, or put in place of those of the same names."""
    from somrs.ontology.files.loading import load_definitions

    text = file.read_text("utf-8-sig")
    async with Client(Addresses.read(data)) as client:
        known = await client.ontology()
        define = diff_ontologies(known, load_definitions(text, str(file), known), author)
        return await _altered(client, define, dry=dry, json=json)
