"""The page's copy of the ontology, with derived information about definitions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from somrs.api.fleet import Services
from somrs.api.ontology import Consequences
from somrs.entish.formula import Attribute, Relation, literals, terms, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.gui.pages.ontology.sections import ATTRIBUTES, FUNCTIONS, RELATIONS, SECTION, SECTIONS, SERVICES, TYPES, Section
from somrs.ontology.objects import Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, ObjectType, Ontology, Part, RelationType, Value


@dataclass(frozen=True, slots=True)
class TypeAttribute:
    """An attribute of a type: its path, the ancestor that defines it, whether it is required, its default, and the type that sets the
    default."""

    path: str
    attribute: AttributeType
    origin: str
    is_required: bool
    default: Value | None = None
    default_from: str | None = None


@dataclass(slots=True)
class OntologyView:
    """`objects`: names of the map's objects by exact type. `system_definitions`: definitions that SO-MRS requires, by section and name.
    `providers`: the devices that offer each service type; `withheld`: the devices whose program has another definition of it, and why."""

    ontology: Ontology = field(default_factory=Ontology)
    version: int = -1
    objects: dict[str, list[str]] = field(default_factory=dict)
    system_definitions: frozenset[tuple[str, str]] = frozenset()
    providers: dict[str, list[str]] = field(default_factory=dict)
    withheld: dict[str, list[tuple[str, str]]] = field(default_factory=dict)

    def set_services(self, services: Services) -> None:
        self.providers, self.withheld = {}, {}
        for offer in services.offers:
            self.providers.setdefault(offer.service_type.name, []).append(offer.provider)
        for entry in services.withheld:
            self.withheld.setdefault(entry.offer.service_type.name, []).append((entry.offer.provider, entry.reason))

    def set_objects(self, objects: Iterable[Object]) -> None:
        self.objects = {}
        for object in objects:
            self.objects.setdefault(object.type, []).append(object.name)

    def definition(self, section: Section, name: str) -> Definition | None:
        return section.definitions_in(self.ontology).get(name)

    def counts(self) -> Mapping[str, int]:
        """The number of objects of each type, including its subtypes."""
        object_counts: dict[str, int] = {}
        for type_name, names in self.objects.items():
            for ancestor in self.ontology.ancestors(type_name):
                object_counts[ancestor] = object_counts.get(ancestor, 0) + len(names)
        return object_counts

    def objects_of_type(self, type_name: str) -> list[tuple[str, str]]:
        """The objects of the type and its subtypes, each with its exact type."""
        subtypes = [subtype for subtype in self.ontology.subtypes(type_name) if subtype in self.objects]
        return sorted((name, subtype) for subtype in subtypes for name in self.objects[subtype])

    def marks(self, consequences: Consequences) -> dict[tuple[str, str], str]:
        """The problem of each definition, by section and name. An object's problem is shown at its type."""
        marks: dict[tuple[str, str], str] = {}
        types = {name: type for type, names in self.objects.items() for name in names}
        for broken_rule in consequences.broken:
            subject = broken_rule.subject.split(" ")[0].partition("(")[0]  # for a fact: its first object
            definition_key = (
                (broken_rule.section, broken_rule.subject) if broken_rule.section in SECTION else (TYPES.key, types.get(subject, ""))
            )
            marks.setdefault(definition_key, f"{broken_rule.subject}: {broken_rule.message}")
        for offer in consequences.offers:
            marks.setdefault((SERVICES.key, offer.service.rpartition(".")[2]), f"{offer.provider}: {offer.problem}")
        return marks

    # Types

    def attributes_of(self, type_name: str) -> list[TypeAttribute]:
        """The type's own attributes first, then those of each ancestor; members of a group follow the group."""
        ancestors = self.ontology.ancestors(type_name)
        required_names = {name for ancestor in ancestors for name in self.ontology.types[ancestor].required}
        type_attributes: dict[str, TypeAttribute] = {}
        for origin in ancestors:
            type = self.ontology.types[origin]
            for name in dict.fromkeys([*type.required, *type.attributes]):
                for path, attribute in self._spread(name, name):
                    if path not in type_attributes:
                        type_attributes[path] = TypeAttribute(
                            path, attribute, origin, name in required_names, *self._default(ancestors, path)
                        )
        return [*type_attributes.values()]

    def _spread(self, name: str, path: str) -> Iterator[tuple[str, AttributeType]]:
        attribute = self.ontology.attributes.get(name)
        if attribute is not None and path.count(".") < 8:
            yield path, attribute
            for inner in attribute.attributes:
                yield from self._spread(inner, f"{path}.{inner}")

    def _default(self, ancestors: Iterable[str], path: str) -> tuple[Value | None, str | None]:
        for ancestor in ancestors:
            if path in self.ontology.types[ancestor].defaults:
                return self.ontology.types[ancestor].defaults[path], ancestor
        return None, None

    def parts_of(self, type_name: str) -> list[tuple[str, Part]]:
        return [(ancestor, part) for ancestor in self.ontology.ancestors(type_name) for part in self.ontology.types[ancestor].parts]

    def rules_of(self, type_name: str) -> list[tuple[str, Constraint]]:
        return [(ancestor, rule) for ancestor in self.ontology.ancestors(type_name) for rule in self.ontology.types[ancestor].constraints]

    def relations_of(self, type_name: str) -> list[tuple[RelationType, list[int]]]:
        """The relations that objects of the type can be in, with the argument positions, counted from 0."""
        places = (
            (relation, [place for place, joined in enumerate(relation.joins) if self.ontology.is_subtype(type_name, joined)])
            for relation in self.ontology.relations.values()
        )
        return [(relation, positions) for relation, positions in places if positions]

    def services_of(self, type_name: str) -> list[tuple[ServiceType, list[str]]]:
        """The service types with parameters of the type, and their roles; or whose formulas name the type."""
        service_roles = []
        for service in self.ontology.services.values():
            roles = [
                f"?{parameter.name}"
                for parameter in (*service.inputs, *service.outputs)
                if self.ontology.is_subtype(type_name, parameter.type)
            ]
            named = [
                f"?{name}"
                for text in _formula_texts(service)
                for name, variable_type in _typed_variables(text)
                if variable_type == type_name
            ]
            if roles or named:
                service_roles.append((service, list(dict.fromkeys(roles + named))))
        return service_roles

    # References

    def users(self, section: Section, name: str) -> list[tuple[Section, str]]:
        """The other definitions that refer to it, in the order of the sections."""
        definitions = (
            (user_section, definition) for user_section in SECTIONS for definition in user_section.definitions_in(self.ontology).values()
        )
        return [
            (user_section, definition.name)
            for user_section, definition in definitions
            if name in _referenced_names(definition).get(section.key, ())
        ]


def _formula_texts(definition: Definition) -> list[str]:
    """The formulas of a definition."""
    match definition:
        case ServiceType():
            handlers = [text for handler in definition.handlers for text in (handler.when, handler.effect)]
            return [text for text in (definition.precondition, definition.invariant, definition.effect, *handlers) if text]
        case ObjectType():
            return [rule.formula for rule in definition.constraints if rule.formula]
    return []


def _typed_variables(text: str) -> list[tuple[str, str]]:
    """The variables of a formula that have a type in it, with their types."""
    try:
        return [(name, variable.type) for name, variable in variables(parse(text)).items() if variable.type is not None]
    except FormulaError:
        return []


def _referenced_names(definition: Definition) -> dict[str, set[str]]:
    """The definitions that this one refers to, by section."""
    names_by_section: dict[str, set[str]] = {section.key: set() for section in (TYPES, ATTRIBUTES, RELATIONS, FUNCTIONS, SERVICES)}
    match definition:
        case ObjectType():
            names_by_section[TYPES.key] |= {part.type for part in definition.parts}
            limited = [rule.attribute for rule in definition.constraints if rule.attribute]
            for path in (*definition.attributes, *definition.required, *definition.defaults, *limited):
                names_by_section[ATTRIBUTES.key].update(path.split("."))
        case AttributeType():
            limited = [rule.attribute for rule in definition.constraints if rule.attribute]
            for path in (*definition.attributes, *limited):
                names_by_section[ATTRIBUTES.key].update(path.split("."))
        case RelationType():
            names_by_section[TYPES.key].update(definition.joins)
        case FunctionType():
            names_by_section[TYPES.key].update(definition.parameters)
            names_by_section[ATTRIBUTES.key].update((definition.attribute or "").split("."))
        case ServiceType():
            names_by_section[TYPES.key] |= {parameter.type for parameter in (*definition.inputs, *definition.outputs)}
    for text in _formula_texts(definition):
        _add_formula_names(text, names_by_section)
    return names_by_section


def _add_formula_names(text: str, names_by_section: dict[str, set[str]]) -> None:
    """Add the names in a formula."""
    try:
        formula = parse(text)
    except FormulaError:
        return
    names_by_section[TYPES.key].update(variable_type for _, variable_type in _typed_variables(text))
    for literal in literals(formula):
        atom = getattr(literal, "atom", literal)
        if isinstance(atom, Relation):
            names_by_section[RELATIONS.key].add(atom.relation)
    for term in terms(formula):
        if isinstance(term, Attribute):
            names_by_section[ATTRIBUTES.key].update(term.path.split("."))
        elif (function := getattr(term, "function", None)) is not None:
            names_by_section[FUNCTIONS.key].add(function)
