"""What can come next in a formula that is being written: from the grammar, the ontology and the map. `cursor.py` says where one is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from heapq import nsmallest
from operator import itemgetter

from msgspec import Struct

from somrs.entish.formula import Attribute, Comparison, Not, Relation, Text, Variable, literals
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.cursor import Cursor, Slot, Spot, spot
from somrs.ontology.objects import Map, Object
from somrs.ontology.truth import value_of
from somrs.ontology.types import ABSTRACT, PHYSICAL, ROOT, AttributeType, Kind, Ontology, Value
from somrs.ontology.units import convertible
from somrs.ontology.values import constant

MOST = 60
"""So many are offered; whoever wants another one types more of it."""

FEW = 3
"""Variables that are offered where none was begun."""

VALUE_TYPES = {"number": "any number", "text": "any text", "truth": "TRUE or FALSE"}
UNITS = ("mm", "cm", "m", "km", "g", "kg", "s", "min", "h", "m/s", "km/h", "rad", "deg", "%", "EUR")
"""What people write most; others are known, too."""


class Completion(Struct, frozen=True, kw_only=True):
    """`text` may be written, and `after` behind it. `kind`: object, relation, attribute, value, type, variable, function, keyword,
    operator or unit."""

    text: str
    kind: str
    detail: str = ""
    after: str = ""


class Completions(Struct, frozen=True, kw_only=True):
    """What may stand from `start` to `end` of the text, the likeliest first."""

    start: int
    end: int
    items: tuple[Completion, ...] = ()


class _Ranked(Struct, frozen=True):
    """`group` and `preference` order those that match as well."""

    item: Completion
    match: int
    group: int = 0
    preference: int = 0


def complete(text: str, at: int, ontology: Ontology, map: Map, variables: Mapping[str, str] | None = None) -> Completions:
    """What can come at the place in the text. `variables`: types of variables, beside those that the text says."""
    cursor = spot(text, min(max(at, 0), len(text)), ontology, map, variables or {})
    if cursor.spot is Spot.NOWHERE:
        return Completions(start=cursor.start, end=cursor.end)
    found = sorted(_Offering(cursor, ontology, map).all(), key=lambda ranked: (ranked.match, ranked.group, ranked.preference))
    items = tuple({ranked.item.text: ranked.item for ranked in found}.values())[:MOST]
    if len(items) == 1 and items[0].text == text[cursor.start : cursor.end]:
        items = ()
    return Completions(start=cursor.start, end=cursor.end, items=items)


def fitting(ontology: Ontology, map: Map, slot: Slot, typed: str = "") -> list[Object]:
    """The objects that may stand there, the likeliest first; with `typed`, those whose name or label has it in it."""
    found = sorted(_objects(typed.casefold(), ontology, map, slot), key=itemgetter(0, 1))
    return [map.objects[name] for _, _, name in found]


class _Offering:
    """What may be offered at one cursor."""

    def __init__(self, cursor: Cursor, ontology: Ontology, map: Map) -> None:
        self.cursor, self.ontology, self.map = cursor, ontology, map
        self.typed = cursor.typed.casefold()

    def all(self) -> Iterator[_Ranked]:
        match self.cursor.spot:
            case Spot.ATOM:
                yield from self.objects(Slot(), 0)
                yield from self.functions(1)
                yield from self.known_variables(1)
                yield from self.prefixed_relations(2)
                yield from self.words({} if self.cursor.negated else {"NOT": "does not hold"}, "keyword", 3)
            case Spot.TERM:
                yield from self.objects(Slot(), 0)
                yield from self.functions(0)
                yield from self.known_variables(1)
            case Spot.OBJECT:
                yield from self.known_variables(0)
                yield from self.objects(self.cursor.slot, 0)
                yield from self.typed_variables(2)
            case Spot.ATTRIBUTE:
                yield from self.attributes()
            case Spot.TYPE:
                yield from self.types()
            case Spot.RELATION:
                yield from self.relations()
                yield from self.operators(2)
                yield from self.ways_on(3)
            case Spot.VALUE:
                yield from self.values()
            case Spot.UNIT:
                yield from self.units()
                yield from self.ways_on(1)
            case Spot.ON:
                yield from self.operators(0)
                yield from self.ways_on(1)
            case Spot.VARIABLE:
                yield from self.known_variables(0)
                yield from self.typed_variables(1)

    def words(self, words: Mapping[str, str], kind: str, group: int, after: str = " ") -> Iterator[_Ranked]:
        for word, detail in words.items():
            if (match := _match(self.typed, word)) is not None:
                yield _Ranked(Completion(text=word, kind=kind, detail=detail, after=after), match, group)

    # Objects

    def objects(self, slot: Slot, group: int) -> Iterator[_Ranked]:
        after = "" if self.cursor.inside else " "
        for match, preference, name in nsmallest(MOST, _objects(self.typed, self.ontology, self.map, slot), key=itemgetter(0, 1)):
            item = Completion(text=name, kind="object", detail=described(self.map.objects[name]), after=after)
            yield _Ranked(item, match, group + preference, preference)

    def known_variables(self, group: int) -> Iterator[_Ranked]:
        fits, objects = self.cursor.slot.type, self.cursor.spot is Spot.OBJECT
        for name, type_name in self.cursor.variables.items():
            if type_name in VALUE_TYPES and objects:
                continue
            if type_name is None or type_name in VALUE_TYPES or self.ontology.is_a(type_name, fits) or self.ontology.is_a(fits, type_name):
                yield from self.words({f"?{name}": type_name or "a variable"}, "variable", group, "" if self.cursor.inside else " ")

    def typed_variables(self, group: int) -> Iterator[_Ranked]:
        """Variables with the types that may stand here: for any such object."""
        likely = _likely(self.cursor.slot, self.ontology, self.map)
        ordered = sorted(self.ontology.subtypes(self.cursor.slot.type), key=lambda name: (not likely(name), not self.map.of_type(name)))
        for name in ordered if self.typed.startswith("?") else [] if self.typed else ordered[:FEW]:
            variable = _free(name, self.cursor.variables)
            yield from self.words({f"?{variable}: {name}": f"any {name}"}, "variable", group, "" if self.cursor.inside else " ")

    # Relations and functions

    def relations(self) -> Iterator[_Ranked]:
        """Those of two objects, of which the first is written already."""
        for relation in self.ontology.relations.values():
            if len(relation.joins) != 2 or (match := _match(self.typed, relation.name)) is None:
                continue
            if _may_be(self.cursor.owner, relation.joins[0], self.ontology):
                detail = relation.doc or f"joins it with: {relation.joins[1]}"
                wished = 0 if relation.name in brought_about(self.ontology) else 1
                yield _Ranked(Completion(text=relation.name, kind="relation", detail=detail, after=" "), match, 0, wished)

    def prefixed_relations(self, group: int) -> Iterator[_Ranked]:
        """Those that stand before what they join."""
        several = {
            relation.name: f"({', '.join(relation.joins)})" for relation in self.ontology.relations.values() if len(relation.joins) != 2
        }
        yield from self.words(several, "relation", group, "(")

    def functions(self, group: int) -> Iterator[_Ranked]:
        known = {
            function.name: f"({', '.join(function.parameters)})" + (f" in {function.unit}" if function.unit else "")
            for function in self.ontology.functions.values()
        }
        yield from self.words(known, "function", group, "(")

    # Attributes and their values

    def attributes(self) -> Iterator[_Ranked]:
        above = f"{self.cursor.path}." if self.cursor.path else ""
        for level, type_name in enumerate([self.cursor.owner, *(() if self.cursor.object else self.ontology.subtypes(self.cursor.owner))]):
            for path, attribute in self.ontology.attributes_of(type_name).items():
                name = path.removeprefix(above)
                if not path.startswith(above) or (match := _match(self.typed, name)) is None:
                    continue
                after = "." if attribute.kind is Kind.COMPLEX else " "
                item = Completion(text=name, kind="attribute", detail=self._attribute_detail(path, attribute), after=after)
                yield _Ranked(item, match, min(level, 1), name.count("."))

    def _attribute_detail(self, path: str, attribute: AttributeType) -> str:
        if attribute.kind is Kind.COMPLEX:
            return f"{attribute.name}: {', '.join(attribute.attributes)}"
        now = value_of(self.cursor.object, path, self.map, self.ontology) if self.cursor.object else None
        if now is not None:
            return f"is {written(now, attribute)}"
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
        yield from self.known_variables(1)
        if self.cursor.inside != '"':
            of_values = attribute is not None
            if not of_values or self.typed:
                yield from self.objects(self.cursor.slot, 2)
            if attribute is None or attribute.kind is Kind.NUMBER:
                yield from self.functions(3)

    def units(self) -> Iterator[_Ranked]:
        own = self.cursor.attribute.unit if self.cursor.attribute is not None else None
        if own is None:
            yield from self.words(dict.fromkeys(UNITS, "a unit"), "unit", 0)
        for number, unit in enumerate(units_of(self.cursor.attribute)):
            yield from self.words({unit: "a unit" if number else "its own unit"}, "unit", min(number, 1))

    def types(self) -> Iterator[_Ranked]:
        for name in self.ontology.types:
            if (match := _match(self.typed, name)) is not None:
                fits = _may_be(name, self.cursor.slot.type, self.ontology)
                parent = self.ontology.types[name].parent
                detail = self.ontology.types[name].doc or (f"a kind of {parent}" if parent else "")
                item = Completion(text=name, kind="type", detail=detail, after="" if self.cursor.inside else " ")
                yield _Ranked(item, match, 0 if fits else 1, 0 if self.map.of_type(name) else 1)
        yield from self.words(VALUE_TYPES, "type", 2)

    # What goes on

    def operators(self, group: int) -> Iterator[_Ranked]:
        if self.typed or not self.cursor.comparable:
            return
        signs = {"=": "is", "!=": "is not"}
        number = self.cursor.attribute is None or self.cursor.attribute.kind is Kind.NUMBER
        if number and self.cursor.spot is not Spot.RELATION:
            signs |= {"<": "is less than", "<=": "is at most", ">": "is more than", ">=": "is at least"}
        yield from self.words(signs, "operator", group)

    def ways_on(self, group: int) -> Iterator[_Ranked]:
        if self.cursor.complete:
            yield from self.words({"AND": "both hold", "OR": "one of them holds"}, "keyword", group)


def _objects(typed: str, ontology: Ontology, map: Map, slot: Slot) -> Iterator[tuple[int, int, str]]:
    """The objects that may stand in a place of a relation, or begin an atom: how well they match, how likely they are, their names."""
    fits: dict[str, int | None] = {}
    likely = _likely(slot, ontology, map)
    for name, object in map.objects.items():
        if object.type not in fits:
            fits[object.type] = int(not likely(object.type)) if ontology.is_a(object.type, slot.type) else None
        preference = fits[object.type]
        if preference is None:
            continue
        match = _match(typed, name)
        if match is None and (typed in object.type.casefold() or typed in str(object.values.get("Label", "")).casefold()):
            match = 3
        if match is not None:
            yield match, preference, name


class _Likely:
    """Whether objects of a type are likely meant: what services act on, or what stands there in other facts, and its like."""

    def __init__(self, types: Iterable[str], ontology: Ontology) -> None:
        self.types, self.ontology = frozenset(types) - {ROOT, PHYSICAL, ABSTRACT}, ontology

    def __call__(self, type_name: str) -> bool:
        return any(self.ontology.is_a(type_name, one) for one in self.types)


def _likely(slot: Slot, ontology: Ontology, map: Map) -> _Likely:
    acted_on = brought_about(ontology)
    if slot.relation is None:
        return _Likely({types[0] for types in acted_on.values()}, ontology)
    named = acted_on.get(slot.relation, ())
    wished = {named[slot.place]} if slot.place < len(named) else set()
    if wished - {ROOT, PHYSICAL, ABSTRACT}:
        return _Likely(wished, ontology)
    standing = {map.objects[name].type for name in map.standing(slot.relation, slot.place) if name in map.objects}
    above = {ontology.types[name].parent or ROOT for name in standing if name in ontology.types}
    return _Likely(standing | above, ontology)


@lru_cache(maxsize=8)
def brought_about(ontology: Ontology) -> Mapping[str, tuple[str, ...]]:
    """The relations and attributes that services change, and the types of what they are about."""
    found: dict[str, tuple[str, ...]] = {}
    for service in ontology.services.values():
        types = {parameter.name: parameter.type for parameter in service.inputs}
        try:
            changed = [*literals(parse(service.effect))]
        except FormulaError:
            continue  # the page of the ontology says so
        for literal in changed:
            match literal:
                case Relation(relation, arguments) | Not(Relation(relation, arguments)):
                    found.setdefault(relation, tuple(types.get(one.name, ROOT) for one in arguments))
                case Comparison(Attribute(Variable(name), path)):
                    found.setdefault(path, (types.get(name, ROOT),))
    return found


def units_of(attribute: AttributeType | None) -> tuple[str, ...]:
    """The units in which people write values of the attribute, its own first."""
    own = attribute.unit if attribute is not None else None
    if own is None:
        return ()
    others = [unit for unit in UNITS if unit != own and convertible(unit, own)]
    return tuple(dict.fromkeys("%" if unit == "percent" else unit for unit in [own, *others]))


def _may_be(one: str, other: str, ontology: Ontology) -> bool:
    """Whether an object of the one type may be one of the other."""
    return ontology.is_a(one, other) or ontology.is_a(other, one)


def _match(typed: str, word: str) -> int | None:
    """How well a word begins with what was typed, in small letters; None where it does not have it in it."""
    if not typed:
        return 0
    folded = word.casefold()
    if folded.startswith(typed):
        return 0
    found = folded.find(typed)
    if found < 0:
        return None
    return 1 if word[found].isupper() or not word[found - 1].isalnum() else 2


def _free(type_name: str, taken: Mapping[str, str | None]) -> str:
    return next(name for number in range(1, len(taken) + 2) if (name := f"{type_name}{number if number > 1 else ''}") not in taken)


def described(object: Object) -> str:
    """What people are told of an object beside its name."""
    label = object.values.get("Label")
    return f"{object.type}, {label}" if label else object.type


def written(value: Value, attribute: AttributeType | None) -> str:
    """A value as a formula has it."""
    return str(constant(value, attribute))
