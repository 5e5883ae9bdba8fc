"""Whatever is edited, in whatever order: what is on disk, what followers have, what was, and what undoing brings back."""

from __future__ import annotations

import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from keeper import Keeper, definitions
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files import load_text, upper
from somrs.ontology.naming import Named, Renaming, Section
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Constraint, Kind, ObjectType, RelationType
from somrs.protocol.knowledge import Consider, Considered, Define, Defined, Definitions, Rejected, RenameObject, Undo, Updated, UpdateMap
from test_redefinition import WORKSHOP

TYPES = ["Tin", "SmallTin", "Vice", "Bench", "Drill"]
ATTRIBUTES = ["Volume", "Content", "Package", "Smell"]
RELATIONS = ["belongsTo", "standsAt"]
OBJECTS = ["Tin1", "Tin2", "Tin3", "Bench1", "Bench2"]
NAMES = {Section.TYPES: TYPES, Section.ATTRIBUTES: ATTRIBUTES, Section.RELATIONS: RELATIONS}

named = st.sampled_from([Named(section=section, name=name) for section, names in NAMES.items() for name in names])
renamings = st.sampled_from(
    [Renaming(section=section, name=name, to=to) for section, names in NAMES.items() for name in names for to in names if name != to]
)
types = st.builds(
    lambda name, parent, required, limit, doc: ObjectType(
        name=name,
        parent=parent,
        attributes=("Package",),
        required=required,
        constraints=(Constraint(attribute="Package.Volume", maximum=limit),) if limit else (),
        defaults={"Shape.Form": "Box", "Shape.Width": 0.1, "Shape.Depth": 0.1, "Shape.Height": 0.1},
        doc=doc,
    ),
    st.sampled_from(TYPES),
    st.sampled_from(["Graspable", "Tin", "Table", "Furniture", "Vice", "Room"]),
    st.sampled_from([(), (), ("Volume",)]),
    st.sampled_from([None, None, 1.5, 5.0]),
    st.sampled_from(["", "a"]),
)
attributes = st.builds(
    lambda name, kind: AttributeType(name=name, kind=kind), st.sampled_from(["Volume", "Smell"]), st.sampled_from([Kind.NUMBER, Kind.TEXT])
)
relations = st.builds(
    lambda name, joins, functional: RelationType(name=name, joins=joins, functional=functional),
    st.sampled_from(RELATIONS),
    st.sampled_from([("Graspable", "Table"), ("Tin", "Bench"), ("Object", "Object")]),
    st.booleans(),
)
defines = st.builds(
    lambda removed, renamed, types, attributes, relations: Define(
        removed=tuple(removed),
        renamed=tuple(renamed),
        definitions=Definitions(types=tuple(types), attributes=tuple(attributes), relations=tuple(relations)),
        author="Anna",
    ),
    st.lists(named, max_size=1),
    st.lists(renamings, max_size=2),
    st.lists(types, max_size=1),
    st.lists(attributes, max_size=1),
    st.lists(relations, max_size=1),
)
changes = st.one_of(
    st.builds(
        lambda name, kind: ObjectAdded(Object(name=name, type=kind, values={"PositionX": 0.0, "PositionY": 1.0, "PositionZ": 2.0})),
        st.sampled_from(OBJECTS),
        st.sampled_from(["Tin", "Jar", "Drill"]),
    ),
    st.builds(ObjectRemoved, st.sampled_from(OBJECTS)),
    st.builds(ValueSet, st.sampled_from(OBJECTS), st.just("PositionX"), st.sampled_from([0.0, 1.0, 2.0])),
    st.builds(ValueSet, st.sampled_from(OBJECTS), st.just("Package.Volume"), st.sampled_from([None, 1.0, 3.0])),
    st.builds(
        lambda kind, relation, one, other: kind(Fact(relation, (one, other))),
        st.sampled_from([FactAdded, FactRemoved]),
        st.sampled_from(["isOn", "belongsTo", "standsAt"]),
        st.sampled_from(OBJECTS),
        st.sampled_from(["Bench1", "Bench2"]),
    ),
)
updates = st.builds(lambda changes: UpdateMap(changes=tuple(changes)), st.lists(changes, min_size=1, max_size=3))
renames = st.builds(lambda name, to: RenameObject(name=name, to=to), st.sampled_from(OBJECTS), st.sampled_from(OBJECTS))
undos = st.builds(lambda back: ("undo", back), st.integers(0, 3))
steps = st.one_of(defines, defines, updates, renames, undos, undos, st.just("restart"))


@settings(max_examples=120, deadline=None)
@given(st.lists(steps, max_size=14))
def test_whatever_is_edited_nothing_is_lost(steps: list[Define | UpdateMap | RenameObject | tuple[str, int] | str]) -> None:
    loaded = load_text(WORKSHOP, base=upper())
    with tempfile.TemporaryDirectory() as folder:
        keeper = Keeper(Path(folder) / "repository.sqlite", loaded.ontology, loaded.map)
        was = [(definitions(keeper.contents.ontology), keeper.contents.map)]
        for step in steps:
            if step == "restart":
                keeper.restart()
                continue
            body = Undo(version=keeper.contents.version - step[1]) if isinstance(step, tuple) else step
            assert not isinstance(body, str)
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
        kept = keeper.contents
        keeper.restart()
        assert [*keeper.contents.ontology] == [*kept.ontology]
        assert (keeper.contents.map, keeper.contents.changed_at) == (kept.map, kept.changed_at)
        assert keeper.contents.defined_at == kept.defined_at
        for version, (ontology, map) in enumerate(was):
            found = keeper.at(version)
            assert (definitions(found[0]), found[1]) == (ontology, map)
        keeper.close()
