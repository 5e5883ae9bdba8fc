"""What the page knows of the ontology and of the map, and what follows from it for one definition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from somrs.api.ontology import Consequences
from somrs.entish.formula import Attribute, Relation, literals, terms, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.gui.pages.ontology.sections import ATTRIBUTES, FUNCTIONS, RELATIONS, SECTION, SECTIONS, SERVICES, TYPES, Section
from somrs.ontology.objects import Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, ObjectType, Ontology, Part, RelationType, Value


@dataclass(frozen=True, slots=True)
class Had:
    """An attribute that objects of a type may have: at which path, from which ancestor, whether it must be there, its default and the
    type that gives it."""

    path: str
    attribute: AttributeType
    origin: str
    must: bool
    default: Value | None = None
    default_from: str | None = None


@dataclass(slots=True)
class Seen:
    """`objects`: the names of the map's objects, by exact type; `relied`: the definitions, by section and name, that SO-MRS itself relies
    on."""

    ontology: Ontology = field(default_factory=Ontology)
    version: int = -1
    objects: dict[str, list[str]] = field(default_factory=dict)
    relied: frozenset[tuple[str, str]] = frozenset()

    def take(self, objects: Iterable[Object]) -> None:
        self.objects = {}
        for object in objects:
            self.objects.setdefault(object.type, []).append(object.name)

    def definition(self, section: Section, name: str) -> Definition | None:
        return section.among(self.ontology).get(name)

    def counts(self) -> Mapping[str, int]:
        """How many objects there are of each type, those of the types below it included."""
        found: dict[str, int] = {}
        for type_name, names in self.objects.items():
            for ancestor in self.ontology.ancestors(type_name):
                found[ancestor] = found.get(ancestor, 0) + len(names)
        return found

    def of_type(self, type_name: str) -> list[tuple[str, str]]:
        """The objects of the type and of those below it, each with its exact type."""
        exact = [one for one in self.ontology.subtypes(type_name) if one in self.objects]
        return sorted((name, one) for one in exact for name in self.objects[one])

    def marks(self, found: Consequences) -> dict[tuple[str, str], str]:
        """What is wrong with which definition, by section and name: an object's problem is its type's."""
        marks: dict[tuple[str, str], str] = {}
        types = {name: type for type, names in self.objects.items() for name in names}
        for one in found.broken:
            subject = one.subject.split(" ")[0].partition("(")[0]  # of a fact, its first object
            at = (one.section, one.subject) if one.section in SECTION else (TYPES.key, types.get(subject, ""))
            marks.setdefault(at, f"{one.subject}: {one.message}")
        for offer in found.offers:
            marks.setdefault((SERVICES.key, offer.service.rpartition(".")[2]), f"{offer.provider}: {offer.problem}")
        return marks

    # Types

    def attributes_of(self, type_name: str) -> list[Had]:
        """Own first, then those of the parent, and so on; what complex ones are made of behind them."""
        ancestors = self.ontology.ancestors(type_name)
        must = {name for one in ancestors for name in self.ontology.types[one].required}
        found: dict[str, Had] = {}
        for origin in ancestors:
            type = self.ontology.types[origin]
            for name in dict.fromkeys([*type.required, *type.attributes]):
                for path, attribute in self._spread(name, name):
                    if path not in found:
                        found[path] = Had(path, attribute, origin, name in must, *self._default(ancestors, path))
        return [*found.values()]

    def _spread(self, name: str, path: str) -> Iterator[tuple[str, AttributeType]]:
        attribute = self.ontology.attributes.get(name)
        if attribute is not None and path.count(".") < 8:
            yield path, attribute
            for inner in attribute.attributes:
                yield from self._spread(inner, f"{path}.{inner}")

    def _default(self, ancestors: Iterable[str], path: str) -> tuple[Value | None, str | None]:
        for one in ancestors:
            if path in self.ontology.types[one].defaults:
                return self.ontology.types[one].defaults[path], one
        return None, None

    def parts_of(self, type_name: str) -> list[tuple[str, Part]]:
        return [(one, part) for one in self.ontology.ancestors(type_name) for part in self.ontology.types[one].parts]

    def rules_of(self, type_name: str) -> list[tuple[str, Constraint]]:
        return [(one, rule) for one in self.ontology.ancestors(type_name) for rule in self.ontology.types[one].constraints]

    def relations_of(self, type_name: str) -> list[tuple[RelationType, list[int]]]:
        """The relations that objects of the type can stand in, and at which places, counted from 0."""
        places = (
            (relation, [place for place, joined in enumerate(relation.joins) if self.ontology.is_subtype(type_name, joined)])
            for relation in self.ontology.relations.values()
        )
        return [(relation, found) for relation, found in places if found]

    def services_of(self, type_name: str) -> list[tuple[ServiceType, list[str]]]:
        """The service types that take or give objects of the type, as what; or whose formulas name it."""
        found = []
        for service in self.ontology.services.values():
            roles = [f"?{one.name}" for one in (*service.inputs, *service.outputs) if self.ontology.is_subtype(type_name, one.type)]
            named = [f"?{name}" for text in _texts(service) for name, of in _typed(text) if of == type_name]
            if roles or named:
                found.append((service, list(dict.fromkeys(roles + named))))
        return found

    # Where a definition is spoken of

    def users(self, section: Section, name: str) -> list[tuple[Section, str]]:
        """The other definitions that name it, in the order of the sections."""
        found = ((one, definition) for one in SECTIONS for definition in one.among(self.ontology).values())
        return [(one, definition.name) for one, definition in found if name in _named(definition).get(section.key, ())]


def _texts(definition: Definition) -> list[str]:
    """The formulas of a definition."""
    match definition:
        case ServiceType():
            handlers = [text for handler in definition.handlers for text in (handler.when, handler.effect)]
            return [text for text in (definition.precondition, definition.effect, *handlers) if text]
        case ObjectType():
            return [rule.formula for rule in definition.constraints if rule.formula]
    return []


def _typed(text: str) -> list[tuple[str, str]]:
    """The variables of a formula whose type it says."""
    try:
        return [(name, variable.type) for name, variable in variables(parse(text)).items() if variable.type is not None]
    except FormulaError:
        return []


def _named(definition: Definition) -> dict[str, set[str]]:
    """The definitions that this one names, by section."""
    found: dict[str, set[str]] = {section.key: set() for section in (TYPES, ATTRIBUTES, RELATIONS, FUNCTIONS, SERVICES)}
    match definition:
        case ObjectType():
            found[TYPES.key] |= {part.type for part in definition.parts}
            limited = [rule.attribute for rule in definition.constraints if rule.attribute]
            for path in (*definition.attributes, *definition.required, *definition.defaults, *limited):
                found[ATTRIBUTES.key].update(path.split("."))
        case AttributeType():
            found[ATTRIBUTES.key].update(definition.attributes)
        case RelationType():
            found[TYPES.key].update(definition.joins)
        case FunctionType():
            found[TYPES.key].update(definition.parameters)
            found[ATTRIBUTES.key].update((definition.attribute or "").split("."))
        case ServiceType():
            found[TYPES.key] |= {one.type for one in (*definition.inputs, *definition.outputs)}
    for text in _texts(definition):
        _spoken(text, found)
    return found


def _spoken(text: str, found: dict[str, set[str]]) -> None:
    """What a formula names."""
    try:
        formula = parse(text)
    except FormulaError:
        return
    found[TYPES.key].update(of for _, of in _typed(text))
    for literal in literals(formula):
        atom = getattr(literal, "atom", literal)
        if isinstance(atom, Relation):
            found[RELATIONS.key].add(atom.relation)
    for term in terms(formula):
        if isinstance(term, Attribute):
            found[ATTRIBUTES.key].update(term.path.split("."))
        elif (function := getattr(term, "function", None)) is not None:
            found[FUNCTIONS.key].add(function)
