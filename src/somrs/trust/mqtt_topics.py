"""Filters of topics of MQTT (3.1.1, 4.7), and the subjects of NATS that its servers make of them."""

from __future__ import annotations

from somrs.errors import UsageError
from somrs.trust.identity import Identity, Role

EVERYTHING = "#"
"""The filter of all topics but those that begin with `$`."""

_FORBIDDEN = frozenset(" \t\r\n\0*>")
"""Characters that NATS takes in no topic."""


def check_topics(identity: Identity) -> None:
    """Raises UsageError for a filter that is none, and for a thing without topics, which may do nothing."""
    for topics in identity.topics:
        levels = topics.split("/")
        is_misplaced = any({*level} & {"+", "#"} and level not in ("+", "#") for level in levels) or "#" in levels[:-1]
        if not topics or topics.startswith("$") or is_misplaced:
            form = "write it as in uagv/v2/ACME/0001/#, where + is any level, and # all that follow"
            raise UsageError(f"{topics!r} is no filter of topics: {form}")
        if _FORBIDDEN & {*topics}:
            raise UsageError(f"{topics!r}: the bus takes no spaces, * and > in topics: name the thing otherwise")
    if Role.THING in identity.roles and not identity.topics:
        raise UsageError(f"{identity.name} could do nothing: say which topics it uses, such as --topic 'uagv/v2/ACME/0001/#'")


def subjects_of(topics: str) -> list[str]:
    """The subjects of NATS for the topics of a filter. `a/#` covers `a`, too."""
    levels = topics.split("/")
    subject = ".".join(_token(level) for level in levels)
    return [subject] if levels[-1] != "#" or len(levels) == 1 else [subject, subject.removesuffix(".>")]


def _token(level: str) -> str:
    """The token of a level. NATS has tokens for what its subjects cannot have: an empty level, and points."""
    return {"+": "*", "#": ">", "": "/"}.get(level, level.replace(".", "//"))
