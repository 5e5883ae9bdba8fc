"""Reads the declarations of a domain and a problem: types, objects, predicates, functions, actions. `formulas.py` reads conditions and
effects.

Supported is PDDL 2.1 (Fox and Long, 2003) without durations, with agents and privacy as in the MA-PDDL of CoDMAP 2015, unfactored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from somrs.sites.pddl.text import Group, Mistakes, Node, Word

OBJECT = "object"
"""PDDL's root type."""

_SECTIONS = {
    ":durative-action": "actions with durations are not supported",
    ":derived": "derived predicates are not supported",
    ":process": "processes are not supported",
    ":event": "events are not supported",
    ":constraints": "constraints on the course of a plan are not supported",
    ":htn": "task networks are not supported",
    ":task": "task networks are not supported",
    ":method": "task networks are not supported",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Typed:
    """A typed name or variable. It has several types when it is declared with `either`."""

    word: Word
    types: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.word.text.removeprefix("?")

    @property
    def written(self) -> str:
        return self.word.written.removeprefix("?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """A predicate or a function with its parameters."""

    word: Word
    parameters: tuple[Typed, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    word: Word
    agent: Typed | None
    parameters: tuple[Typed, ...]
    precondition: Node | None
    effect: Node | None


@dataclass(slots=True, kw_only=True)
class Domain:
    """A domain file."""

    mistakes: Mistakes
    name: str = ""
    types: dict[str, Word] = field(default_factory=dict)
    parents: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """The parents of each type except the root."""
    constants: dict[str, Typed] = field(default_factory=dict)
    predicates: dict[str, Signature] = field(default_factory=dict)
    functions: dict[str, Signature] = field(default_factory=dict)
    actions: dict[str, Action] = field(default_factory=dict)


@dataclass(slots=True, kw_only=True)
class Task:
    """A problem file."""

    mistakes: Mistakes
    name: str = ""
    domain: str = ""
    objects: dict[str, Typed] = field(default_factory=dict)
    init: tuple[Node, ...] = ()
    goal: Node | None = None
    metric: Group | None = None


def domain(root: Group, mistakes: Mistakes) -> Domain:
    """The domain that a file defines."""
    definition = Domain(mistakes=mistakes)
    for section in _sections(root, "domain", mistakes):
        match section.head:
            case "domain":
                definition.name = str(section.items[1]) if len(section.items) > 1 else ""
            case ":requirements":
                _requirements(section, mistakes)
            case ":types":
                _types(section, definition)
            case ":constants":
                _declare(_objects(section.items[1:], mistakes), definition.constants, mistakes)
            case ":predicates":
                definition.predicates.update((s.word.text, s) for s in _signatures(section.items[1:], mistakes))
            case ":functions":
                definition.functions.update((s.word.text, s) for s in _signatures(section.items[1:], mistakes))
            case ":action":
                _action(section, definition)
            case _:
                _reject_section(section, mistakes)
    _known_types(definition)
    return definition


def task(root: Group, mistakes: Mistakes, domain: Domain) -> Task:
    """The problem that a file defines."""
    definition = Task(mistakes=mistakes)
    for section in _sections(root, "problem", mistakes):
        match section.head:
            case "problem":
                definition.name = str(section.items[1]) if len(section.items) > 1 else ""
            case ":domain":
                definition.domain = str(section.items[1]) if len(section.items) > 1 else ""
            case ":requirements":
                _requirements(section, mistakes)
            case ":objects":
                _declare(_objects(section.items[1:], mistakes), definition.objects, mistakes)
            case ":init":
                definition.init = section.items[1:]
            case ":goal":
                definition.goal = section.items[1] if len(section.items) == 2 else None
            case ":metric":
                definition.metric = section
            case ":length":
                pass  # an obsolete hint about the length of the plan
            case _:
                _reject_section(section, mistakes)
    for thing in definition.objects.values():
        for name in thing.types:
            if name != OBJECT and name not in domain.parents:
                message = f"the domain has no type {name}; declare it in :types, or correct the name"
                mistakes.note(thing.word, thing.written, "unknown-type", message)
    if definition.goal is None:
        mistakes.note(root, "problem", "goal", "there is no goal; write (:goal ...) with one condition in it")
    return definition


def _sections(root: Group, kind: str, mistakes: Mistakes) -> Iterator[Group]:
    if root.head != "define" or len(root.items) < 2 or not isinstance(root.items[1], Group) or root.items[1].head != kind:
        mistakes.note(root, "file", "syntax", f"this is not a PDDL {kind}; such a file begins with (define ({kind} NAME)")
        return
    for item in root.items[1:]:
        if isinstance(item, Group) and item.items:
            yield item
        else:
            mistakes.note(item, str(item), "syntax", "a section is a group, such as (:init ...)")


def _reject_section(section: Group, mistakes: Mistakes) -> None:
    name = section.head or str(section)[:40]
    mistakes.unsupported(section, name, _SECTIONS.get(name, f"a section {name} is not known"))


def _requirements(section: Group, mistakes: Mistakes) -> None:
    """Check the requirements. Unsupported features are reported where they are used, except for a problem in several files."""
    for word in section.items[1:]:
        if isinstance(word, Word) and word.text == ":factored-privacy":
            mistakes.unsupported(word, word.text, "a problem in one file for each agent is not supported; give the unfactored one")


def _declare(declared: Iterator[Typed], table: dict[str, Typed], mistakes: Mistakes) -> None:
    for thing in declared:
        if (earlier := table.setdefault(thing.name, thing)).types != thing.types:
            message = f"is declared as another type in line {earlier.word.line}; keep one of the two"
            mistakes.note(thing.word, thing.written, "duplicate", message)


def typed_names(items: Sequence[Node], mistakes: Mistakes) -> Iterator[Typed]:
    """The typed names or variables in a list such as `a b - t c - (either t u) d`."""
    waiting: list[Word] = []
    rest = iter(items)
    for item in rest:
        if isinstance(item, Group):
            mistakes.note(item, str(item)[:60], "syntax", "a name was expected here")
        elif item.text == "-":
            types = _type_names(next(rest, None), item, mistakes)
            yield from (Typed(word=word, types=types) for word in waiting)
            waiting = []
        else:
            waiting.append(item)
    yield from (Typed(word=word, types=(OBJECT,)) for word in waiting)


def _type_names(node: Node | None, dash: Node, mistakes: Mistakes) -> tuple[str, ...]:
    match node:
        case Word(text):
            return (text,)
        case Group(items) if node.head == "either" and len(items) > 1 and all(isinstance(item, Word) for item in items):
            return tuple(dict.fromkeys(item.text for item in items[1:] if isinstance(item, Word)))
    mistakes.note(node or dash, "-", "syntax", "a type was expected after this -: a name, or (either NAME NAME)")
    return (OBJECT,)


def _objects(items: Sequence[Node], mistakes: Mistakes) -> Iterator[Typed]:
    """The objects, including private ones, `(:private AGENT a b - t)`: SO-MRS does not restrict knowledge of objects."""
    public = [item for item in items if not (isinstance(item, Group) and item.head == ":private")]
    yield from typed_names(public, mistakes)
    for item in items:
        if isinstance(item, Group) and item.head == ":private":
            yield from typed_names(item.items[2:], mistakes)


def _signatures(items: Sequence[Node], mistakes: Mistakes) -> Iterator[Signature]:
    """The signatures in a list such as `(p ?x - t) (q) - number (:private ?a - t (r ?a - t))`."""
    for item in items:
        if not isinstance(item, Group):
            continue  # the `- number` after a function, or the variable of a private block
        if item.head == ":private":
            yield from _signatures(item.items[1:], mistakes)
        elif item.head:
            assert isinstance(item.items[0], Word)
            yield Signature(word=item.items[0], parameters=tuple(typed_names(item.items[1:], mistakes)))
        elif item.items:
            mistakes.note(item, str(item)[:60], "syntax", "a predicate begins with its name: (at ?thing ?place)")


def _types(section: Group, domain: Domain) -> None:
    for thing in typed_names(section.items[1:], domain.mistakes):
        if thing.name != OBJECT:
            domain.types.setdefault(thing.name, thing.word)
            domain.parents[thing.name] = _without_root((*domain.parents.get(thing.name, ()), *thing.types))
    for name, parents in [*domain.parents.items()]:
        for parent in parents:
            if parent != OBJECT and parent not in domain.parents:
                domain.parents[parent] = (OBJECT,)  # declared only as a parent
                domain.types[parent] = Word(parent, parent, domain.types[name].line)
    for name in domain.parents:
        if name in _ancestors(name, domain):
            domain.mistakes.note(domain.types[name], name, "cycle", "this type is its own ancestor; give it another parent")
            domain.parents[name] = (OBJECT,)


def _without_root(parents: Sequence[str]) -> tuple[str, ...]:
    """The distinct parents, without the root if there is another one, which is below the root anyway."""
    return tuple(parent for parent in dict.fromkeys(parents) if parent != OBJECT) or (OBJECT,)


def _ancestors(name: str, domain: Domain) -> set[str]:
    ancestors: set[str] = set()
    waiting = [*domain.parents[name]]
    while waiting:
        parent = waiting.pop()
        if parent not in ancestors:
            ancestors.add(parent)
            waiting += domain.parents.get(parent, ())
    return ancestors


def _known_types(domain: Domain) -> None:
    things = [*domain.constants.values()]
    for signature in (*domain.predicates.values(), *domain.functions.values()):
        things += signature.parameters
    for action in domain.actions.values():
        things += [*action.parameters, *([action.agent] if action.agent else [])]
    for thing in things:
        for name in thing.types:
            if name != OBJECT and name not in domain.parents:
                message = f"there is no type {name}; declare it in :types, or correct the name"
                domain.mistakes.note(thing.word, thing.word.written, "unknown-type", message)


def _action(section: Group, domain: Domain) -> None:
    mistakes = domain.mistakes
    name = section.items[1] if len(section.items) > 1 else None
    if not isinstance(name, Word):
        mistakes.note(section, ":action", "syntax", "an action has a name: (:action NAME :parameters ...)")
        return
    parts: dict[str, list[Node]] = {}
    current: list[Node] = []
    for item in section.items[2:]:
        if isinstance(item, Word) and item.text.startswith(":"):
            current = parts.setdefault(item.text, [])
            if item.text not in (":agent", ":parameters", ":precondition", ":effect"):
                mistakes.unsupported(item, name.written, f"a part {item.text} of an action is not known")
        else:
            current.append(item)
    parameters = parts.get(":parameters", [Group((), section.line)])
    if len(parameters) != 1 or not isinstance(parameters[0], Group):
        mistakes.note(section, name.written, "syntax", "parameters are one list: :parameters (?x - type)")
        return
    agents = [*typed_names(parts.get(":agent", []), mistakes)]
    if len(agents) > 1:
        mistakes.unsupported(agents[1].word, name.written, "an action of several agents at once is not supported")
    for key in (":precondition", ":effect"):
        if len(parts.get(key, [])) > 1:
            mistakes.note(parts[key][1], name.written, "syntax", f"{key} is one condition; join several by (and ...)")
    if name.text in domain.actions:
        mistakes.note(name, name.written, "duplicate", "there is an action of this name already; give this one another name")
    domain.actions[name.text] = Action(
        word=name,
        agent=agents[0] if agents else None,
        parameters=tuple(typed_names(parameters[0].items, mistakes)),
        precondition=_condition(parts, ":precondition"),
        effect=_condition(parts, ":effect"),
    )


def _condition(parts: dict[str, list[Node]], key: str) -> Node | None:
    """The condition with the key; None if it is left out or empty."""
    nodes = parts.get(key)
    return nodes[0] if nodes and not (isinstance(nodes[0], Group) and not nodes[0].items) else None
