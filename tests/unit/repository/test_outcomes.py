"""What changes of the map and of the ontology come to, worked out without a Repository: what is wrong with them, and where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest
from msgspec import structs

from somrs.ontology.conformance import Violation
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import AttributeType, Constraint, Kind, ObjectType, RelationType
from somrs.protocol.messages.knowledge import (
    BrokenRule,
    Considered,
    Define,
    Definitions,
    Event,
    OntologyChanged,
    Rejected,
    RenameObject,
    Revision,
    Undo,
    UpdateMap,
)
from somrs.protocol.messages.paging import PAGE_BYTES, size
from somrs.repository.definition import define_outcome, rename_outcome
from somrs.repository.names import is_name, text_problem, texts
from somrs.repository.outcome import Outcome, apply_revision, broken_rule, considered, rejected, revert_revision, revision
from somrs.repository.rollback import rewind_map, shorten_event
from somrs.repository.state import Contents, DefinitionChange
from somrs.repository.undo import undo_outcome
from somrs.repository.update import update_outcome
from somrs.repository.version_conflict import version_conflicts
from tests.support.lab import contents, lab

ONTOLOGY, MAP = lab()
TYPES, OBJECTS = Section.TYPES, Section.OBJECTS
CRATE, BASKET = ObjectType(name="Crate", parent="Jar"), ObjectType(name="Basket", parent="Jar")
NO_NAME = "'A b' is not a name that formulas can use; use letters, digits, _ and -, and begin with a letter"
RED = ValueSet("Jar1", "Color", "Red")
ON_TABLE1, ON_TABLE2 = Fact("isOn", ("Jar1", "Table1")), Fact("isOn", ("Jar1", "Table2"))


def types(*types: ObjectType) -> Definitions:
    return Definitions(types=types)


def removed(*names: str, section: Section = TYPES) -> tuple[DefinitionKey, ...]:
    return tuple(DefinitionKey(section=section, name=name) for name in names)


def renamed(*pairs: tuple[str, str], section: Section = TYPES) -> tuple[Renaming, ...]:
    return tuple(Renaming(section=section, name=name, to=new_name) for name, new_name in pairs)


def violation_rows(broken: Iterable[Violation]) -> list[tuple[str, str, str, str, str]]:
    return [(problem.section, problem.subject, problem.path, problem.rule, problem.message) for problem in broken]


# The ontology


@pytest.mark.parametrize(
    ("define", "broken"),
    [
        (
            Define(removed=(*removed("Jar1", section=OBJECTS), *removed("Jarr", "Xyzzyq"))),
            [
                ("objects", "Jar1", "", "section", "an object is removed by an update of the map, not by a change of the ontology"),
                ("types", "Jarr", "", "unknown-name", "there is no type Jarr; did you mean Jar?"),
                (
                    "types", "Xyzzyq", "", "unknown-name",
                    "there is no type Xyzzyq; it may have been removed or renamed: read the ontology again",
                ),
            ],
        ),
        (
            Define(renamed=(*renamed(("Jar1", "A b"), section=OBJECTS), *renamed(("Jar", "A b")))),
            [
                ("objects", "Jar1", "", "section", "is not renamed with the ontology; an object of the map is renamed by itself"),
                ("types", "Jar", "", "name", NO_NAME),
            ],
        ),
        (
            Define(renamed=renamed(("Jarr", "New"))),
            [("types", "Jarr", "", "unknown-name", "there is no type Jarr; did you mean Jar?")],
        ),
        (
            Define(renamed=renamed(("Jar", "Can"))),
            [("types", "Jar", "", "duplicate", "cannot be renamed: there is a type Can already; take another name")],
        ),
        (
            Define(renamed=renamed(("Jar", "New"), ("Can", "New"))),
            [
                ("types", name, "", "duplicate", "cannot be renamed: another definition is renamed to New too; take another name")
                for name in ("Jar", "Can")
            ],
        ),
        (
            Define(renamed=renamed(("Jar", "New"), ("Jar", "Newer"))),
            [("types", "Jar", "", "duplicate", "is renamed 2 times; give it one new name")],
        ),
        (
            Define(definitions=types(structs.replace(CRATE, name="A b"), CRATE, structs.replace(CRATE, parent="Can"))),
            [("types", "A b", "", "name", NO_NAME), ("types", "Crate", "", "duplicate", "is defined 2 times in this change; keep one")],
        ),
        (
            Define(definitions=types(structs.replace(CRATE, doc="\x00", defaults={"Color": "\ufffe", "Label": "fine\n"}))),
            [
                ("types", "Crate", "defaults.Color", "text", "the character U+FFFE cannot be sent in a message; leave it out"),
                ("types", "Crate", "doc", "text", "the character U+0000 cannot be sent in a message; leave it out"),
            ],
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_done_to_the_ontology_leaves_everything_as_it_is(define: Define, broken: list[tuple[str, ...]]) -> None:
    outcome = define_outcome(MAP, ONTOLOGY, define)
    assert violation_rows(outcome.broken) == broken
    assert outcome == Outcome(map=MAP, ontology=ONTOLOGY, broken=outcome.broken)


@pytest.mark.parametrize(
    "define",
    [
        Define(renamed=renamed(("Can", "Cup"), ("Cup", "Can"))),
        Define(removed=removed("Cup"), renamed=renamed(("Can", "Cup"))),
        Define(removed=removed("Cup"), definitions=types(ObjectType(name="Cup", parent="Jar"))),
        Define(definitions=types(CRATE, BASKET)),
    ],
)
def test_names_that_become_free_may_be_taken(define: Define) -> None:
    outcome = define_outcome(MAP, ONTOLOGY, define)
    assert (outcome.broken, outcome.renamed, outcome.changes, outcome.map) == ((), define.renamed, (), MAP)
    assert outcome.revision is not None
    assert [*outcome.ontology] == [*apply_revision(ONTOLOGY, outcome.revision)]
    assert {definition.name for definition in outcome.revision.after.all_definitions()} >= {
        definition.name for definition in define.definitions.all_definitions()
    }


def test_a_change_that_says_what_is_changes_nothing() -> None:
    for define in (Define(), Define(definitions=types(ONTOLOGY.types["Jar"]))):
        outcome = define_outcome(MAP, ONTOLOGY, define)
        assert outcome == Outcome(map=MAP, ontology=ONTOLOGY)
        assert outcome.ontology is ONTOLOGY


def test_a_formula_that_does_not_fit_its_ontology_is_told_and_not_asked_whether_it_holds() -> None:
    jar = structs.replace(ONTOLOGY.types["Jar"], constraints=(Constraint(formula="?Self isUn Table1"),))
    [violation] = define_outcome(MAP, ONTOLOGY, Define(definitions=types(jar))).broken
    assert (violation.section, violation.subject, violation.path, violation.rule) == ("types", "Jar", "constraints.0.formula", "formula")


def test_a_problem_is_told_once() -> None:
    jar = structs.replace(ONTOLOGY.types["Jar"], constraints=(Constraint(attribute="PositionX", maximum=1.1),))
    outcome = define_outcome(MAP, ONTOLOGY, Define(definitions=types(jar)))
    assert [(problem.subject, problem.path, problem.rule) for problem in outcome.broken] == [("Jar2", "PositionX", "constraint")]
    assert (outcome.map, outcome.revision) == (MAP, Revision(before=types(ONTOLOGY.types["Jar"]), after=types(jar)))


# Objects


@pytest.mark.parametrize(
    ("name", "new_name", "broken"),
    [
        ("Jar9", "Jar8", [("unknown-object", "there is no object Jar9 on the map; did you mean Jar2 or Jar1?")]),
        ("Qqqq", "Jar8", [("unknown-object", "there is no object Qqqq on the map; add it first")]),
        (
            "Robot1",
            "Robot2",
            [("device", "is a device, and its program uses this name; remove it from the map, and let it join under another name")],
        ),
        ("Jar1", "Jar2", [("duplicate", "cannot be called Jar2: an object of this name is on the map already; take another name")]),
        ("Jar1", "A b", [("name", NO_NAME)]),
    ],
)
def test_why_an_object_cannot_get_a_name(name: str, new_name: str, broken: list[tuple[str, str]]) -> None:
    outcome = rename_outcome(MAP, ONTOLOGY, RenameObject(name=name, to=new_name))
    assert violation_rows(outcome.broken) == [("objects", name, "", rule, message) for rule, message in broken]
    assert outcome == Outcome(map=MAP, ontology=ONTOLOGY, broken=outcome.broken)


SPEAKS = structs.replace(ONTOLOGY.types["Jar"], constraints=(Constraint(formula="NOT ?Self isOn Table2"),))
SPEAKING = ONTOLOGY.extended((SPEAKS,))


def test_an_object_is_renamed_in_the_ontology_too_and_gets_no_name_of_which_that_speaks() -> None:
    outcome = rename_outcome(MAP, SPEAKING, RenameObject(name="Table2", to="Table3"))
    now = structs.replace(SPEAKS, constraints=(Constraint(formula="NOT ?Self isOn Table3"),))
    assert (outcome.revision, outcome.broken) == (Revision(before=types(SPEAKS), after=types(now)), ())
    assert (outcome.ontology.types["Jar"], outcome.renamed) == (now, renamed(("Table2", "Table3"), section=OBJECTS))
    reduced_map = MAP.changed((ObjectRemoved("Table2"),))
    [violation] = rename_outcome(reduced_map, SPEAKING, RenameObject(name="Table1", to="Table2")).broken
    message = "cannot be called Table2: the type Jar refers to another Table2; take another name"
    assert violation == Violation(subject="Table1", rule="duplicate", message=message)


def test_an_object_is_renamed_with_its_facts_and_the_ontology_stays_as_it_is() -> None:
    outcome = rename_outcome(MAP, ONTOLOGY, RenameObject(name="Jar1", to="Jar8"))
    jar = structs.replace(MAP.objects["Jar1"], name="Jar8")
    changes = (FactRemoved(ON_TABLE1), ObjectRemoved("Jar1"), ObjectAdded(jar), FactAdded(Fact("isOn", ("Jar8", "Table1"))))
    assert outcome == Outcome(
        map=MAP.changed(changes), ontology=ONTOLOGY, changes=changes, renamed=renamed(("Jar1", "Jar8"), section=OBJECTS)
    )
    assert outcome.ontology is ONTOLOGY
    assert outcome.objects == ("Jar1", "Table1", "Jar8")


# The map


@pytest.mark.parametrize(
    ("changes", "broken"),
    [
        (
            (ObjectAdded(Object(name="Jar1", type="Jar")), ObjectAdded(Object(name="A b", type="Jar"))),
            [
                ("Jar1", "duplicate", "is on the map already; set its values, or give the new object another name"),
                ("A b", "name", NO_NAME),
            ],
        ),
        (
            (ObjectAdded(Object(name="Jar9", type="Jar")), ObjectAdded(Object(name="Jar9", type="Jar"))),
            [("Jar9", "duplicate", "is on the map already; set its values, or give the new object another name")],
        ),
        (
            (ObjectRemoved("Jar9"), ValueSet("Qqqq", "Color", "Red")),
            [
                ("Jar9", "unknown-object", "there is no object Jar9 on the map; did you mean Jar2 or Jar1?"),
                ("Qqqq", "unknown-object", "there is no object Qqqq on the map; add it first"),
            ],
        ),
        (
            (ObjectRemoved("Jar1"), RED, ObjectRemoved("Jar1")),
            [("Jar1", "unknown-object", "there is no object Jar1 on the map; did you mean Jar2?")] * 2,
        ),
        (
            (FactRemoved(Fact("isUn", ("Jar1", "Table1"))), FactRemoved(Fact("qqqqqqq", ("Jar1",)))),
            [
                ("Jar1 isUn Table1", "unknown-relation", "no relation is called isUn; did you mean isOn or isIn?"),
                (
                    "qqqqqqq(Jar1)",
                    "unknown-relation",
                    "no relation is called qqqqqqq; define it, or use one of the relations there are",
                ),
            ],
        ),
        (
            (FactAdded(Fact("isUn", ("Jar1", "Table1"))), FactAdded(Fact("isOn", ())), FactRemoved(Fact("isOn", ("Jar1",)))),
            [
                ("Jar1 isUn Table1", "unknown-relation", "no relation is called isUn; did you mean isOn or isIn?"),
                ("isOn()", "relation-types", "isOn joins 2 objects (PhysicalObject, Object), not 0"),
                ("isOn(Jar1)", "relation-types", "isOn joins 2 objects (PhysicalObject, Object), not 1"),
            ],
        ),
    ],
)
def test_what_cannot_be_done_to_the_map_leaves_it_as_it_is(changes: tuple[Change, ...], broken: list[tuple[str, str, str]]) -> None:
    outcome = update_outcome(MAP, ONTOLOGY, UpdateMap(changes=changes))
    assert violation_rows(outcome.broken) == [("objects", subject, "", rule, message) for subject, rule, message in broken]
    assert outcome == Outcome(map=MAP, ontology=ONTOLOGY, broken=outcome.broken)


def test_a_situation_that_is_no_formula_is_told_as_the_situations() -> None:
    outcome = update_outcome(MAP, ONTOLOGY, UpdateMap(changes=(RED,), situation="Jar1 isUn Table2"))
    [violation] = outcome.broken
    assert (violation.section, violation.subject, violation.rule) == ("situation", "situation", "formula")
    assert outcome == Outcome(map=MAP, ontology=ONTOLOGY, broken=(violation,))


LOST = Object(name="Jar3", type="Jar", values={**MAP.objects["Jar1"].values, "Unknown": True})
WITH_LOST = MAP.changed((ObjectAdded(LOST),))
MOVED = FactAdded(Fact("isOn", ("Jar3", "Table2")))


@pytest.mark.parametrize(
    ("update", "changes"),
    [
        (UpdateMap(), ()),
        (UpdateMap(changes=(RED, ValueSet("Jar1", "Color", None))), ()),
        (UpdateMap(changes=(RED, RED)), (RED,)),
        (UpdateMap(situation="Jar1 isOn Table2"), (FactRemoved(ON_TABLE1), FactAdded(ON_TABLE2))),
        (UpdateMap(changes=(ObjectAdded(BOX := Object(name="Jar9", type="Jar", values=MAP.objects["Jar1"].values)),),
                   situation="Jar9.Color = Red"), (ObjectAdded(structs.replace(BOX, values={**BOX.values, "Color": "Red"})),)),
        (UpdateMap(changes=(FactRemoved(Fact("isAdjacentTo", ("Room2", "Room1"))),)),
         (FactRemoved(Fact("isAdjacentTo", ("Room1", "Room2"))),)),
        (UpdateMap(changes=(ObjectRemoved("Jar1"), ObjectAdded(structs.replace(MAP.objects["Jar1"], type="Can")))),
         (FactRemoved(ON_TABLE1), ObjectAdded(structs.replace(MAP.objects["Jar1"], type="Can")))),
        (UpdateMap(changes=(ObjectRemoved("Jar1"), ObjectAdded(structs.replace(MAP.objects["Jar1"])))), (FactRemoved(ON_TABLE1),)),
        (UpdateMap(changes=(ObjectRemoved("Jar1"),)), (FactRemoved(ON_TABLE1), ObjectRemoved("Jar1"))),
        (UpdateMap(changes=(ObjectAdded(BOX), ObjectRemoved("Jar9"))), ()),
        (UpdateMap(changes=(ValueSet("Jar3", "Color", "Red"),)), (ValueSet("Jar3", "Unknown", None), ValueSet("Jar3", "Color", "Red"))),
        (UpdateMap(changes=(MOVED,)), (ValueSet("Jar3", "Unknown", None), MOVED)),
        (UpdateMap(changes=(MOVED, ValueSet("Jar3", "Unknown", True))), (MOVED,)),
        (UpdateMap(changes=(FactRemoved(MOVED.fact),)), ()),
    ],
)  # fmt: skip
def test_an_update_comes_to_the_least_changes(update: UpdateMap, changes: tuple[Change, ...]) -> None:
    outcome = update_outcome(WITH_LOST, ONTOLOGY, update)
    assert (outcome.changes, outcome.broken) == (changes, ())
    assert (outcome.map, outcome.ontology, outcome.reception) == (WITH_LOST.changed(changes), ONTOLOGY, None)


def test_rules_that_an_update_breaks_are_told_with_what_it_comes_to() -> None:
    outcome = update_outcome(MAP, ONTOLOGY, UpdateMap(changes=(ValueSet("Jar1", "Color", "Mauve"), ValueSet("Jar2", "Label", "\x01"))))
    assert violation_rows(outcome.broken) == [
        ("objects", "Jar2", "Label", "text", "Label: the character U+0001 cannot be sent in a message; leave it out")
    ], "values are looked at once they can be said"
    bad = Object(name="Jar9", type="Jar", values={"Label": "\x02", "PositionX": 1.0, "Color": "Red"})
    assert [
        (problem.subject, problem.path) for problem in update_outcome(MAP, ONTOLOGY, UpdateMap(changes=(ObjectAdded(bad),))).broken
    ] == [("Jar9", "Label")]
    colour = update_outcome(MAP, ONTOLOGY, UpdateMap(changes=(ValueSet("Jar1", "Color", "Mauve"),)))
    assert [(problem.subject, problem.path, problem.rule) for problem in colour.broken] == [("Jar1", "Color", "value")]
    assert colour.changes == (ValueSet("Jar1", "Color", "Mauve"),)


# What is told


def test_what_followers_hear_of_a_change_of_the_ontology() -> None:
    renamings = renamed(("Cup", "Mug"))
    outcome = define_outcome(MAP, ONTOLOGY, Define(removed=removed("Can"), renamed=renamings, definitions=types(CRATE)))
    mug = structs.replace(ONTOLOGY.types["Cup"], name="Mug")
    assert outcome.broken == ()
    notice = outcome.change_notice(4)
    assert {definition.name for definition in notice.definitions.types} == {"Crate", "Mug"}
    assert mug in notice.definitions.types
    removed_keys = set(removed("Can", "Cup"))
    assert notice == OntologyChanged(definitions=notice.definitions, version=4, removed=notice.removed, changes=(), renamed=renamings)
    assert set(notice.removed) == removed_keys
    assert set(outcome.definitions) == removed_keys | set(removed("Mug", "Crate"))
    assert len(outcome.definitions) == 4
    assert Outcome(map=MAP, ontology=ONTOLOGY).definitions == ()
    assert Outcome(map=MAP, ontology=ONTOLOGY, changes=(RED,)).change_notice(4) == OntologyChanged(
        definitions=Definitions(), version=4, changes=(RED,)
    )


def test_a_revision_leads_there_and_back() -> None:
    ontology_after = ONTOLOGY.extended((CRATE, structs.replace(ONTOLOGY.types["Jar"], doc="new")))
    found_revision = revision(ONTOLOGY, ontology_after)
    assert found_revision == Revision(
        before=types(ONTOLOGY.types["Jar"]),
        after=types(*(ontology_after.types[name] for name in ontology_after.types if name in ("Jar", "Crate"))),
    )
    assert {definition.name: definition for definition in apply_revision(ONTOLOGY, found_revision)} == {
        definition.name: definition for definition in ontology_after
    }
    assert {definition.name: definition for definition in revert_revision(ontology_after, found_revision)} == {
        definition.name: definition for definition in ONTOLOGY
    }
    assert revision(ONTOLOGY, lab()[0]) is None


def violation(number: int, section: str = "objects") -> Violation:
    return Violation(subject=f"A{number}", rule="r", message=f"m{number}", path="p", section=section)


@pytest.mark.parametrize(
    ("count", "problem_count", "rest"), [(2, 2, []), (50, 50, []), (51, 50, ["and 1 more problems"]), (70, 50, ["and 20 more problems"])]
)
def test_so_many_problems_are_told_at_once(count: int, problem_count: int, rest: list[str]) -> None:
    broken = [violation(number) for number in range(count)]
    assert rejected([*broken, *broken[:1]], 7) == Rejected(
        problems=(*map(str, broken[:problem_count]), *rest),
        version=7,
        broken=tuple(BrokenRule(subject=f"A{n}", rule="r", message=f"m{n}", path="p") for n in range(problem_count)),
    )


def test_what_is_wrong_with_a_request_is_said_without_repeating_what_that_was() -> None:
    rejection = rejected([violation(1, "situation"), violation(2, "version"), violation(3, "types")], 7)
    assert rejection.problems == ("m1", "m2", str(violation(3, "types")))
    assert [rule.section for rule in rejection.broken] == ["situation", "version", "types"]


def test_what_would_come_of_a_change_as_much_as_goes_into_a_message() -> None:
    changes = tuple(ValueSet(f"Jar{n}", "Color", "Red") for n in range(300))
    many_types = types(*(ObjectType(name=f"T{n}", parent="Jar", doc="x" * 50) for n in range(300)))
    broken = tuple(violation(n) for n in range(250))
    answer = considered(
        Outcome(
            map=MAP, ontology=ONTOLOGY, changes=changes, revision=Revision(before=many_types, after=types(CRATE)), broken=(*broken, *broken)
        ),
        5,
    )
    assert (answer.version, answer.all_broken, answer.all_changes) == (5, 250, 300)
    assert answer.broken == tuple(BrokenRule(subject=f"A{n}", rule="r", message=f"m{n}", path="p") for n in range(len(answer.broken)))
    assert answer.changes == changes[: len(answer.changes)]
    assert answer.revision is not None
    assert answer.revision.before.types == many_types.types[: len(answer.revision.before.types)]
    assert answer.revision.after == types(CRATE)
    parts: list[tuple[Sequence[object], Sequence[object]]] = [
        (answer.broken, [*map(broken_rule, broken)]),
        (answer.changes, changes),
        (answer.revision.before.types, many_types.types),
    ]
    for sent_items, all_items in parts:
        room = PAGE_BYTES // 4 - sum(map(size, sent_items))
        assert 0 <= room < size(all_items[len(sent_items)])
    assert considered(Outcome(map=MAP, ontology=ONTOLOGY), 5) == Considered(version=5)


# Others who were quicker


def make_contents(**changed_at: int) -> Contents:
    repository_contents = contents()
    repository_contents.version, repository_contents.changed_at = 7, changed_at
    repository_contents.defined_at = {
        TYPES: {"Jar": DefinitionChange(version=5, author="urn:so-mrs:client:Anna"), "Gone": DefinitionChange(version=6, author="")}
    }
    return repository_contents


WHAT_CHANGED = "changed in version {}, after version {} that was expected; read it again before you change it"
WHO_CHANGED = "{} it in version {}, after version {} that was expected; read it again before you change it"
NEW_JAR = structs.replace(ONTOLOGY.types["Jar"], doc="new")


@pytest.mark.parametrize(
    ("alteration", "broken"),
    [
        (UpdateMap(changes=(RED,)), []),
        (UpdateMap(changes=(RED,), expected_version=3), []),
        (UpdateMap(changes=(RED,), expected_version=2), [("objects", "Jar1", WHAT_CHANGED.format(3, 2))]),
        (UpdateMap(changes=(RED, ValueSet("Jar1", "Weight", 1.0)), expected_version=2), [("objects", "Jar1", WHAT_CHANGED.format(3, 2))]),
        (UpdateMap(changes=(FactAdded(Fact("isOn", ("Jar2", "Jar1"))),), expected_version=2), []),
        (RenameObject(name="Jar1", to="Jar8", expected_version=2), [("objects", "Jar1", WHAT_CHANGED.format(3, 2))]),
        (RenameObject(name="Jar1", to="Jar8", expected_version=3), []),
        (RenameObject(name="Jar2", to="Jar8", expected_version=0), []),
        (
            RenameObject(name="Jar1", to="Jar8", expected_version=8),
            [("version", "version", "version 8 does not exist yet, the latest is 7: read it again")],
        ),
        (RenameObject(name="Jar1", to="Jar8", expected_version=7), []),
        (Undo(version=1), []),
        (Define(definitions=types(NEW_JAR), expected_version=4), [("types", "Jar", WHO_CHANGED.format("Anna changed", 5, 4))]),
        (Define(definitions=types(NEW_JAR), expected_version=5), []),
        (Define(definitions=types(ONTOLOGY.types["Jar"]), expected_version=4), []),
        (Define(definitions=types(CRATE), expected_version=4), []),
        (Define(removed=removed("Jar"), expected_version=4), [("types", "Jar", WHO_CHANGED.format("Anna changed", 5, 4))]),
        (
            Define(removed=removed("Gone"), renamed=renamed(("Gone", "Come")), expected_version=4),
            [("types", "Gone", WHO_CHANGED.format("somebody removed or renamed", 6, 4))],
        ),
        (Define(renamed=renamed(("Jar", "New")), expected_version=4), [("types", "Jar", WHO_CHANGED.format("Anna changed", 5, 4))]),
    ],
)
def test_who_was_quicker(alteration: UpdateMap | RenameObject | Define | Undo, broken: list[tuple[str, str, str]]) -> None:
    changes = alteration.changes if isinstance(alteration, UpdateMap) else ()
    conflicts = [*version_conflicts(alteration, Outcome(map=MAP, ontology=ONTOLOGY, changes=changes), make_contents(Jar1=3))]
    assert violation_rows(conflicts) == [(section, subject, "", "overtaken", message) for section, subject, message in broken]


# Undoing


def event(old_definitions: Definitions, new_definitions: Definitions, *renamings: Renaming) -> Event:
    return Event(
        version=4, at=0.0, author="a", changes=(), revision=Revision(before=old_definitions, after=new_definitions), renamed=renamings
    )


@pytest.mark.parametrize(
    ("undo", "subject", "message"),
    [
        (event(types(), types(CRATE)), "Crate", "the type Crate is not there any more"),
        (event(types(NEW_JAR), types()), "Jar", "there is a type Jar again; remove it or rename it first"),
        (event(types(), types(NEW_JAR)), "Jar", "the type Jar was changed since by Anna in version 5; undo that first"),
        (event(types(), types(structs.replace(ONTOLOGY.types["Can"], doc="new"))), "Can", "the type Can was changed since"),
    ],
)
def test_what_stands_in_the_way_of_undoing_a_change_of_the_ontology(undo: Event, subject: str, message: str) -> None:
    repository_contents = make_contents()
    outcome = undo_outcome(undo, repository_contents)
    assert violation_rows(outcome.broken) == [("types", subject, "", "changed-since", f"version 4 cannot be undone: {message}")]
    assert outcome == Outcome(map=repository_contents.map, ontology=repository_contents.ontology, broken=outcome.broken)


# The past


def test_the_map_as_it_was() -> None:
    now = Map([Object(name="A", type="Jar", values={"Size": 2.0})], [Fact("isNew", ("A",))])
    inverse_changes: list[list[Change]] = [
        [ValueSet("A", "Size", 1.0), FactRemoved(Fact("isNew", ("A",))), ObjectAdded(Object(name="B", type="Jar"))],
        [ValueSet("A", "Size", None), FactAdded(Fact("isOld", ("B",))), FactRemoved(Fact("isBig", ("B",)))],
        [ObjectRemoved("A"), ObjectRemoved("C")],
    ]
    assert rewind_map(now, inverse_changes) == Map([Object(name="B", type="Jar")], [Fact("isOld", ("B",))])
    assert rewind_map(now, inverse_changes[:2]).objects["A"] == Object(name="A", type="Jar")
    assert now.objects["A"].values == {"Size": 2.0}


def test_of_an_event_that_is_too_long_a_revision_that_is_too_long_is_left_out() -> None:
    short, long = (Revision(after=types(structs.replace(CRATE, doc="x" * length))) for length in (10, 1000))
    for full_revision, sent_revision in ((short, short), (long, Revision())):
        short_event = shorten_event(Event(version=1, at=0.0, author="a", changes=(RED,) * 40, revision=full_revision, before=(RED,)), 1000)
        assert short_event.revision == sent_revision
        assert (short_event.all_changes, short_event.before) == (40, ())


# Names and texts


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Jar1", True),
        ("Jar-1_a", True),
        ("ł", True),
        ("1a", False),
        ("A b", False),
        ("", False),
        ("TRUE", False),
        ("?A", False),
        ("A.b", False),
    ],
)
def test_what_is_a_name(text: str, name: bool) -> None:
    assert is_name(text) is name


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a\tb\r\nc ł\U0001f916\ud7ff\ue000\ufffd", ""),
        ("a\x0b", "the character U+000B cannot be sent in a message; leave it out"),
        ("\ud800", "the character U+D800 cannot be sent in a message; leave it out"),
    ],
)
def test_what_cannot_be_said(text: str, problem: str) -> None:
    assert text_problem(text) == problem


def test_all_texts_of_a_definition_with_where_they_are() -> None:
    relation = RelationType(name="isOn", joins=("A", "B"))
    assert [*texts(relation)] == [("name", "isOn"), ("joins.0", "A"), ("joins.1", "B"), ("doc", "")]
    type = ObjectType(name="T", parent=None, defaults={"Color": "Red", "Size": 1.0}, constraints=(Constraint(formula="f"),))
    assert [*texts(type)] == [
        ("name", "T"),
        ("constraints.0.formula", "f"),
        ("constraints.0.doc", ""),
        ("defaults", "Color"),
        ("defaults.Color", "Red"),
        ("defaults", "Size"),
        ("doc", ""),
    ]
    assert [*texts({"a": "b"})] == [("", "a"), ("a", "b")]
    assert [text for _, text in texts(AttributeType(name="A", kind=Kind.TEXT, values=("x",)))] == ["A", "text", "x", ""]
