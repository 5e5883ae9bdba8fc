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

    def choose(self, *choices: object) -> object:
        return self.data.draw(st.sampled_from(choices))

    def names(self, section: Section, *, is_present: bool) -> list[str]:
        known_names = self.contents.map.objects if section is Section.OBJECTS else getattr(self.contents.ontology, section)
        return [name for name in NAMES[section] if (name in known_names) is is_present] or NAMES[section]

    def name(self, section: Section, *, is_present: bool = True) -> str:
        return str(self.choose(*self.names(section, is_present=is_present)))

    def section(self) -> Section:
        return Section(str(self.choose(Section.TYPES, Section.ATTRIBUTES, Section.RELATIONS)))

    def alteration(self) -> Alteration:
        kinds: list[Callable[[], Alteration]] = [self.renaming, self.removing, self.defining, self.updating, self.object, self.undoing]
        make_alteration = self.choose(*kinds)
        assert callable(make_alteration)
        alteration: Alteration = make_alteration()
        return alteration

    def renaming(self) -> Define:
        section = self.section()
        first = Renaming(section=section, name=self.name(section), to=self.name(section, is_present=False))
        # Sometimes it makes room for what is defined with it.
        new_definitions = self.defining().definitions if self.choose(True, False, False) else Definitions()
        return Define(renamed=(first,), definitions=new_definitions)

    def removing(self) -> Define:
        section = self.section()
        name = self.name(section)
        renamed = (Renaming(section=section, name=self.name(section), to=name),) if self.choose(True, False, False) else ()
        return Define(removed=(DefinitionKey(section=section, name=name),), renamed=renamed)

    def defining(self) -> Define:
        section = self.section()
        name = self.name(section, is_present=bool(self.choose(True, False)))
        if section is Section.ATTRIBUTES:
            kind = Kind(str(self.choose(Kind.NUMBER, Kind.TEXT)))
            return Define(definitions=Definitions(attributes=(AttributeType(name=name, kind=kind, doc=str(self.choose("", "a"))),)))
        if section is Section.RELATIONS:
            relation = self.contents.ontology.relations.get(name, RelationType(name=name, joins=("Graspable", "Table")))
            joins = self.choose(relation.joins, ("Object", "Object"), ("Graspable", self.name(Section.TYPES)))
            assert isinstance(joins, tuple)
            return Define(
                definitions=Definitions(relations=(structs.replace(relation, joins=joins, functional=bool(self.choose(True, False))),))
            )
        type = self.contents.ontology.types.get(name, ObjectType(name=name, parent="Furniture", doc="new"))
        parent = str(self.choose(type.parent, "Graspable", "Table", "Room", self.name(Section.TYPES)))
        limit = self.choose(None, 1.5, 5.0)
        assert limit is None or isinstance(limit, float)
        rules = (Constraint(attribute="Weight", maximum=limit),) if limit else ()
        return Define(
            definitions=Definitions(types=(structs.replace(type, parent=parent, constraints=rules, doc=str(self.choose("", "a"))),))
        )

    def updating(self) -> UpdateMap:
        return UpdateMap(changes=tuple(self.change() for _ in range(int(str(self.choose(1, 1, 2))))))

    def change(self) -> Change:
        name = self.name(Section.OBJECTS)
        values: dict[str, float | str | bool] = {"PositionX": 0.0, "PositionY": 1.0, "PositionZ": 2.0}
        shape: dict[str, float | str | bool] = {"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 0.1, "Shape.Height": 0.1}
        new = Object(
            name=self.name(Section.OBJECTS, is_present=False),
            type=str(self.choose("Jar", self.name(Section.TYPES))),
            values={**values, **shape},
        )
        fact = Fact(self.name(Section.RELATIONS), (name, self.name(Section.OBJECTS)))
        held = sorted(self.contents.map.facts_about(name), key=str)
        amount = self.choose(0.5, 1.0, 2.0)
        assert isinstance(amount, float)
        choice = self.choose(
            ObjectAdded(new), ObjectRemoved(name), ValueSet(name, "PositionX", amount), ValueSet(name, "Weight", amount), FactAdded(fact),
            *(FactRemoved(fact) for fact in held[:1]),
        )  # fmt: skip
        assert isinstance(choice, Change)
        return choice

    def object(self) -> RenameObject:
        return RenameObject(name=self.name(Section.OBJECTS), to=self.name(Section.OBJECTS, is_present=False))

    def undoing(self) -> Undo:
        latest = self.contents.version
        return Undo(version=int(str(self.choose(*range(max(latest - 4, 0), latest + 1)))))


@examples(15)
@given(st.data())
def test_whatever_is_edited_nothing_is_lost(data: st.DataObject) -> None:
    loaded = load_text(WORKSHOP, base=upper())
    with tempfile.TemporaryDirectory() as folder:
        keeper = Keeper(Path(folder) / "repository.sqlite", loaded.ontology, loaded.map)
        states = [(definitions(keeper.contents.ontology), keeper.contents.map)]
        for _ in range(data.draw(st.integers(1, 15))):
            body = Editor(data, keeper.contents).alteration()
            considered = keeper.ask(Consider(change=body), Considered)
            answer = keeper.ask(body, object)
            assert bool(considered.broken) is isinstance(answer, Rejected)
            contents = keeper.contents
            now = definitions(contents.ontology), contents.map
            if isinstance(answer, Updated | Defined) and answer.version == len(states):
                assert ontology_violations(contents.ontology) == []
                assert violations(contents.map, contents.ontology) == []
                if isinstance(body, Undo) and body.version == len(states) - 1:
                    assert now == states[-2], "undoing the latest change leads to what was before it"
                states.append(now)
            assert now == states[-1]
            keeper.settle()
            assert (definitions(keeper.replica.ontology), keeper.replica.map) == now
            if data.draw(st.integers(0, 9)) == 0:
                keeper.restart(snapshot=data.draw(st.booleans()))
        contents_before = keeper.contents
        keeper.restart()
        assert [*keeper.contents.ontology] == [*contents_before.ontology]
        assert (keeper.contents.map, keeper.contents.changed_at) == (contents_before.map, contents_before.changed_at)
        assert keeper.contents.defined_at == contents_before.defined_at
        for version, (ontology, map) in enumerate(states):
            past_state = keeper.read_version(version)
            assert (definitions(past_state[0]), past_state[1]) == (ontology, map)
        keeper.close()
