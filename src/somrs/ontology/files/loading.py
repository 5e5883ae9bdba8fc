"""Reads ontologies and maps from YAML files. `schema.py` defines their structure, `loaded.py` what comes of them, and
`dump.py` writes them.

One run reports all problems with file and line, without those that only follow from other problems.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from pydantic import ValidationError

from somrs.entish import Name, Relation
from somrs.entish.parse import KEYWORDS, nearest, parse
from somrs.errors import FormulaError, ModelError, Problem
from somrs.ontology.conformance import Violation, violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.dependency_index import lost_dependencies
from somrs.ontology.files.levels import LATEST, LIBRARY, at_level
from somrs.ontology.files.loaded import POSITION, AdapterEntry, LoadedModel, Place
from somrs.ontology.files.nodes import Path, Source
from somrs.ontology.files.structure import definition, flat, structure_problems
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section, key_of, revise_ontology
from somrs.ontology.objects import Fact, Object
from somrs.ontology.schema import ENTRIES, RESERVED
from somrs.ontology.types import PART_OF, AttributeType, Definition, Kind, Ontology, Value
from somrs.ontology.units import convert_unit

NAME = re.compile(r"[^\W\d]\w*(?:-\w+)*")
MAP_KEYS = frozenset(("map", "objects", "facts"))
"""The keys of a file that belong to the map."""

_FACT = re.compile(rf"({NAME.pattern})\s+({NAME.pattern})\s+({NAME.pattern})")
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)\s*")


@lru_cache(maxsize=LATEST)
def upper(level: int = 1) -> Ontology:
    """The upper ontology, on which all others build (`levels.py`)."""
    if level < LATEST:
        return at_level(upper(LATEST), level)
    text = resources.files("somrs.ontology").joinpath("data/upper.yaml").read_text("utf-8")
    return _Reading(Ontology()).finish([Source("upper.yaml", text)]).ontology


def load(paths: Iterable[str | FilePath], base: Ontology | None = None, further_sections: Collection[str] = ()) -> LoadedModel:
    """Read the files and those that they use. Raises ModelError with all problems.

    `further_sections`: keys that files may have besides, which are for others to read.
    """
    reading = _Reading(base if base is not None else upper(), chooses_level=base is None, further_sections=further_sections)
    return reading.finish(reading.sources([FilePath(path) for path in paths]))


def load_text(text: str, file: str = "text", base: Ontology | None = None) -> LoadedModel:
    """Like `load`, for a text. `file` is its name in problems."""
    return _Reading(base if base is not None else upper(), chooses_level=base is None).finish([Source(file, text)])


def load_definitions(text: str, file: str, base: Ontology) -> Ontology:
    """The base with the definitions of a text added or replaced, and without those that the text lists under `without`. A map in the text
    is ignored. Raises ModelError with all problems."""
    source = Source(file, text)
    if isinstance(source.data, dict):
        for key in MAP_KEYS & source.data.keys():
            del source.data[key]
    return _Reading(base, replacing=True).finish([source]).ontology


@dataclass(slots=True)
class _Reading:
    """The state of one `load`."""

    base: Ontology
    replacing: bool = False
    """Whether definitions may replace those of the base."""
    chooses_level: bool = False
    """Whether the base is the upper ontology on the level that the files name."""
    further_sections: Collection[str] = ()
    """Keys of the files that are for others to read."""
    problems: list[Problem] = field(default_factory=list)
    broken: set[str] = field(default_factory=set)
    """Names whose definition has a problem; further problems that mention them are not reported."""
    half_read: set[str] = field(default_factory=set)
    """Objects with an unreadable value; missing values of them are not reported."""
    definitions: dict[str, Definition] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    """By section and name: `objects Jar002`, `types Jar`, `facts Jar002 isOn Cupboard001`."""
    objects: dict[str, Object] = field(default_factory=dict)
    facts: dict[Fact, None] = field(default_factory=dict)
    has_map: bool = False
    map_file: Source | None = None
    adapters: dict[str, AdapterEntry] = field(default_factory=dict)

    def sources(self, paths: list[FilePath]) -> list[Source]:
        """The files, each once; a file comes after those that it uses."""
        ordered_sources: list[Source] = []
        visited_paths: set[FilePath] = set()

        def visit(path: FilePath, display_path: str, user: tuple[Source, Path] | None) -> None:
            real = path.resolve()
            if real in visited_paths:
                return
            visited_paths.add(real)
            try:
                source = Source(display_path, path.read_text("utf-8-sig"))
            except (OSError, UnicodeDecodeError) as error:
                reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
                file, line = (user[0].file, user[0].line(user[1])) if user else (display_path, None)
                message = f"{display_path} cannot be read: {reason}; correct the path or the file"
                self.problems.append(Problem(file=file, line=line, subject="file", rule="file", message=message))
                return
            used_files = source.data.get("uses") if isinstance(source.data, dict) else None
            for index, used_path in enumerate(used_files if isinstance(used_files, list) else ()):
                if isinstance(used_path, str):
                    visit(path.parent / used_path, str(FilePath(display_path).parent / used_path), (source, ("uses", index)))
            ordered_sources.append(source)

        for path in paths:
            visit(path, str(path), None)
        return ordered_sources

    def finish(self, sources: list[Source]) -> LoadedModel:
        """The checked content of the sources. Raises ModelError with all problems."""
        good = [source for source in sources if self._structure(source)]
        if self.chooses_level and any(source.data.get("upper") == LATEST for source in good):
            self.base = upper(LATEST)
        given_base = self.base
        for source in good:
            self._remove_definitions(source)
        for source in good:
            self._definitions(source)
        ontology = self.base.extended(self.definitions.values())
        # The base is consistent unless definitions of it were removed. The Repository checks replacements, because it also has the map.
        concerned = self.definitions.values() if self.replacing or self.base is given_base else None
        for violation in ontology_violations(ontology, concerned):
            self._report(violation)
        for violation in lost_dependencies(given_base, ontology):
            self._report(violation)
        for source in good:
            self._map(source, ontology)
            self._adapters(source)
        map = Map(self.objects.values(), self.facts, _map_name(self.map_file))
        if self.has_map:
            for violation in violations(map, ontology):
                self._report(violation)
        if self.problems:
            order = {source.file: index for index, source in enumerate(sources)}
            raise ModelError(sorted(dict.fromkeys(self.problems), key=lambda p: (order.get(p.file, -1), p.line or 0)))
        return LoadedModel(ontology, map if self.has_map else None, self.places, self.adapters)

    def _report(self, violation: Violation) -> None:
        """Report the violation with its line, unless it only follows from a problem that is already reported."""
        report_text = f"{violation.subject} {violation.message}"
        if not self.broken.isdisjoint(re.findall(r"\w[\w-]*", report_text)):
            return
        if violation.rule == "root" and self.broken:
            return  # one of the broken objects may be the root
        if violation.subject in self.half_read and violation.rule in ("required", "constraint") and not violation.path:
            return
        place = next(
            (self.places[key] for key in (f"{violation.section} {violation.subject}", f"facts {violation.subject}") if key in self.places),
            None,
        )
        if place is None:
            source = self.map_file if violation.section == "objects" else None
            file, line = (source.file, source.line(("objects",))) if source is not None else ("ontology", None)
        else:
            file, line = place.source.file, place.line(violation.path)
        self.problems.append(Problem(file=file, line=line, subject=violation.subject, rule=violation.rule, message=violation.message))

    # Structure

    def _structure(self, source: Source) -> bool:
        problems, broken = structure_problems(source, self.further_sections)
        self.problems.extend(problems)
        self.broken |= broken
        return isinstance(source.data, dict)

    # Adapters

    def _adapters(self, source: Source) -> None:
        entries = source.data.get("adapters")
        for name, settings in entries.items() if isinstance(entries, dict) else ():
            if name in self.adapters:
                message = "is in another file of the site already; write all settings of an adapter in one file"
                self._problem(Place(source, ("adapters", name)), name, "duplicate", message)
            elif isinstance(settings, dict):
                self.adapters[name] = AdapterEntry(name, settings, FilePath(source.file).parent, source)

    # Ontologies

    def _remove_definitions(self, source: Source) -> None:
        """Remove the definitions from the base that the source lists under `without`."""
        entries = source.data.get("without")
        for index, text in enumerate(entries if isinstance(entries, list) else ()):
            if not isinstance(text, str):
                continue  # reported with the structure
            section, _, name = text.partition(" ")
            place = Place(source, ("without", index))
            if section not in ENTRIES or not name:
                message = f"{text!r} names no definition; write a section and a name, such as types Jar"
                self._problem(place, "without", "structure", message)
            elif name not in getattr(self.base, section):
                hint = nearest(name, getattr(self.base, section)) or "leave it out here"
                self._problem(place, name, "unknown-name", f"is not among the {section} of the base ontology; {hint}")
            else:
                definition_key = DefinitionKey(section=Section(section), name=name)
                self.base = revise_ontology(self.base, (definition_key,), ())
                self.places.setdefault(f"{section} {name}", place)

    def _definitions(self, source: Source) -> None:
        for section, model in ENTRIES.items():
            entries = source.data.get(section)
            for name, body in entries.items() if isinstance(entries, dict) else ():
                place = Place(source, (section, name))
                if not self._named(name, place):
                    continue
                try:
                    entry = model.model_validate(body)
                except ValidationError:
                    continue  # reported with the structure
                defaults = ((path, self._default(name, place, path, value)) for path, value in flat(getattr(entry, "defaults", {})))
                self._define(section, definition(name, entry, {path: value for path, value in defaults if value is not None}), place)

    def _define(self, section: str, definition: Definition, place: Place) -> None:
        name, key = definition.name, f"{section} {definition.name}"
        base_definition = getattr(self.base, section).get(name)
        if key in self.definitions:
            earlier_place = self.places[key]
            message = f"is defined in {earlier_place.source.file}:{earlier_place.line()} already; give this one another name"
            self._problem(place, name, "duplicate", message)
        elif base_definition is not None and base_definition != definition and not self.replacing and key_of(definition) not in LIBRARY:
            message = (
                f"is in the ontology already and means something else there; give this one another name, or write {key} under without:"
            )
            self._problem(place, name, "duplicate", message)
        else:
            self.definitions[key] = definition
            self.places[key] = place

    def _default(self, subject: str, place: Place, path: str, value: Any) -> Value | None:
        """A type's default in the attribute's unit."""
        name = path.rpartition(".")[2]
        attribute_definition = self.definitions.get(f"attributes {name}", self.base.attributes.get(name))
        attribute = attribute_definition if isinstance(attribute_definition, AttributeType) else None
        return self._value(subject, place, attribute, path, value, f"defaults.{path}")

    # Maps

    def _map(self, source: Source, ontology: Ontology) -> None:
        if not MAP_KEYS & source.data.keys():
            return
        self.has_map = True
        self.map_file = self.map_file or source
        objects, facts = source.data.get("objects"), source.data.get("facts")
        kinds: dict[str, Mapping[str, AttributeType]] = {}
        if isinstance(objects, dict):
            for name, body in objects.items():
                self._object(source, ontology, kinds, name, body, ("objects", name), None)
        for index, text in enumerate(facts if isinstance(facts, list) else ()):
            if isinstance(text, str):
                self._fact(text, Place(source, ("facts", index)))

    def _object(
        self,
        source: Source,
        ontology: Ontology,
        kinds: dict[str, Mapping[str, AttributeType]],
        name: Any,
        body: Any,
        path: Path,
        whole: str | None,
    ) -> None:
        place = Place(source, path)
        if not self._named(name, place) or not isinstance(body, dict):
            return
        if name in self.objects:
            earlier_place = self.places[f"objects {name}"]
            message = f"is the name of another object in {earlier_place.source.file}:{earlier_place.line()}; names are unique in a map"
            self._problem(place, name, "duplicate", message)
        elif isinstance(type_name := body.get("type"), str):
            if type_name not in kinds:
                kinds[type_name] = ontology.attributes_of(type_name)
            self.places[f"objects {name}"] = place
            self.objects[name] = Object(name=name, type=type_name, values=self._values(name, body, kinds[type_name], place))
            if whole is not None:
                self.facts[Fact(PART_OF, (name, whole))] = None
        parts = body.get("parts")
        if isinstance(parts, dict):
            for part, inner in parts.items():
                self._object(source, ontology, kinds, part, inner, (*path, "parts", part), name)

    def _values(self, name: str, body: dict[str, Any], kinds: Mapping[str, AttributeType], place: Place) -> dict[str, Value]:
        values: dict[str, Value] = {}
        written = [(path, value, path) for path, value in flat({key: value for key, value in body.items() if key not in RESERVED})]
        if isinstance(position := body.get("at"), list):
            written = [
                *((path, value, f"at.{index}") for index, (path, value) in enumerate(zip(POSITION, position, strict=False))),
                *written,
            ]
        if (turned := body.get("turned")) is not None:
            written = [*written, ("RotationZ", turned, "turned")]
        for path, value, key in written:
            if path in values:
                self._problem(place, name, "duplicate", f"{path} is given twice; keep one of the two", key)
            elif (read := self._value(name, place, kinds.get(path), path, value, key)) is not None:
                values[path] = read
        if len(values) < len(written):
            self.half_read.add(name)
        return values

    def _value(self, subject: str, place: Place, attribute: AttributeType | None, path: str, value: Any, key: str) -> Value | None:
        """The value, a number in the attribute's unit; None after a problem. `conformance.py` checks its kind."""
        if isinstance(value, bool | float) or (isinstance(value, str) and (attribute is None or attribute.kind is not Kind.NUMBER)):
            return value
        if not isinstance(value, str) or attribute is None:
            description = "a list" if isinstance(value, list) else "empty"
            self._problem(place, subject, "value", f"{path} is {description}; write a number, a text, or true or false", key)
            return None
        unit = f" in {attribute.unit}" if attribute.unit else ""
        match = _QUANTITY.fullmatch(value)
        if match is None or attribute.unit is None:
            self._problem(place, subject, "value", f"{path} is a number{unit}, not {value!r}", key)
            return None
        number = convert_unit(float(match[1]), match[2], attribute.unit)
        if number is None:
            self._problem(place, subject, "unit", f"{path} is a number{unit}, and {value!r} cannot be expressed in it", key)
        return number

    def _fact(self, text: str, place: Place) -> None:
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
                message = f"{text!r} is not a fact; a fact is one relation between named objects: Jar002 isOn Cupboard001"
                self._problem(place, "facts", "formula", message)
                return
            fact = Fact(atom.relation, tuple(argument.name for argument in atom.arguments))
        if fact in self.facts:
            self._problem(place, str(fact), "duplicate", "is stated already; remove this one")
        self.facts[fact] = None
        self.places.setdefault(f"facts {fact}", place)

    def _named(self, name: Any, place: Place) -> bool:
        if isinstance(name, str) and NAME.fullmatch(name) and name not in KEYWORDS:
            return True
        message = "is not a name; a name is a letter and then letters, digits, _ or -, and not AND, OR, NOT, FORALL, EXISTS, TRUE or FALSE"
        self._problem(place, str(name), "name", message)
        self.broken.add(str(name))
        return False

    def _problem(self, place: Place, subject: str, rule: str, message: str, inner: str = "") -> None:
        self.problems.append(Problem(file=place.source.file, line=place.line(inner), subject=subject, rule=rule, message=message))


def _map_name(source: Source | None) -> str:
    """The name of a map in formulas, from that in its file."""
    written = source.data.get("map") if source is not None else None
    name = re.sub(r"\W+", "-", written).strip("-_") if isinstance(written, str) else ""
    return name if re.match(r"[^\W\d]", name) else ""
