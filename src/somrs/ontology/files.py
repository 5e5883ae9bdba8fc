"""Reading ontologies and maps from YAML files. Their structure is in `schema.py`, writing them in `dump.py`.

Every problem is found at once and says its file and line; what follows only from another problem is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from pydantic import ValidationError

from somrs.entish import Name, Relation
from somrs.entish.parse import nearest, parse
from somrs.errors import FormulaError, ModelError, Problem
from somrs.ontology.conformance import Violation, violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.nodes import Path, Source
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.schema import (
    RESERVED,
    AttributeEntry,
    File,
    FunctionEntry,
    ObjectEntry,
    RelationEntry,
    ServiceEntry,
    TypeEntry,
)
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import PART_OF, AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Ontology, Part, RelationType, Value
from somrs.ontology.units import converted

NAME = re.compile(r"[^\W\d]\w*(?:-\w+)*")
_FACT = re.compile(rf"({NAME.pattern})\s+({NAME.pattern})\s+({NAME.pattern})")
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)\s*")
_POSITION = ("PositionX", "PositionY", "PositionZ")
_ENTRIES = {"attributes": AttributeEntry, "relations": RelationEntry, "functions": FunctionEntry, "types": TypeEntry, "services": ServiceEntry}


@dataclass(frozen=True, slots=True)
class Loaded:
    """What files hold: the ontology with everything they build on, and their map, if they have one."""

    ontology: Ontology
    map: Map | None


@lru_cache(maxsize=1)
def upper() -> Ontology:
    """The ontology that every other one builds on."""
    text = resources.files("somrs.ontology").joinpath("data/upper.yaml").read_text("utf-8")
    return _Reading(Ontology()).finish([Source("upper.yaml", text)]).ontology


def load(paths: Iterable[str | FilePath], base: Ontology | None = None) -> Loaded:
    """Read the files and those they use. Raises ModelError with all that is wrong."""
    reading = _Reading(base if base is not None else upper())
    return reading.finish(reading.sources([FilePath(path) for path in paths]))


def load_text(text: str, file: str = "text", base: Ontology | None = None) -> Loaded:
    """Like `load`, for one file's text that may not lie in a file."""
    return _Reading(base if base is not None else upper()).finish([Source(file, text)])


@dataclass(slots=True)
class _Place:
    """Where an object, a fact or a definition was read."""

    source: Source
    path: Path

    def line(self, inner: str = "") -> int | None:
        """The line of the key that `inner` names, or of as much of it as is written."""
        path, lines = self.path, self.source.lines(self.path)
        if inner in lines:
            return lines[inner]
        steps = tuple(int(step) if step.isdigit() else step for step in inner.split(".")) if inner else ()
        if steps and steps[0] not in lines:
            short = {"RotationZ": "turned", **dict.fromkeys(_POSITION, "at")}.get(str(steps[0]))
            steps = (short,) if short in lines and short is not None else steps
        return self.source.line((*path, *steps))


@dataclass(slots=True)
class _Reading:
    """One `load` under way."""

    base: Ontology
    problems: list[Problem] = field(default_factory=list)
    broken: set[str] = field(default_factory=set)
    """Names whose definition has a problem already; what others say about them is not reported."""
    half_read: set[str] = field(default_factory=set)
    """Objects of which a value could not be read; what they lack is not reported."""
    definitions: dict[str, Definition] = field(default_factory=dict)
    places: dict[str, _Place] = field(default_factory=dict)
    """By `object NAME`, `fact TEXT`, or `types NAME` and so on."""
    objects: dict[str, Object] = field(default_factory=dict)
    facts: dict[Fact, None] = field(default_factory=dict)
    has_map: bool = False

    def sources(self, paths: list[FilePath]) -> list[Source]:
        """The files, each once, those that a file uses before it."""
        found: dict[FilePath, Source] = {}

        def visit(path: FilePath, shown: str, user: tuple[Source, Path] | None) -> None:
            real = path.resolve()
            if real in found:
                return
            try:
                source = Source(shown, path.read_text("utf-8-sig"))
            except (OSError, UnicodeDecodeError) as error:
                reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
                file, line = (user[0].file, user[0].line(user[1])) if user else (shown, None)
                self.problems.append(
                    Problem(file=file, line=line, subject="file", rule="file", message=f"{shown} cannot be read: {reason}; mend the path or the file")
                )
                return
            found[real] = source
            uses = source.data.get("uses") if isinstance(source.data, dict) else None
            for index, used in enumerate(uses if isinstance(uses, list) else ()):
                if isinstance(used, str):
                    visit(path.parent / used, str(FilePath(shown).parent / used), (source, ("uses", index)))

        for path in paths:
            visit(path, str(path), None)
        return [*found.values()]

    def finish(self, sources: list[Source]) -> Loaded:
        """Everything the sources say, checked."""
        good = [source for source in sources if self._structure(source)]
        for source in good:
            self._definitions(source)
        ontology = self.base.extended(self.definitions.values())
        for violation in ontology_violations(ontology):
            self._report(violation, "definition")
        for source in good:
            self._map(source, ontology)
        map = Map(self.objects.values(), self.facts)
        if self.has_map:
            for violation in violations(map, ontology):
                self._report(violation, "object")
        if self.problems:
            order = {source.file: index for index, source in enumerate(sources)}
            raise ModelError(sorted(dict.fromkeys(self.problems), key=lambda p: (order.get(p.file, -1), p.line or 0)))
        return Loaded(ontology, map if self.has_map else None)

    def _report(self, violation: Violation, what: str) -> None:
        """Put the violation on its line, unless it only follows from a problem that is known already."""
        said = f"{violation.subject} {violation.message}"
        if not self.broken.isdisjoint(re.findall(r"\w[\w-]*", said)):
            return
        if violation.subject in self.half_read and violation.rule in ("required", "constraint") and not violation.path:
            return
        place = next((self.places[key] for key in (f"{what} {violation.subject}", f"fact {violation.subject}") if key in self.places), None)
        if place is None:
            file, line = (self.map_file.file, self.map_file.line(("objects",))) if what == "object" and self.map_file else ("ontology", None)
        else:
            file, line = place.source.file, place.line(violation.path)
        self.problems.append(Problem(file=file, line=line, subject=violation.subject, rule=violation.rule, message=violation.message))

    map_file: Source | None = None

    # Structure

    def _structure(self, source: Source) -> bool:
        self.problems.extend(source.problems)
        if source.data is None and source.problems:
            return False
        if not isinstance(source.data, dict):
            message = f"a file is a list of keys ({', '.join(File.model_fields)}) with values"
            self.problems.append(Problem(file=source.file, line=1, subject="file", rule="structure", message=message))
            return False
        try:
            File.model_validate(source.data)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                self._structure_problem(source, detail)
        return True

    def _structure_problem(self, source: Source, detail: Any) -> None:
        path: Path = tuple(detail["loc"])
        while path and not _leads(source.data, path) and detail["type"] != "missing":
            path = path[:-1]  # pydantic adds the alternatives it tried
        owner = _owner(path)
        if owner is not None and owner not in source.data:
            self.broken.add(owner)
        message = _structure_message(path, detail)
        subject = owner or (str(path[0]) if path else "file")
        problem = Problem(file=source.file, line=source.line(path), subject=subject, rule="structure", message=message)
        if not any(p.file == problem.file and p.line == problem.line and p.subject == subject and p.rule == "structure" for p in self.problems):
            self.problems.append(problem)

    # Ontologies

    def _definitions(self, source: Source) -> None:
        for section, model in _ENTRIES.items():
            entries = source.data.get(section)
            for name, body in entries.items() if isinstance(entries, dict) else ():
                place = _Place(source, (section, name))
                if not self._named(name, place):
                    continue
                try:
                    entry = model.model_validate(body)
                except ValidationError:
                    continue  # reported with the structure
                definition = self._definition(section, name, entry, place)
                key = f"{section} {name}"
                known = {"attributes": self.base.attributes, "relations": self.base.relations, "functions": self.base.functions}
                there = {**known, "types": self.base.types, "services": self.base.services}[section].get(name)  # type: ignore[dict-item]
                if key in self.definitions:
                    other = self.places[f"definition {name}"]
                    self._problem(place, name, "duplicate", f"is defined in {other.source.file}:{other.line()} already; give this one another name")
                elif there is not None and there != definition:
                    self._problem(place, name, "duplicate", "is in the ontology already and means something else there; give this one another name")
                else:
                    self.definitions[key] = definition
                    self.places[f"definition {name}"] = place

    def _definition(self, section: str, name: str, entry: Any, place: _Place) -> Definition:
        match section:
            case "attributes":
                fields = entry.model_dump()
                return AttributeType(**{**fields, "name": name, "values": tuple(entry.values), "attributes": tuple(entry.attributes)})
            case "relations":
                return RelationType(**{**entry.model_dump(), "name": name, "joins": tuple(entry.joins)})
            case "functions":
                return FunctionType(**{**entry.model_dump(), "name": name, "parameters": tuple(entry.parameters)})
            case "services":
                inputs, outputs = (tuple(Parameter(name=n, type=t) for n, t in side.items()) for side in (entry.inputs, entry.outputs))
                return ServiceType(**{**entry.model_dump(), "name": name, "inputs": inputs, "outputs": outputs})
            case _:
                return self._type(name, entry, place)

    def _type(self, name: str, entry: TypeEntry, place: _Place) -> ObjectType:
        defaults = {path: value for path, value, _ in _flat(entry.defaults)}
        return ObjectType(
            name=name,
            parent=entry.parent,
            attributes=tuple(entry.attributes),
            required=tuple(entry.required),
            parts=tuple(
                Part(type=part.type, minimum=int(part.minimum), maximum=None if part.maximum is None else int(part.maximum)) for part in entry.parts
            ),
            constraints=tuple(
                Constraint(**{**constraint.model_dump(), "values": tuple(constraint.values)}) for constraint in entry.constraints
            ),
            defaults=defaults,
            driver=entry.driver,
            doc=entry.doc,
        )

    # Maps

    def _map(self, source: Source, ontology: Ontology) -> None:
        if not {"map", "objects", "facts"} & source.data.keys():
            return
        self.has_map = True
        self.map_file = self.map_file or source
        objects, facts = source.data.get("objects"), source.data.get("facts")
        kinds: dict[str, dict[str, AttributeType]] = {}
        if isinstance(objects, dict):
            for name, body in objects.items():
                self._object(source, ontology, kinds, name, body, ("objects", name), None)
        for index, text in enumerate(facts if isinstance(facts, list) else ()):
            if isinstance(text, str):
                self._fact(text, _Place(source, ("facts", index)))

    def _object(
        self,
        source: Source,
        ontology: Ontology,
        kinds: dict[str, dict[str, AttributeType]],
        name: Any,
        body: Any,
        path: Path,
        whole: str | None,
    ) -> None:
        place = _Place(source, path)
        if not self._named(name, place) or not isinstance(body, dict):
            return
        if name in self.objects:
            other = self.places[f"object {name}"]
            self._problem(place, name, "duplicate", f"is the name of another object in {other.source.file}:{other.line()}; names are unique in a map")
        elif isinstance(type_name := body.get("type"), str):
            if type_name not in kinds:
                kinds[type_name] = ontology.attributes_of(type_name)
            self.places[f"object {name}"] = place
            self.objects[name] = Object(name=name, type=type_name, values=self._values(name, body, kinds[type_name], place))
            if whole is not None:
                self.facts[Fact(PART_OF, (name, whole))] = None
        parts = body.get("parts")
        if isinstance(parts, dict):
            for part, inner in parts.items():
                self._object(source, ontology, kinds, part, inner, (*path, "parts", part), name)

    def _values(self, name: str, body: dict[str, Any], kinds: dict[str, AttributeType], place: _Place) -> dict[str, Value]:
        values: dict[str, Value] = {}
        written = [(path, value, path) for path, value, _ in _flat({key: value for key, value in body.items() if key not in RESERVED})]
        if isinstance(at := body.get("at"), list):
            written = [*((path, value, f"at.{index}") for index, (path, value) in enumerate(zip(_POSITION, at, strict=False))), *written]
        if (turned := body.get("turned")) is not None:
            written = [*written, ("RotationZ", turned, "turned")]
        for path, value, key in written:
            attribute = kinds.get(path)
            if path in values:
                self._problem(place, name, "duplicate", f"{path} is given twice; keep one of the two", key)
            elif isinstance(value, list) or value is None:
                what = "a list" if isinstance(value, list) else "empty"
                self._problem(place, name, "value", f"{path} is {what}; write a number, a text, or true or false", key)
            elif attribute is not None and attribute.kind is Kind.NUMBER and isinstance(value, str):
                converted = self._number(name, attribute, value, place, key)
                if converted is not None:
                    values[path] = converted
            else:
                values[path] = value
        if len(values) < len(written):
            self.half_read.add(name)
        return values

    def _number(self, name: str, attribute: AttributeType, text: str, place: _Place, key: str) -> float | None:
        unit = f" in {attribute.unit}" if attribute.unit else ""
        match = _QUANTITY.fullmatch(text)
        if match is None or attribute.unit is None:
            self._problem(place, name, "value", f"{attribute.name} is a number{unit}, not {text!r}", key)
            return None
        value = converted(float(match[1]), match[2], attribute.unit)
        if value is None:
            self._problem(place, name, "unit", f"{attribute.name} is a number{unit}, and {text!r} cannot be expressed in it", key)
        return value

    def _fact(self, text: str, place: _Place) -> None:
        match = _FACT.fullmatch(text.strip())
        if match is not None:
            fact = Fact(match[2], (match[1], match[3]))
        else:
            try:
                atom = parse(text)
            except FormulaError as error:
                self._problem(place, "facts", "formula", str(error))
                return
            if not isinstance(atom, Relation) or any(not isinstance(argument, Name) for argument in atom.arguments):
                self._problem(place, "facts", "formula", f"{text!r} is not a fact; a fact is one relation between named objects: Jar002 isOn Cupboard001")
                return
            fact = Fact(atom.relation, tuple(argument.name for argument in atom.arguments))
        if fact in self.facts:
            self._problem(place, str(fact), "duplicate", "is said already; leave this one out")
        self.facts[fact] = None
        self.places.setdefault(f"fact {fact}", place)

    def _named(self, name: Any, place: _Place) -> bool:
        if isinstance(name, str) and NAME.fullmatch(name) and name not in ("AND", "OR", "NOT", "TRUE", "FALSE"):
            return True
        self._problem(place, str(name), "name", "is no name; a name is a letter and then letters, digits, _ or -, and not AND, OR, NOT, TRUE or FALSE")
        self.broken.add(str(name))
        return False

    def _problem(self, place: _Place, subject: str, rule: str, message: str, inner: str = "") -> None:
        self.problems.append(Problem(file=place.source.file, line=place.line(inner), subject=subject, rule=rule, message=message))


def _flat(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any, str]]:
    """Nested attributes by path: `Shape: {Height: 1}` and `Shape.Height: 1` are the same."""
    for key, value in values.items():
        path = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{path}.")
        else:
            yield path, value, path


def _leads(data: Any, path: Path) -> bool:
    for step in path:
        if isinstance(data, dict) and step in data:
            data = data[step]
        elif isinstance(data, list) and isinstance(step, int) and step < len(data):
            data = data[step]
        else:
            return False
    return True


def _owner(path: Path) -> str | None:
    """The name of the definition or object that a path leads into."""
    if len(path) < 2 or path[0] not in (*_ENTRIES, "objects"):
        return None
    if path[0] != "objects":
        return str(path[1])
    owner, rest = path[1], path[2:]
    while len(rest) >= 2 and rest[0] == "parts":
        owner, rest = rest[1], rest[2:]
    return str(owner)


def _structure_message(path: Path, detail: Any) -> str:
    key = str(path[-1]) if path else "the file"
    if detail["type"] == "extra_forbidden":
        model: Any = File if len(path) == 1 else _ENTRIES.get(str(path[0]), ObjectEntry)
        known = [*model.model_fields]
        return f"unknown key {key}; {nearest(key, known) or 'there are ' + ', '.join(known)}"
    if detail["type"] == "missing":
        return f"{key} is missing; write {key}: and its value"
    shown = repr(detail["input"])
    said = str(detail["msg"]).removeprefix("Input should be ").removeprefix("a valid ")
    return f"{key} should be {said}, not {shown if len(shown) < 60 else shown[:57] + '...'}"
