"""Completions of an incomplete formula, from the grammar, the ontology and the map. `cursor.py` analyses the cursor position."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from heapq import nsmallest
from operator import itemgetter

from msgspec import Struct, field

from somrs.entish.formula import Attribute, Comparison, Not, Relation, Text, Variable, literals
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.cursor import Cursor, Slot, Spot, locate_cursor
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import value_of
from somrs.ontology.types import ABSTRACT, PHYSICAL, ROOT, AttributeType, Kind, Ontology, Value
from somrs.ontology.units import is_convertible
from somrs.ontology.values import constant

MAX_COMPLETIONS = 60
"""The maximum number of suggestions; more typed characters narrow them down."""

MAX_NEW_VARIABLES = 3
"""The maximum number of suggested new variables where no `?` was typed."""

_QUANTIFIERS = {"FORALL": "holds for every object of a type", "EXISTS": "holds for an object of a type"}
_VALUE_TYPES = {"number": "any number", "text": "any text", "truth": "TRUE or FALSE"}
UNITS = ("mm", "cm", "m", "km", "g", "kg", "s", "min", "h", "m/s", "km/h", "rad", "deg", "%", "EUR")
"""The units that are suggested; formulas accept all units of pint."""


class Completion(Struct, frozen=True, kw_only=True):
    """A suggestion: the `text` to insert, and a `suffix` to insert after it. `kind`: object, relation, attribute, value, type, variable,
    function, keyword, operator or unit."""

    text: str
    kind: str
    detail: str = ""
    suffix: str = field(default="", name="after")


class Completions(Struct, frozen=True, kw_only=True):
    """The suggestions for the text from `start` to `end`, most likely first."""

    start: int
    end: int
    items: tuple[Completion, ...] = ()


class _Ranked(Struct, frozen=True):
    """A suggestion with its rank: `match` first, then `group`, then `preference`; lower is better."""

    item: Completion
    match: int
    group: int = 0
    preference: int = 0


def complete(text: str, position: int, ontology: Ontology, map: Map, variables: Mapping[str, str] | None = None) -> Completions:
    """The completions at a position in the text. `variables`: types of variables, in addition to those in the text."""
    cursor = locate_cursor(text, min(max(position, 0), len(text)), ontology, map, variables or {})
    if cursor.spot is Spot.NOWHERE:
        return Completions(start=cursor.start, end=cursor.end)
    candidates = sorted(
        _Completer(cursor, ontology, map).ranked_items(), key=lambda ranked: (ranked.match, ranked.group, ranked.preference)
    )
    items = tuple({ranked.item.text: ranked.item for ranked in candidates}.values())[:MAX_COMPLETIONS]
    if len(items) == 1 and items[0].text == text[cursor.start : cursor.end]:
        items = ()
    return Completions(start=cursor.start, end=cursor.end, items=items)


def fitting_objects(ontology: Ontology, map: Map, slot: Slot, typed: str = "") -> list[Object]:
    """The objects that fit the slot, most likely first; with `typed`, only those whose name, type or label contains it."""
    candidates = sorted(_objects(typed.casefold(), ontology, map, slot), key=itemgetter(0, 1))
    return [map.objects[name] for _, _, name in candidates]


class _Completer:
    """Finds the suggestions at one cursor."""

    def __init__(self, cursor: Cursor, ontology: Ontology, map: Map) -> None:
        self.cursor, self.ontology, self.map = cursor, ontology, map
        self.typed = cursor.typed.casefold()

    def ranked_items(self) -> Iterator[_Ranked]:
        match self.cursor.spot:
            case Spot.ATOM:
                yield from self.objects(Slot(), 0)
                yield from self.functions(1)
                yield from self._known_variables(1)
                yield from self._prefixed_relations(2)
                yield from self.words({} if self.cursor.negated else {"NOT": "does not hold"}, "keyword", 3)
                yield from self.words(_QUANTIFIERS, "keyword", 4)
            case Spot.TERM:
                yield from self.objects(Slot(), 0)
                yield from self.functions(0)
                yield from self._known_variables(1)
            case Spot.OBJECT:
                yield from self._known_variables(0)
                yield from self.objects(self.cursor.slot, 0)
                yield from self._typed_variables(2)
            case Spot.ATTRIBUTE:
                yield from self.attributes()
            case Spot.TYPE:
                yield from self.types()
            case Spot.RELATION:
                yield from self.relations()
                yield from self.operators(2)
                yield from self._connectives(3)
            case Spot.VALUE:
                yield from self.values()
            case Spot.UNIT:
                yield from self.units()
                yield from self._connectives(1)
            case Spot.CONTINUATION if self.cursor.quantified:
                yield from self.words({"(": "the formula"}, "operator", 0, suffix="")
            case Spot.VARIABLE if self.cursor.quantified:
                yield from self._typed_variables(0)
            case Spot.CONTINUATION:
                yield from self.operators(0)
                yield from self._connectives(1)
            case Spot.VARIABLE:
                yield from self._known_variables(0)
                yield from self._typed_variables(1)

    def words(self, words: Mapping[str, str], kind: str, group: int, suffix: str = " ") -> Iterator[_Ranked]:
        for word, detail in words.items():
            if (match := _match(self.typed, word)) is not None:
                yield _Ranked(Completion(text=word, kind=kind, detail=detail, suffix=suffix), match, group)

    # Objects

    def objects(self, slot: Slot, group: int) -> Iterator[_Ranked]:
        suffix = "" if self.cursor.enclosure else " "
        for match, preference, name in nsmallest(
            MAX_COMPLETIONS, _objects(self.typed, self.ontology, self.map, slot), key=itemgetter(0, 1)
        ):
            item = Completion(text=name, kind="object", detail=describe_object(self.map.objects[name]), suffix=suffix)
            yield _Ranked(item, match, group + preference, preference)

    def _known_variables(self, group: int) -> Iterator[_Ranked]:
        fits, objects = self.cursor.slot.type, self.cursor.spot is Spot.OBJECT
        for name, type_name in self.cursor.variables.items():
            if type_name in _VALUE_TYPES and objects:
                continue
            if (
                type_name is None
                or type_name in _VALUE_TYPES
                or self.ontology.is_subtype(type_name, fits)
                or self.ontology.is_subtype(fits, type_name)
            ):
                yield from self.words({f"?{name}": type_name or "a variable"}, "variable", group, "" if self.cursor.enclosure else " ")

    def _typed_variables(self, group: int) -> Iterator[_Ranked]:
        """New variables with the types that fit here."""
        likely = _likely(self.cursor.slot, self.ontology, self.map)
        ordered = sorted(self.ontology.subtypes(self.cursor.slot.type), key=lambda name: (not likely(name), not self.map.of_type(name)))
        for name in ordered if self.typed.startswith("?") else [] if self.typed else ordered[:MAX_NEW_VARIABLES]:
            variable = _free_name(name, self.cursor.variables)
            yield from self.words({f"?{variable}: {name}": f"any {name}"}, "variable", group, self._suffix_after_variable())

    def _suffix_after_variable(self) -> str:
        return " (" if self.cursor.quantified else "" if self.cursor.enclosure else " "

    # Relations and functions

    def relations(self) -> Iterator[_Ranked]:
        """The binary relations that fit the object before the cursor."""
        for relation in self.ontology.relations.values():
            if len(relation.joins) != 2 or (match := _match(self.typed, relation.name)) is None:
                continue
            if _types_overlap(self.cursor.owner, relation.joins[0], self.ontology):
                detail = relation.doc or f"joins it with: {relation.joins[1]}"
                preference = 0 if relation.name in service_effects(self.ontology) else 1
                yield _Ranked(Completion(text=relation.name, kind="relation", detail=detail, suffix=" "), match, 0, preference)

    def _prefixed_relations(self, group: int) -> Iterator[_Ranked]:
        """The relations that are not binary; they are written before their arguments."""
        signatures = {
            relation.name: f"({', '.join(relation.joins)})" for relation in self.ontology.relations.values() if len(relation.joins) != 2
        }
        yield from self.words(signatures, "relation", group, "(")

    def functions(self, group: int) -> Iterator[_Ranked]:
        signatures = {
            function.name: f"({', '.join(function.parameters)})" + (f" in {function.unit}" if function.unit else "")
            for function in self.ontology.functions.values()
        }
        yield from self.words(signatures, "function", group, "(")

    # Attributes and their values

    def attributes(self) -> Iterator[_Ranked]:
        prefix = f"{self.cursor.path}." if self.cursor.path else ""
        for level, type_name in enumerate([self.cursor.owner, *(() if self.cursor.object else self.ontology.subtypes(self.cursor.owner))]):
            for path, attribute in self.ontology.attributes_of(type_name).items():
                name = path.removeprefix(prefix)
                if not path.startswith(prefix) or (match := _match(self.typed, name)) is None:
                    continue
                suffix = "." if attribute.kind is Kind.COMPLEX else " "
                item = Completion(text=name, kind="attribute", detail=self._attribute_detail(path, attribute), suffix=suffix)
                yield _Ranked(item, match, min(level, 1), name.count("."))

    def _attribute_detail(self, path: str, attribute: AttributeType) -> str:
        if attribute.kind is Kind.COMPLEX:
            return f"{attribute.name}: {', '.join(attribute.attributes)}"
        now = value_of(self.cursor.object, path, self.map, self.ontology) if self.cursor.object else None
        if now is not None:
            return f"is {format_value(now, attribute)}"
        return (attribute.unit or attribute.kind.value) + (f", {attribute.doc}" if attribute.doc else "")

    def values(self) -> Iterator[_Ranked]:
        attribute = self.cursor.attribute
        match attribute.kind if attribute is not None else None:
            case Kind.ENUMERATION:
                assert attribute is not None
                yield from self.words(dict.fromkeys(attribute.values, attribute.name), "value", 0)
            case Kind.TRUTH:
                yield from self.words({"TRUE": "", "FALSE": ""}, "value", 0)
            case Kind.TEXT:
                path = self.cursor.compared
                texts = {value for object in self.map.objects.values() if isinstance(value := object.values.get(path), str)}
                yield from self.words({str(Text(text)): "a text" for text in sorted(texts)}, "value", 0)
        yield from self._known_variables(1)
        if self.cursor.enclosure != '"':
            of_values = attribute is not None
            if not of_values or self.typed:
                yield from self.objects(self.cursor.slot, 2)
            if attribute is None or attribute.kind is Kind.NUMBER:
                yield from self.functions(3)

    def units(self) -> Iterator[_Ranked]:
        own_unit = self.cursor.attribute.unit if self.cursor.attribute is not None else None
        if own_unit is None:
            yield from self.words(dict.fromkeys(UNITS, "a unit"), "unit", 0)
        for number, unit in enumerate(units_of(self.cursor.attribute)):
            yield from self.words({unit: "a unit" if number else "its own unit"}, "unit", min(number, 1))

    def types(self) -> Iterator[_Ranked]:
        for name in self.ontology.types:
            if (match := _match(self.typed, name)) is not None:
                fits = _types_overlap(name, self.cursor.slot.type, self.ontology)
                parent = self.ontology.types[name].parent
                detail = self.ontology.types[name].doc or (f"a kind of {parent}" if parent else "")
                item = Completion(text=name, kind="type", detail=detail, suffix=self._suffix_after_variable())
                yield _Ranked(item, match, 0 if fits else 1, 0 if self.map.of_type(name) else 1)
        if not self.cursor.quantified:
            yield from self.words(_VALUE_TYPES, "type", 2)

    # Operators and connectives

    def operators(self, group: int) -> Iterator[_Ranked]:
        if self.typed or not self.cursor.comparable:
            return
        signs = {"=": "is", "!=": "is not"}
        number = self.cursor.attribute is None or self.cursor.attribute.kind is Kind.NUMBER
        if number and self.cursor.spot is not Spot.RELATION:
            signs |= {"<": "is less than", "<=": "is at most", ">": "is more than", ">=": "is at least"}
        yield from self.words(signs, "operator", group)

    def _connectives(self, group: int) -> Iterator[_Ranked]:
        if self.cursor.complete:
            yield from self.words({"AND": "both hold", "OR": "one of them holds"}, "keyword", group)


def _objects(typed: str, ontology: Ontology, map: Map, slot: Slot) -> Iterator[tuple[int, int, str]]:
    """The objects that fit the slot, each as match, preference and name; lower numbers are better."""
    fits: dict[str, int | None] = {}
    likely = _likely(slot, ontology, map)
    for name, object in map.objects.items():
        if object.type not in fits:
            fits[object.type] = int(not likely(object.type)) if ontology.is_subtype(object.type, slot.type) else None
        preference = fits[object.type]
        if preference is None:
            continue
        match = _match(typed, name)
        if match is None and (typed in object.type.casefold() or typed in str(object.values.get("Label", "")).casefold()):
            match = 3
        if match is not None:
            yield match, preference, name


class _Likely:
    """Whether objects of a type are likely at a place: types that services act on, or that occur there in other facts."""

    def __init__(self, types: Iterable[str], ontology: Ontology) -> None:
        self.types, self.ontology = frozenset(types) - {ROOT, PHYSICAL, ABSTRACT}, ontology

    def __call__(self, type_name: str) -> bool:
        return any(self.ontology.is_subtype(type_name, likely_type) for likely_type in self.types)


def _likely(slot: Slot, ontology: Ontology, map: Map) -> _Likely:
    acted_on = service_effects(ontology)
    if slot.relation is None:
        return _Likely({types[0] for types in acted_on.values()}, ontology)
    named = acted_on.get(slot.relation, ())
    expected_types = {named[slot.place]} if slot.place < len(named) else set()
    if expected_types - {ROOT, PHYSICAL, ABSTRACT}:
        return _Likely(expected_types, ontology)
    standing = {map.objects[name].type for name in map.objects_at(slot.relation, slot.place) if name in map.objects}
    parent_types = {ontology.types[name].parent or ROOT for name in standing if name in ontology.types}
    return _Likely(standing | parent_types, ontology)


@lru_cache(maxsize=8)
def service_effects(ontology: Ontology) -> Mapping[str, tuple[str, ...]]:
    """The relations and attributes that services change, with the types of their arguments."""
    types_by_effect: dict[str, tuple[str, ...]] = {}
    for service in ontology.services.values():
        types = {parameter.name: parameter.type for parameter in service.inputs}
        try:
            changed = [*literals(parse(service.effect))]
        except FormulaError:
            continue  # the Ontology page shows the error
        for literal in changed:
            match literal:
                case Relation(relation, arguments) | Not(Relation(relation, arguments)):
                    types_by_effect.setdefault(relation, tuple(types.get(argument.name, ROOT) for argument in arguments))
                case Comparison(Attribute(Variable(name), path)):
                    types_by_effect.setdefault(path, (types.get(name, ROOT),))
    return types_by_effect


def units_of(attribute: AttributeType | None) -> tuple[str, ...]:
    """The units to suggest for values of the attribute, its own first."""
    own_unit = attribute.unit if attribute is not None else None
    if own_unit is None:
        return ()
    other_units = [unit for unit in UNITS if unit != own_unit and is_convertible(unit, own_unit)]
    return tuple(dict.fromkeys("%" if unit == "percent" else unit for unit in [own_unit, *other_units]))


def _types_overlap(type_name: str, other_type: str, ontology: Ontology) -> bool:
    """Whether one type is the other or a subtype of it."""
    return ontology.is_subtype(type_name, other_type) or ontology.is_subtype(other_type, type_name)


def _match(typed: str, word: str) -> int | None:
    """How a word contains the typed text, which is in lower case: 0 at its start, 1 at the start of a part, 2 elsewhere; None if not."""
    if not typed:
        return 0
    folded = word.casefold()
    if folded.startswith(typed):
        return 0
    index = folded.find(typed)
    if index < 0:
        return None
    return 1 if word[index].isupper() or not word[index - 1].isalnum() else 2


def _free_name(type_name: str, taken_names: Mapping[str, str | None]) -> str:
    return next(
        name for number in range(1, len(taken_names) + 2) if (name := f"{type_name}{number if number > 1 else ''}") not in taken_names
    )


def describe_object(object: Object) -> str:
    """The description of an object for people: its type and label."""
    label = object.values.get("Label")
    return f"{object.type}, {label}" if label else object.type


def format_value(value: Value, attribute: AttributeType | None) -> str:
    """A value as it is written in a formula."""
    return str(constant(value, attribute))
