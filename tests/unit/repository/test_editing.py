"""Whatever is edited, in whatever order: what is on disk, what followers have, what was, and what undoing brings back."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Constraint, Kind, ObjectType, RelationType
from somrs.protocol.messages.knowledge import (
    Alteration,
    Consider,
    Considered,
    Define,
    Defined,
    Definitions,
    Rejected,
    RenameObject,
    Undo,
    Updated,
    UpdateMap,
)
from somrs.repository.state import Contents
from tests.support.examples import examples
from tests.support.keeper import Keeper, definitions
from tests.unit.repository.test_redefinition import WORKSHOP

NAMES = {
    Section.TYPES: ["Tin", "SmallTin", "Vice", "Bench", "Drill"],
    Section.ATTRIBUTES: ["Volume", "Content", "Package", "Smell"],
    Section.RELATIONS: ["belongsTo", "standsAt"],
    Section.OBJECTS: ["Tin1", "Tin2", "Tin3", "Bench1", "Bench2"],
}
"""What is edited: the names that there may be; all else stays as it is."""


class Editor:
    """Draws things to do that make sense mostly: about what there is, with names that are free."""

    def __init__(self, data: st.DataObject, contents: Contents) -> None:
        self.data, self.contents = data, contents

    def draw(self, strategy: st.SearchStrategy[object]) -> object:
        return self.data.draw(strategy)

    def of(self, *choices: object) -> object:
        return self.data.draw(st.sampled_from(choices))

    def names(self, section: Section, *, there: bool) -> list[str]:
        known = self.contents.map.objects if section is Section.OBJECTS else getattr(self.contents.ontology, section)
        return [name for name in NAMES[section] if (name in known) is there] or NAMES[section]

    def name(self, section: Section, *, there: bool = True) -> str:
        return str(self.of(*self.names(section, there=there)))

    def section(self) -> Section:
        return Section(str(self.of(Section.TYPES, Section.ATTRIBUTES, Section.RELATIONS)))

    def alteration(self) -> Alteration:
        kinds: list[Callable[[], Alteration]] = [self.renaming, self.removing, self.defining, self.updating, self.object, self.undoing]
        make = self.of(*kinds)
        assert callable(make)
        found: Alteration = make()
        return found

    def renaming(self) -> Define:
        section = self.section()
        first = Renaming(section=section, name=self.name(section), to=self.name(section, there=False))
        # Sometimes it makes room for what is defined with it.
        given = self.defining().definitions if self.of(True, False, False) else Definitions()
        return Define(renamed=(first,), definitions=given)

    def removing(self) -> Define:
        section = self.section()
        name = self.name(section)
        renamed = (Renaming(section=section, name=self.name(section), to=name),) if self.of(True, False, False) else ()
        return Define(removed=(DefinitionKey(section=section, name=name),), renamed=renamed)

    def defining(self) -> Define:
        section = self.section()
        name = self.name(section, there=bool(self.of(True, False)))
        if section is Section.ATTRIBUTES:
            kind = Kind(str(self.of(Kind.NUMBER, Kind.TEXT)))
            return Define(definitions=Definitions(attributes=(AttributeType(name=name, kind=kind, doc=str(self.of("", "a"))),)))
        if section is Section.RELATIONS:
            known = self.contents.ontology.relations.get(name, RelationType(name=name, joins=("Graspable", "Table")))
            joins = self.of(known.joins, ("Object", "Object"), ("Graspable", self.name(Section.TYPES)))
            assert isinstance(joins, tuple)
            return Define(definitions=Definitions(relations=(structs.replace(known, joins=joins, functional=bool(self.of(True, False))),)))
        type = self.contents.ontology.types.get(name, ObjectType(name=name, parent="Furniture", doc="new"))
        parent = str(self.of(type.parent, "Graspable", "Table", "Room", self.name(Section.TYPES)))
        limit = self.of(None, 1.5, 5.0)
        assert limit is None or isinstance(limit, float)
        rules = (Constraint(attribute="Weight", maximum=limit),) if limit else ()
        return Define(definitions=Definitions(types=(structs.replace(type, parent=parent, constraints=rules, doc=str(self.of("", "a"))),)))

    def updating(self) -> UpdateMap:
        return UpdateMap(changes=tuple(self.change() for _ in range(int(str(self.of(1, 1, 2))))))

    def change(self) -> Change:
        name = self.name(Section.OBJECTS)
        values: dict[str, float | str | bool] = {"PositionX": 0.0, "PositionY": 1.0, "PositionZ": 2.0}
        shape: dict[str, float | str | bool] = {"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 0.1, "Shape.Height": 0.1}
        new = Object(
            name=self.name(Section.OBJECTS, there=False),
            type=str(self.of("Jar", self.name(Section.TYPES))),
            values={**values, **shape},
        )
        fact = Fact(self.name(Section.RELATIONS), (name, self.name(Section.OBJECTS)))
        held = sorted(self.contents.map.facts_about(name), key=str)
        amount = self.of(0.5, 1.0, 2.0)
        assert isinstance(amount, float)
        choice = self.of(
            ObjectAdded(new), ObjectRemoved(name), ValueSet(name, "PositionX", amount), ValueSet(name, "Weight", amount), FactAdded(fact),
            *(FactRemoved(fact) for fact in held[:1]),
        )  # fmt: skip
        assert isinstance(choice, Change)
        return choice

    def object(self) -> RenameObject:
        return RenameObject(name=self.name(Section.OBJECTS), to=self.name(Section.OBJECTS, there=False))

    def undoing(self) -> Undo:
        latest = self.contents.version
        return Undo(version=int(str(self.of(*range(max(latest - 4, 0), latest + 1)))))


@examples(15)
@given(st.data())
def test_whatever_is_edited_nothing_is_lost(data: st.DataObject) -> None:
    loaded = load_text(WORKSHOP, base=upper())
    with tempfile.TemporaryDirectory() as folder:
        keeper = Keeper(Path(folder) / "repository.sqlite", loaded.ontology, loaded.map)
        was = [(definitions(keeper.contents.ontology), keeper.contents.map)]
        for _ in range(data.draw(st.integers(1, 15))):
            body = Editor(data, keeper.contents).alteration()
            considered = keeper.say(Consider(change=body), Considered)
            answer = keeper.say(body, object)
            assert bool(considered.broken) is isinstance(answer, Rejected)
            contents = keeper.contents
            now = definitions(contents.ontology), contents.map
            if isinstance(answer, Updated | Defined) and answer.version == len(was):
                assert ontology_violations(contents.ontology) == []
                assert violations(contents.map, contents.ontology) == []
                if isinstance(body, Undo) and body.version == len(was) - 1:
                    assert now == was[-2], "undoing the latest change leads to what was before it"
                was.append(now)
            assert now == was[-1]
            keeper.settle()
            assert (definitions(keeper.replica.ontology), keeper.replica.map) == now
            if data.draw(st.integers(0, 9)) == 0:
                keeper.restart(snapshot=data.draw(st.booleans()))
        kept = keeper.contents
        keeper.restart()
        assert [*keeper.contents.ontology] == [*kept.ontology]
        assert (keeper.contents.map, keeper.contents.changed_at) == (kept.map, kept.changed_at)
        assert keeper.contents.defined_at == kept.defined_at
        for version, (ontology, map) in enumerate(was):
            found = keeper.at(version)
            assert (definitions(found[0]), found[1]) == (ontology, map)
        keeper.close()
