"""Converts multi-agent problems to classical PDDL, for validators and planners without agents.

The conversion is that of CoDMAP: the agent becomes the first parameter of the action, and private parts become public.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from somrs.sites.pddl.text import Group, Node, Word


def classical(root: Group) -> str:
    """The text of a domain or problem file without agents and privacy."""
    sections = [_section(item) if isinstance(item, Group) else item for item in root.items]
    return "(define\n" + "\n".join(f"  {_format_node(section)}" for section in sections[1:] if section is not None) + "\n)\n"


def _section(section: Group) -> Group | None:
    match section.head:
        case ":requirements":
            requirements = tuple(
                item for item in section.items if not (isinstance(item, Word) and item.text in (":multi-agent", ":unfactored-privacy"))
            )
            return Group(requirements, section.line) if len(requirements) > 1 else None
        case ":predicates" | ":functions":
            return Group((section.items[0], *map(_distinct, _open(section.items[1:]))), section.line)
        case ":objects" | ":constants":
            public = [item for item in section.items[1:] if not _private(item)]
            private = [item for group in section.items[1:] if isinstance(group, Group) and _private(group) for item in group.items[2:]]
            # Typed names come before untyped ones, which would otherwise get the next type.
            return Group((section.items[0], *_typed([*private, *public])), section.line)
        case ":action":
            return _action(section)
    return section


def _typed(items: list[Node]) -> Iterator[Node]:
    """The items without types that follow no name, as in `p0 - part - board`; some parsers reject them."""
    named = False
    rest = iter(items)
    for item in rest:
        if isinstance(item, Word) and item.text == "-" and not named:
            next(rest, None)
            continue
        yield item
        if isinstance(item, Word) and item.text == "-":
            yield from islice(rest, 1)
            named = False
        else:
            named = True


def _private(node: Node) -> bool:
    return isinstance(node, Group) and node.head == ":private"


def _open(items: tuple[Node, ...]) -> Iterator[Node]:
    for item in items:
        if isinstance(item, Group) and item.head == ":private":
            yield from (inner for inner in item.items[1:] if isinstance(inner, Group))
        else:
            yield item


def _distinct(signature: Node) -> Node:
    """The signature with different names for its parameters; some parsers count `(in ?obj ?obj)` as one."""
    if not isinstance(signature, Group):
        return signature
    texts = [word.text if isinstance(word, Word) else "" for word in signature.items]
    words = (
        replace(word, text=f"{word.text}-{place}", written=f"{word}-{place}")
        if isinstance(word, Word) and word.text.startswith("?") and word.text in texts[:place]
        else word
        for place, word in enumerate(signature.items)
    )
    return Group(tuple(words), signature.line)


def _action(section: Group) -> Group:
    items = [*section.items]
    words = [item.text if isinstance(item, Word) else "" for item in items]
    if ":agent" not in words:
        return section
    start = words.index(":agent")
    end = next((place for place in range(start + 1, len(words)) if words[place].startswith(":")), len(words))
    agent = items[start + 1 : end]
    del items[start:end]
    for place, item in enumerate(items):
        if isinstance(item, Word) and item.text == ":parameters" and place + 1 < len(items):
            following = items[place + 1]
            items[place + 1] = Group((*agent, *(following.items if isinstance(following, Group) else ())), section.line)
            return Group(tuple(items), section.line)
    parameters = (Word(":parameters", ":parameters", section.line), Group(tuple(agent), section.line))
    return Group((*items[:2], *parameters, *items[2:]), section.line)


def _format_node(node: Node) -> str:
    if isinstance(node, Group) and node.head in (":init", ":action", ":predicates"):
        return f"({' '.join(map(str, node.items[:1]))}\n" + "\n".join(f"    {item}" for item in node.items[1:]) + ")"
    return str(node)
