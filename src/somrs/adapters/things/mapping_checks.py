"""What is wrong, or odd, with things whose entries are each right by themselves: how they read and write, and what several share."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

from somrs.adapters.things.mapping import KeyPath, Plain
from somrs.adapters.things.messages import PLACEHOLDER
from somrs.adapters.things.model import Command, Signal, Thing
from somrs.entish.formula import Attribute, Comparison, Variable, literals, terms
from somrs.entish.parse import parse
from somrs.ontology.services import PROVIDER


def thing_problems(thing: Thing) -> Iterator[tuple[KeyPath, str]]:
    """What is wrong with a thing, by the key below it."""
    for service in thing.services:
        for index, command in enumerate(service.commands):
            for signal in thing.signals:
                if (problem := _difference(command, signal)) is not None:
                    yield ("services", service.type, "write", index), problem
    if thing.session is not None:
        names = [*thing.session.levels.values()]
        for storey, name in thing.session.levels.items():
            if names.count(name) > 1:
                yield ("session", "levels", storey), f"several storeys have the level {name!r}; give each its own"


def common_problems(things: Sequence[Thing]) -> Iterator[tuple[str, str]]:
    """What is wrong with several things together, by their names."""
    places = [(thing.session.connection, thing.session.place) if thing.session is not None else None for thing in things]
    for thing, place in zip(things, places, strict=True):
        rivals = [rival.name for rival, its_place in zip(things, places, strict=True) if its_place == place and rival is not thing]
        if place is not None and rivals:
            yield thing.name, f"has its session at {place[1]}, as {', '.join(rivals)}; each lift and each door has its own"


def oddities(thing: Thing) -> Iterator[str]:
    """What may be meant, and is probably not."""
    for service in thing.services:
        payloads = [str(command.payload) for command in (*service.commands, *service.interrupt)]
        sent_inputs = {name for payload in payloads for name in PLACEHOLDER.findall(payload)}
        if service.inputs and not sent_inputs and service.demand is None:
            expected = " or ".join(f"?{name}" for name in service.inputs)
            yield f"{thing.name}: {service.type} sends the same whatever is ordered; write {expected} in its payload"
        for command in service.commands:
            paths = [signal.path for signal in thing.signals if _is_same_place(command, signal) and command.register is None]
            if paths and not command.method and service.done_when is not None:
                yield (
                    f"{thing.name}: {service.type} publishes to {command.place}, where {', '.join(paths)} is read: the message itself says "
                    "that it is done, whether or not the thing does anything"
                )


def common_oddities(things: Sequence[Thing]) -> Iterator[str]:
    """What may be meant of several things together, and is probably not: they get the same messages."""
    owners: dict[tuple[str, str, str], list[str]] = {}
    for thing in things:
        for command in (command for service in thing.services for command in service.commands):
            owners.setdefault((command.connection, command.place, str(command.payload)), []).append(thing.name)
    shared_places = {place: [*dict.fromkeys(names)] for (_, place, _), names in owners.items() if len({*names}) > 1}
    for place, names in shared_places.items():
        yield f"{', '.join(names)}: {place} gets the same messages from them, so that each acts for the others, too"


def _difference(command: Command, signal: Signal) -> str | None:
    """Why what is written to a register is not what is read from it; None if it is, or if they are others."""
    register, written = signal.source.register, PLACEHOLDER.fullmatch(str(command.payload).strip())
    if register is None or command.register is None or written is None or not _is_same_place(command, signal):
        return None
    if command.register != register:
        return f"{command.place} is read as {register.encoding}, and written as {command.register.encoding}; write the same as:"
    conversion, reading = command.conversions.get(written[1]), signal.conversion
    is_inverse = (
        (conversion.scale, conversion.offset, conversion.unit, conversion.values)
        == (reading.scale, reading.offset, reading.unit, reading.values)
        if conversion is not None
        else (reading.scale, reading.offset, reading.unit, reading.values) == (1.0, 0.0, None, {})
    )
    if is_inverse:
        return None
    return f"{command.place} is read as {signal.path} otherwise; write convert: {{{written[1]}: {{inverse_of: {signal.path}}}}}"


def _is_same_place(command: Command, signal: Signal) -> bool:
    source = signal.source
    if command.register is not None and source.register is not None:
        places = [(register.table, register.address) for register in (command.register, source.register)]
        return command.connection == source.connection and places[0] == places[1]
    return (command.connection, command.place) == (source.connection, source.place)


def fits_register(payload: Plain) -> bool:
    """Whether a payload can be written to a register, as far as is known without inputs."""
    if not isinstance(payload, str) or PLACEHOLDER.search(payload) or payload.strip().lower() in ("true", "false"):
        return True
    try:
        return math.isfinite(float(payload))
    except ValueError:
        return False


def unread(formula: str, read_paths: Collection[str]) -> list[str]:
    """What a formula speaks of, besides attributes of ?Provider whose values are read."""
    parsed = parse(formula)
    relations = [str(literal) for literal in literals(parsed) if not isinstance(literal, Comparison)]
    attributes = [term for term in terms(parsed) if isinstance(term, Attribute)]
    provider_attributes = {
        attribute for attribute in attributes if isinstance(attribute.owner, Variable) and attribute.owner.name == PROVIDER
    }
    unread = [
        attribute.path if attribute in provider_attributes else str(attribute)
        for attribute in attributes
        if attribute not in provider_attributes or attribute.path not in read_paths
    ]
    return [*unread, *relations]
