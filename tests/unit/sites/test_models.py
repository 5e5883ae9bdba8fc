"""The table of models: what furniture, things and robots in building files stand for, and how users extend it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import InputError, ModelError
from somrs.sites import ImportOptions, Site
from somrs.sites.models import ModelTable, shipped_models
from somrs.sites.openrmf import import_text
from tests.support.paths import ROOT

HALL = """\
name: hall
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, ""], [40, 0, 0, ""], [40, 40, 0, ""], [0, 40, 0, ""]]
    floors: [{vertices: [0, 1, 2, 3], parameters: {}}]
    models:
"""


def hall(*models: str, options: ImportOptions | None = None) -> Site:
    lines = [
        f"      - {{model_name: {model}, name: m, x: {3 + 4 * (i % 9)}, y: {3 + 4 * (i // 9)}, z: 0, yaw: 0, static: true}}\n"
        for i, model in enumerate(models)
    ]
    return import_text(HALL + "".join(lines), options=options)


def size(site: Site, name: str) -> list[object]:
    object = site.map.objects[name]
    return [site.ontology.default(object.type, f"Shape.{side}") for side in ("Width", "Depth", "Height")]


def test_furniture_has_the_size_of_its_model() -> None:
    site = hall("OpenRobotics/NormalBed", "OpenRobotics/Cafe table")
    assert size(site, "NormalBed001") == [2.0, 1.0, 0.6]
    assert site.ontology.is_subtype(site.map.objects["Cafe_table001"].type, "Table")
    assert site.notes == ()


def test_name_of_an_unknown_model_says_what_it_is() -> None:
    site = hall("Acme/GardenChair2", "Acme/GardenChair2", "Acme/BigCubeX")
    assert site.ontology.is_subtype("GardenChair2", "Chair")
    assert size(site, "BigCubeX001") == [0.5, 0.5, 0.5]
    assert [(note.text.partition(":")[0], len(note.subjects)) for note in site.notes] == [("GardenChair2", 2), ("BigCubeX", 1)]


def test_each_kind_is_noted_once() -> None:
    site = hall(*["Acme/Gizmo"] * 60, *["Acme/Widget"] * 5)
    assert [len(note.subjects) for note in site.notes] == [60, 5]


def test_users_extend_the_table(tmp_path: Path) -> None:
    sizes = tmp_path / "sizes.yaml"
    sizes.write_text(
        "furniture:\n  Gizmo: {type: Table, size: [3, 1, 0.7]}\n  Sofa: {type: Chair, size: [2.5, 1, 0.8], color: Red}\n"
        "robots:\n  Walker: {type: PatrolRobot, speed: 1.2}\nscenery: [Banner]\n"
    )
    table = shipped_models().extended(sizes)
    site = hall("Acme/Gizmo", "OpenRobotics/Sofa", "Acme/Banner", options=ImportOptions(models=table))
    assert size(site, "Gizmo001") == [3.0, 1.0, 0.7]
    assert size(site, "Sofa001") == [2.5, 1.0, 0.8]
    assert "Banner001" not in site.map.objects
    assert (table.robots["Walker"].type, table.robots["TinyRobot"].type) == ("PatrolRobot", "DeliveryRobot")


def test_example_in_the_documentation_is_a_table(tmp_path: Path) -> None:
    (block,) = re.findall(r'```yaml title="sizes.yaml"\n(.*?)```', (ROOT / "docs/how-to/describe-a-building.md").read_text(), re.DOTALL)
    sizes = tmp_path / "sizes.yaml"
    sizes.write_text(block)
    table = ModelTable().extended(sizes)
    assert (set(table.furniture), set(table.things), set(table.robots)) == ({"PackingStation"}, {"TinBox"}, {"Walker"})


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("furniture:\n  Gizmo: {type: Tabel, size: [1, 1, 1]}\n", 2, "Tabel is no type below Furniture"),
        ("furniture:\n  Gizmo: {type: Table, size: [1, 1]}\n", 2, "length 3"),
        ("furniture:\n  Gizmo: {type: Table, size: [1, -1, 1]}\n", 2, "greater than 0"),
        ("robots:\n  Walker: {type: Table}\n", 2, "no type below MobileRobot"),
        ("robots:\n  Walker: {type: Vehicle, colour: Red}\n", 2, "colour"),
        ("sizes:\n  Gizmo: 1\n", 1, "the keys are furniture"),
        ("scenery: 5\n", 1, "list of models"),
        ("- 1\n", None, "has the keys furniture"),
        ("furniture: [\n", 2, "not YAML"),
    ],
)
def test_mistakes_in_a_table_are_told_with_their_line(text: str, line: int | None, words: str, tmp_path: Path) -> None:
    sizes = tmp_path / "sizes.yaml"
    sizes.write_text(text)
    with pytest.raises(ModelError, match=words) as caught:
        ModelTable().extended(sizes)
    assert line is None or caught.value.problems[0].line == line


def test_table_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        ModelTable().extended(tmp_path / "none.yaml")


@given(st.text(max_size=30))
def test_any_name_of_a_model_is_understood_or_not(name: str) -> None:
    by_word = shipped_models().by_word(name)
    assert by_word is None or by_word[0] in name.lower()
