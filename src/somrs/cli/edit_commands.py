"""Editing the ontology and the map from the command line: history, changes and their consequences, undoing, and files."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.cli.running_site import site_addresses
from somrs.client import terminal
from somrs.client.client import Client
from somrs.errors import RemoteError, UsageError
from somrs.ontology.naming import SINGULAR, DefinitionKey, Renaming, Section, key_of
from somrs.protocol.messages.knowledge import Alteration, Considered, Define, Event, MergeObject, ReadEvents, RenameObject, Revision, Undo
from somrs.protocol.messages.people import person_name
from somrs.repository.ontology_diff import diff_ontologies

if TYPE_CHECKING:
    from somrs.api.ontology import Consequences

MAX_LINES = 12
"""Maximum number of lines shown for an event."""


def _parse_section(text: str) -> Section:
    """The section of an ontology with this name, in the singular or the plural: `type`, `types`. Raises UsageError if there is none."""
    sections = {section.value: section for section in Section if section is not Section.OBJECTS}
    by_singular = {SINGULAR[section].partition(" ")[0]: section for section in sections.values()}
    section = sections.get(text) or by_singular.get(text)
    if section is None:
        raise UsageError(f"{text!r} is not a kind of definition; the kinds are {', '.join(by_singular)}")
    return section


async def history(limit: int, data: Path, *, ontology: bool, before_version: int | None, json: bool) -> None:
    """Print the events of the map and the ontology, or of the ontology only, newest first."""
    async with Client(await site_addresses(data)) as client:
        page = await client.read_events(ReadEvents(limit=limit, before=before_version, ontology=ontology))
    if json:
        terminal.print_json(page.events)
    elif not page.events:
        print("nothing changed yet" if before_version is None else f"nothing changed before version {before_version}")
    else:
        rows = (
            (event.version, terminal.moment(event.at), person_name(event.author), "\n".join(_shortened(event))) for event in page.events
        )
        terminal.console().print(terminal.table("the ontology" if ontology else "the map", ("version", "time", "author", "change"), rows))
        if page.more:
            print(f"there are more before version {page.events[-1].version}; --before {page.events[-1].version} shows them")


def _shortened(event: Event) -> list[str]:
    lines = [*describe_event(event)]
    count = (event.all_changes or len(event.changes)) - len(event.changes)
    omitted_count = max(len(lines) - MAX_LINES, 0) + count
    return [*lines[:MAX_LINES], *([f"and {omitted_count} more"] if omitted_count else [])]


def describe_event(event: Event) -> Iterator[str]:
    """The changes of an event, one per line."""
    if event.undoes is not None:
        yield f"undid version {event.undoes}"
    yield from (f"renamed {renaming}" for renaming in event.renamed)
    yield from map(str, event.merged)
    if event.revision is not None:
        yield from _describe_revision(
            event.revision,
            {(renaming.section, renaming.to) for renaming in event.renamed}
            | {(renaming.section, renaming.name) for renaming in event.renamed},
        )
    yield from map(terminal.change, event.changes)


def _describe_revision(revision: Revision, skipped_names: set[tuple[Section, str]]) -> Iterator[str]:
    """The changes of definitions, one per line, except of those in `skipped_names`."""
    definitions_before, definitions_after = (
        {key_of(definition): definition for definition in side.all_definitions()} for side in (revision.before, revision.after)
    )
    for word in dict.fromkeys((*definitions_before, *definitions_after)):
        if (word.section, word.name) in skipped_names:
            continue
        old, new = definitions_before.get(word), definitions_after.get(word)
        if old is None:
            yield f"added {word}"
        elif new is None:
            yield f"removed {word}"
        else:
            keys = [key for key in new.__struct_fields__ if getattr(old, key) != getattr(new, key)]
            yield f"changed {word}: {', '.join(keys)}"


# Changes


async def alter(alteration: Alteration, data: Path, *, dry: bool, json: bool) -> int:
    """Make the change, or with `dry` print its consequences. Returns the exit status: 0 if the change was made, or is possible."""
    async with Client(await site_addresses(data)) as client:
        return await _make_change(client, alteration, data, dry=dry, json=json)


async def _make_change(client: Client, alteration: Alteration, data: Path, *, dry: bool, json: bool) -> int:
    if dry:
        return _print_outcome(await _consider(client, alteration, data), json=json)
    match alteration:
        case Define():
            version = await client.define(alteration)
        case RenameObject():
            version = await client.rename(alteration)
        case MergeObject():
            version = await client.merge(alteration)
        case Undo(version=undone, author=author):
            version = await client.undo(undone, author)
        case _:
            version = await client.update(alteration)
    if json:
        terminal.print_json({"version": version})
    else:
        print(f"done: version {version}")
    return 0


async def _consider(client: Client, alteration: Alteration, data: Path) -> Considered | Consequences:
    """The consequences of a change: from the API if it runs, since that includes tasks, orders and templates."""
    from somrs.api.remote import api_of

    if client.addresses.api is not None:
        try:
            async with api_of(data) as api:
                match alteration:
                    case Define():
                        return await api.ontology.consider(alteration)
                    case Undo(version=undone):
                        return await api.ontology.consider_undo(undone)
        except RemoteError as error:
            print(f"affected tasks, orders and templates are not shown: {error}", file=sys.stderr)
    return await client.consider(alteration)


def _print_outcome(outcome: Considered | Consequences, *, json: bool) -> int:
    if json:
        terminal.print_json(outcome)
        return 1 if outcome.broken else 0
    lines = [*(_describe_revision(outcome.revision, set()) if outcome.revision is not None else ()), *map(terminal.change, outcome.changes)]
    omitted_count = outcome.all_changes - len(outcome.changes)
    for line in lines or ["nothing would change"]:
        print(line)
    if omitted_count:
        print(f"and {omitted_count} more changes of the map")
    if not isinstance(outcome, Considered):
        for offer in outcome.offers:
            print(f"service {offer.service}: the planner could no longer use it: {offer.problem}")
        for word_use in outcome.affected:
            print(f"{word_use.user_kind} {word_use.display_name}: {word_use}")
        if outcome.affected:
            print("tasks, orders and templates are not changed")
    for rule in outcome.broken:
        print(f"{rule.section} {rule.subject}: {rule.message} [{rule.rule}]")
    if outcome.broken:
        print(f"{outcome.all_broken} problem{'s' if outcome.all_broken != 1 else ''}: the change would be rejected")
    return 1 if outcome.broken else 0


def rename_definition(section: str, name: str, new_name: str, author: str) -> Define:
    return Define(renamed=(Renaming(section=_parse_section(section), name=name, to=new_name),), author=author)


def remove_definitions(section: str, names: Sequence[str], author: str) -> Define:
    parsed_section = _parse_section(section)
    return Define(removed=tuple(DefinitionKey(section=parsed_section, name=name) for name in names), author=author)


# Files


async def export(output: Path, data: Path, *, whole: bool) -> None:
    from somrs.ontology.files.dump import dump_ontology
    from somrs.ontology.files.levels import level_of
    from somrs.ontology.files.loading import upper

    async with Client(await site_addresses(data)) as client:
        ontology = await client.ontology()
    output.write_text(dump_ontology(ontology, upper(level_of(ontology)), "ontology", whole=whole), encoding="utf-8")
    print(f"{output}: {'the whole ontology' if whole else 'the ontology without the upper ontology'}")


async def import_definitions(file: Path, author: str, data: Path, *, dry: bool, json: bool) -> int:
    """Import the definitions of a YAML file: they are added, or replace those of the same names. Returns the exit status."""
    from somrs.ontology.files.loading import load_definitions

    text = file.read_text("utf-8-sig")
    async with Client(await site_addresses(data)) as client:
        ontology = await client.ontology()
        define = diff_ontologies(ontology, load_definitions(text, str(file), ontology), author)
        return await _make_change(client, define, data, dry=dry, json=json)
