"""What programs call by name is what nobody can take away from them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import somrs
from somrs.errors import ModelError
from somrs.ontology.conformance import Violation
from somrs.ontology.dependency_index import REQUIRED_NAMES, lost_dependencies, required_definitions
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import DefinitionKey, Section, key_of, revise_ontology
from somrs.ontology.types import AttributeType, Definition, FunctionType, Kind, ObjectType, RelationType

SOURCE = Path(somrs.__file__).parent
PROGRAMS = ("ontology", "planner", "protocol", "registry", "repository", "task_manager", "service_manager", "devices", "entish")
APPEARANCE_FILES = ("looks.py", "colours.py", "appearance.py")
"""Say how things of some types look: of others, they look plainer."""

EXAMPLES = {
    "Jar", "Shelf", "Can", "range", "Table", "Charge", "isAt",
    # Parameters' names, and words of a sentence.
    "Open", "Site", "Bin",
}  # fmt: skip
"""Named in what people read, or as an example."""


def strings(file: Path) -> Iterator[str]:
    """The texts in a program, but for those that say what it is about."""
    tree = ast.parse(file.read_text("utf-8"))
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    yield from (
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs
    )


def test_programs_rely_on_nothing_else_of_the_upper_ontology() -> None:
    names = {definition.name for definition in upper()}
    required_names = {name for section in REQUIRED_NAMES.values() for name in section}
    mentions: dict[str, set[str]] = {}
    for part in PROGRAMS:
        for file in (SOURCE / part).rglob("*.py"):
            if file.name in (*APPEARANCE_FILES, "relied.py", "levels.py"):
                continue
            for text in strings(file):
                for word in set(re.findall(r"[A-Za-z]\w*", text)) & names - required_names - EXAMPLES:
                    mentions.setdefault(word, set()).add(f"{file.relative_to(SOURCE)}: {text[:60]}")
    assert mentions == {}


def test_all_of_it_is_in_the_upper_ontology() -> None:
    upper_keys = set(map(key_of, upper()))
    listed = {DefinitionKey(section=section, name=name) for section, names in REQUIRED_NAMES.items() for name in names}
    assert listed <= upper_keys
    assert set(required_definitions(upper())) == listed


def test_a_file_cannot_take_it_away_either() -> None:
    with pytest.raises(ModelError, match="neither removed nor renamed"):
        load_text("without: [types Device]\n")
    with pytest.raises(ModelError, match="kind must stay number"):
        load_text("without: [attributes Weight]\nattributes:\n  Weight: {kind: text}\n")
    ontology = load_text("without: [attributes Weight]\nattributes:\n  Weight: {kind: number, unit: kg, maximum: 50}\n").ontology
    assert ontology.attributes["Weight"].maximum == 50


JOINED = ("PhysicalObject", "Object")
IS_IN_RELATION = upper().relations["isIn"]


@pytest.mark.parametrize(
    ("section", "definition", "required_values"),
    [
        (Section.ATTRIBUTES, AttributeType(name="Weight", kind=Kind.TEXT), [("kind", "number"), ("unit", "kg")]),
        (Section.ATTRIBUTES, AttributeType(name="Label", kind=Kind.TEXT, unit="m", doc="other"), [("unit", "left out")]),
        (Section.ATTRIBUTES, AttributeType(name="Label", kind=Kind.TEXT, doc="other"), []),
        (
            Section.RELATIONS,
            RelationType(
                name="isIn",
                joins=("Object",),
                symmetric=not IS_IN_RELATION.symmetric,
                functional=not IS_IN_RELATION.functional,
                excludes="other",
            ),
            [
                ("joins", "a list of 2 types"),
                ("symmetric", str(IS_IN_RELATION.symmetric)),
                ("functional", str(IS_IN_RELATION.functional)),
                ("excludes", str(IS_IN_RELATION.excludes)),
            ],
        ),
        (Section.FUNCTIONS, FunctionType(name="distance", parameters=("Object",)), [("parameters", "a list of 2 types")]),
        (Section.FUNCTIONS, FunctionType(name="distance", parameters=JOINED), []),
        (Section.TYPES, ObjectType(name="Wall", parent="Object"), [("parent", "BuildingElement, or a type below it")]),
        (Section.TYPES, ObjectType(name="Wall", parent="Floor"), []),
        (Section.TYPES, ObjectType(name="Jar", parent="Object"), []),
    ],
)
def test_what_has_to_stay_of_a_definition(section: Section, definition: Definition, required_values: list[tuple[str, str]]) -> None:
    found_violations = list(lost_dependencies(upper(), revise_ontology(upper(), (), [definition])))
    assert found_violations == [
        Violation(
            subject=definition.name,
            rule="relied",
            message=f"SO-MRS itself relies on it, so {path} must stay {required_value}; define another beside it",
            path=path,
            section=section,
        )
        for path, required_value in required_values
    ]


def test_what_is_relied_on_stays_and_the_rest_need_not() -> None:
    removed_keys = [DefinitionKey(section=Section.RELATIONS, name="isOn"), DefinitionKey(section=Section.TYPES, name="Jar")]
    (violation,) = lost_dependencies(upper(), revise_ontology(upper(), removed_keys, ()))
    assert (violation.subject, violation.rule, violation.path, violation.section) == ("isOn", "relied", "", Section.RELATIONS)
    assert list(lost_dependencies(revise_ontology(upper(), removed_keys, ()), upper())) == []
