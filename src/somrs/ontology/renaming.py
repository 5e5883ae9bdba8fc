"""Renames definitions and objects everywhere: in the definitions, in formulas, and on a map.

All renamings happen at once, so that two definitions can swap names. The caller checks that the new names are free.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import structs

from somrs.entish.formula import (
    And,
    Arithmetic,
    Attribute,
    Call,
    Comparison,
    Exists,
    ForAll,
    Formula,
    Name,
    Not,
    Or,
    Relation,
    Term,
    Variable,
    conjunction,
    disjunction,
)
from somrs.entish.parse import parse, parse_term
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.services import Handler, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Ontology, RelationType

_FRESH_PREFIX = "anew "
"""A prefix that makes an unused name, because names have no spaces."""


def speaks_of(statement: Formula | Definition, definition_key: DefinitionKey, ontology: Ontology) -> bool:
    """Whether a renaming of the named definition or object would change the formula or definition."""
    renamer = Renamer(
        (Renaming(section=definition_key.section, name=definition_key.name, to=_FRESH_PREFIX + definition_key.name),), ontology
    )
    if isinstance(statement, Definition):
        return renamer.definition(statement) is not statement
    return renamer.formula(statement) != statement


class Renamer:
    """Applies renamings to definitions, objects, facts and formulas. `ontology` is the one before the renamings."""

    def __init__(self, renamings: Iterable[Renaming], ontology: Ontology) -> None:
        self._new_names: dict[Section, dict[str, str]] = {section: {} for section in Section}
        for renaming in renamings:
            self._new_names[renaming.section][renaming.name] = renaming.to
        self._ontology = ontology

    def renamed_key(self, definition_key: DefinitionKey) -> DefinitionKey:
        return structs.replace(definition_key, name=self._name(definition_key.section, definition_key.name))

    def ontology(self, definitions: Iterable[Definition]) -> Ontology:
        """The definitions after the renamings. Unaffected definitions stay the same objects."""
        return Ontology(map(self.definition, definitions))

    def definition(self, definition: Definition) -> Definition:
        """The definition after the renamings; the same object if they do not affect it."""
        renamed = self._renamed(definition)
        return definition if renamed == definition else renamed

    def object(self, object: Object) -> Object:
        """The object after the renamings; the same object if they do not affect it."""
        values = {self._path(path): value for path, value in object.values.items()}
        name, type = self._name(Section.OBJECTS, object.name), self._type(object.type)
        is_unchanged = (name, type) == (object.name, object.type) and values.keys() == object.values.keys()
        return object if is_unchanged else Object(name=name, type=type, values=values)

    def fact(self, fact: Fact) -> Fact:
        arguments = tuple(self._name(Section.OBJECTS, name) for name in fact.arguments)
        return Fact(self._name(Section.RELATIONS, fact.relation), arguments)

    def changes(self, map: Map) -> Iterator[Change]:
        """The changes of the map. Facts are removed before their objects and added after them, each by a change of its own."""
        objects = [(old, new) for old, new in ((old, self.object(old)) for old in map.objects.values()) if new is not old]
        facts = [(old, new) for old, new in ((old, self.fact(old)) for old in map.facts()) if new != old]
        yield from (FactRemoved(old) for old, _ in facts)
        yield from (ObjectRemoved(old.name) for old, new in objects if new.name != old.name)
        for old, new in objects:
            if (new.name, new.type) != (old.name, old.type):
                yield ObjectAdded(new)
            else:
                yield from (ValueSet(old.name, path, None) for path in old.values if path not in new.values)
                yield from (ValueSet(old.name, path, value) for path, value in new.values.items() if path not in old.values)
        yield from (FactAdded(new) for _, new in facts)

    def _name(self, section: Section, name: str) -> str:
        return self._new_names[section].get(name, name)

    def _type(self, name: str) -> str:
        return self._name(Section.TYPES, name)

    def _path(self, path: str) -> str:
        """The path with each attribute in it renamed: both in `Shape.Height`."""
        if not self._new_names[Section.ATTRIBUTES]:
            return path
        return ".".join(self._name(Section.ATTRIBUTES, name) for name in path.split("."))

    # Definitions

    def _renamed(self, definition: Definition) -> Definition:
        match definition:
            case AttributeType():
                name = self._path(definition.name)
                attributes = tuple(map(self._path, definition.attributes))
                constraints = tuple(map(self._constraint, definition.constraints))
                return structs.replace(definition, name=name, attributes=attributes, constraints=constraints)
            case RelationType():
                name = self._name(Section.RELATIONS, definition.name)
                return structs.replace(definition, name=name, joins=tuple(map(self._type, definition.joins)))
            case FunctionType():
                return self._function(definition)
            case ObjectType():
                return self._object_type(definition)
            case ServiceType():
                return self._service(definition)

    def _function(self, function: FunctionType) -> FunctionType:
        objects = self._new_names[Section.OBJECTS]
        values = {" ".join(objects.get(name, name) for name in key.split()) if objects else key: v for key, v in function.values.items()}
        return structs.replace(
            function,
            name=self._name(Section.FUNCTIONS, function.name),
            parameters=tuple(map(self._type, function.parameters)),
            attribute=self._path(function.attribute) if function.attribute is not None else None,
            values=values,
        )

    def _object_type(self, type: ObjectType) -> ObjectType:
        return structs.replace(
            type,
            name=self._type(type.name),
            parent=self._type(type.parent) if type.parent is not None else None,
            attributes=tuple(map(self._path, type.attributes)),
            required=tuple(map(self._path, type.required)),
            parts=tuple(structs.replace(part, type=self._type(part.type)) for part in type.parts),
            constraints=tuple(map(self._constraint, type.constraints)),
            defaults={self._path(path): value for path, value in type.defaults.items()},
        )

    def _constraint(self, constraint: Constraint) -> Constraint:
        attribute = self._path(constraint.attribute) if constraint.attribute is not None else None
        values = constraint.values
        if constraint.attribute is not None and self._is_complex(constraint.attribute):
            values = tuple(self._path(str(value)) for value in values)
        return structs.replace(constraint, attribute=attribute, values=values, formula=self.text(constraint.formula))

    def _is_complex(self, path: str) -> bool:
        attribute = self._ontology.attributes.get(path.rpartition(".")[2])
        return attribute is not None and attribute.kind is Kind.COMPLEX

    def _service(self, service: ServiceType) -> ServiceType:
        return structs.replace(
            service,
            name=self._name(Section.SERVICES, service.name),
            parent=self._name(Section.SERVICES, service.parent) if service.parent is not None else None,
            inputs=tuple(map(self._parameter, service.inputs)),
            outputs=tuple(map(self._parameter, service.outputs)),
            precondition=self.text(service.precondition),
            invariant=self.text(service.invariant),
            effect=self.text(service.effect) or service.effect,
            handlers=tuple(map(self._handler, service.handlers)),
            cost=self._cost(service.cost),
        )

    def _parameter(self, parameter: Parameter) -> Parameter:
        return structs.replace(parameter, type=self._type(parameter.type))

    def _handler(self, handler: Handler) -> Handler:
        service_type = self._name(Section.SERVICES, handler.service_type) if handler.service_type is not None else None
        effect = self.text(handler.effect) or handler.effect
        return structs.replace(handler, effect=effect, when=self.text(handler.when), service_type=service_type)

    # Formulas

    def text(self, text: str | None) -> str | None:
        """The renamed formula. The original text stays if no name in it changes, or if it cannot be parsed."""
        if text is None:
            return None
        try:
            formula = parse(text)
        except FormulaError:
            return text
        renamed_formula = self.formula(formula)
        return text if renamed_formula == formula else str(renamed_formula)

    def _cost(self, text: str | None) -> str | None:
        if text is None:
            return None
        try:
            term = parse_term(text)
        except FormulaError:
            return text
        renamed_term = self._term(term)
        return text if renamed_term == term else str(renamed_term)

    def formula(self, formula: Formula) -> Formula:
        match formula:
            case And(parts):
                return conjunction(*map(self.formula, parts))
            case Or(parts):
                return disjunction(*map(self.formula, parts))
            case Not(atom):
                inner = self.formula(atom)
                assert isinstance(inner, Relation | Comparison)
                return Not(inner)
            case Relation(relation, arguments):
                return Relation(self._name(Section.RELATIONS, relation), tuple(map(self._object, arguments)))
            case Comparison(left_term, operator, right_term):
                return Comparison(self._side(left_term, right_term), operator, self._side(right_term, left_term))
            case ForAll(variable, body):
                return ForAll(self._variable(variable), self.formula(body))
            case Exists(variable, body):
                return Exists(self._variable(variable), self.formula(body))

    def _side(self, term: Term, other_term: Term) -> Term:
        """One side of a comparison. A name may be a value of an enumeration, which no renaming affects."""
        if isinstance(term, Name) and isinstance(other_term, Attribute):
            attribute = self._ontology.attributes.get(other_term.path.rpartition(".")[2])
            if attribute is not None and attribute.kind is Kind.ENUMERATION:
                return term
        return self._term(term)

    def _object(self, term: Name | Variable) -> Name | Variable:
        if isinstance(term, Name):
            return Name(self._name(Section.OBJECTS, term.name))
        return self._variable(term)

    def _variable(self, variable: Variable) -> Variable:
        return Variable(variable.name, self._type(variable.type) if variable.type is not None else None)

    def _term(self, term: Term) -> Term:
        match term:
            case Name() | Variable():
                return self._object(term)
            case Attribute(owner, path):
                return Attribute(self._object(owner), self._path(path))
            case Call(function, arguments):
                return Call(self._name(Section.FUNCTIONS, function), tuple(map(self._term, arguments)))
            case Arithmetic(left_term, operator, right_term):
                return Arithmetic(self._term(left_term), operator, self._term(right_term))
            case _:
                return term
