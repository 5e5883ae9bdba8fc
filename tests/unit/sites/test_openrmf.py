"""Bringing in Open-RMF buildings: the demo office is where and what it should be, and what cannot be understood is told."""

from __future__ import annotations

import math
import re
from collections import deque
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import InputError, ModelError
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.dump import dump_map, dump_ontology
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.objects import Object
from somrs.sites import IMPORTERS, ImportOptions, Site
from somrs.sites.openrmf import import_text
from somrs.sites.plan import Box, Point, clearance, is_in_polygon, separation, without_gap
from tests.support.paths import SHARED

OFFICE = SHARED / "sites" / "office.building.yaml"

SMALL = """\
coordinate_system: cartesian_meters
name: Depot 7
levels:
  L1:
    elevation: 0
    vertices:
      - [0, 0, 0, ""]
      - [10, 0, 0, ""]
      - [10, 6, 0, ""]
      - [0, 6, 0, ""]
      - [4, 0, 0, ""]
      - [5, 0, 0, ""]
      - [2, 3, 0, goods in, {is_charger: [4, true], spawn_robot_name: [1, robot 1]}]
      - [8, 3, 0, exit]
    walls:
      - [0, 1, {}]
      - [1, 2, {}]
    doors:
      - [4, 5, {name: [1, gate], type: [1, hinged]}]
    floors:
      - {parameters: {}, vertices: [0, 1, 2, 3]}
    models:
      - {model_name: Acme/Contraption, name: c, static: true, x: 5, y: 4, z: 0, yaw: 0}
      - {model_name: OpenRobotics/Table, name: t, static: true, x: 7, y: 0.1, z: 0, yaw: 0}
      - {model_name: OpenRobotics/Coke, name: Coke, static: false, x: 8, y: 4.5, z: 0, yaw: 0}
  L2:
    elevation: 3.5
    vertices:
      - [0, 0, 0, ""]
      - [4, 0, 0, ""]
      - [4, 4, 0, exit]
    floors:
      - {parameters: {}, vertices: [0, 1, 2]}
lifts:
  Lift1: {x: 9, y: 5, yaw: 0, width: 1.2, depth: 1.4}
"""


@pytest.fixture(scope="module")
def office() -> Site:
    if not OFFICE.exists():
        pytest.skip("the demo office is not here; put it in ../shared/sites")
    return IMPORTERS[".building.yaml"](OFFICE, ImportOptions())


def objects(site: Site, type: str) -> dict[str, Object]:
    return {name: object for name, object in site.map.objects.items() if site.ontology.is_subtype(object.type, type)}


def number(site: Site, object: Object, path: str) -> float:
    value = object.values.get(path, site.ontology.default(object.type, path))
    return float(value) if value is not None else 0.0


def spot(object: Object) -> Point:
    return float(object.values["PositionX"]), float(object.values["PositionY"])


def box(site: Site, object: Object) -> Box:
    return Box(*spot(object), number(site, object, "Shape.Width"), number(site, object, "Shape.Depth"), number(site, object, "RotationZ"))


def outlines(site: Site) -> list[list[Point]]:
    return [
        [
            (spot(floor)[0] + float(x), spot(floor)[1] + float(y))
            for x, y in (c.split(",") for c in str(floor.values["Shape.Outline"]).split())
        ]
        for floor in objects(site, "Floor").values()
    ]


def test_office_conforms_and_is_written_and_read_back(office: Site) -> None:
    assert violations(office.map, office.ontology) == []
    assert ontology_violations(office.ontology) == []
    reloaded = load_text(dump_ontology(office.ontology, base=upper()) + dump_map(office.map, office.ontology))
    assert reloaded.map == office.map


def test_office_has_what_is_drawn(office: Site) -> None:
    places = {
        "pantry",
        "lounge",
        "coe",
        "supplies",
        "presupplies",
        "hardware_2",
        "patrol_A1",
        "patrol_A2",
        "patrol_B",
        "patrol_C",
        "patrol_D1",
    }
    assert places <= objects(office, "Place").keys()
    assert objects(office, "Charger").keys() == {"tinyRobot1_charger", "tinyRobot2_charger"}
    assert objects(office, "DeliveryRobot").keys() == {"tinyRobot1", "tinyRobot2"}
    assert objects(office, "Door").keys() == {"main_door", "coe_door", "hardware_door"}
    assert (len(objects(office, "Wall")), len(objects(office, "Floor"))) == (33, 4)
    assert (len(objects(office, "Chair")), len(objects(office, "Bin"))) == (27, 3)
    assert number(office, office.map.objects["main_door"], "Shape.Width") == pytest.approx(1.9, abs=0.1)
    xs = [spot(wall)[0] for wall in objects(office, "Wall").values()]
    assert max(xs) - min(xs) == pytest.approx(18.8, abs=1.0), "the office is some 19 m long between the middles of its end walls"


def test_robots_stand_on_their_chargers(office: Site) -> None:
    for robot in ("tinyRobot1", "tinyRobot2"):
        assert spot(office.map.objects[robot]) == spot(office.map.objects[f"{robot}_charger"])


def test_everything_stands_on_a_floor_and_in_no_wall(office: Site) -> None:
    floors, walls = outlines(office), [box(office, wall) for wall in objects(office, "Wall").values()]
    assert len(objects(office, "Furniture")) == 74
    for name, object in {**objects(office, "Furniture"), **objects(office, "Place"), **objects(office, "Graspable")}.items():
        assert any(is_in_polygon(spot(object), floor) for floor in floors), f"{name} is outside"
    for name, object in objects(office, "Furniture").items():
        assert not any(separation(box(office, object), wall) for wall in walls), f"{name} overlaps a wall"
    for name, place in objects(office, "Place").items():
        assert clearance(spot(place), [*walls, *(box(office, f) for f in objects(office, "Furniture").values())]) >= 0.4, name


def test_doors_lie_in_gaps(office: Site) -> None:
    walls = [box(office, wall) for wall in objects(office, "Wall").values()]
    for name, door in objects(office, "Door").items():
        assert clearance(spot(door), walls) > 0.35, f"{name} has no opening"


def test_can_stands_where_a_robot_can_take_it(office: Site) -> None:
    (support,) = [fact.arguments[1] for fact in office.map.facts("isOn") if fact.arguments[0] == "Coke001"]
    can_object, support_box = office.map.objects["Coke001"], box(office, office.map.objects[support])
    assert office.map.objects[support].type == "WhiteCabinet"
    assert can_object.values["PositionZ"] == number(office, office.map.objects[support], "Shape.Height") == 1.08
    depth = -support_box.gap(spot(can_object))
    assert 0.05 < depth < 0.2
    assert math.dist(spot(can_object), spot(office.map.objects["pantry"])) < 1.5


def test_a_robot_gets_from_every_place_to_every_other(office: Site) -> None:
    """A flood over a 0.2 m grid of spots with room for a robot of 0.25 m radius."""
    solid = [box(office, o) for kind in ("Wall", "Furniture") for o in objects(office, kind).values()]
    floors = outlines(office)
    places = {name: (round(spot(place)[0] / 0.2), round(spot(place)[1] / 0.2)) for name, place in objects(office, "Place").items()}
    reached = {places["pantry"]}
    queue = deque(reached)
    while queue:
        x, y = queue.popleft()
        for neighbour in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            point = neighbour[0] * 0.2, neighbour[1] * 0.2
            if neighbour not in reached and any(is_in_polygon(point, floor) for floor in floors) and clearance(point, solid) > 0.25:
                reached.add(neighbour)
                queue.append(neighbour)
    assert [name for name, cell in places.items() if cell not in reached] == []


def test_small_building_in_metres_with_two_levels() -> None:
    site = import_text(SMALL)
    assert violations(site.map, site.ontology) == []
    assert site.name == "Depot_7"
    assert site.map.objects["goods_in"].type == "Charger"
    assert site.map.objects["goods_in"].values["Label"] == "goods in"
    assert spot(site.map.objects["robot_1"]) == (2.0, 3.0)
    assert site.map.objects["exit_L2"].values["PositionZ"] == 3.5
    assert site.map.objects["L2"].values["Elevation"] == 3.5
    assert site.map.objects["Lift1"].type == "Lift"


def test_door_is_cut_out_of_the_wall_it_is_in() -> None:
    site = import_text(SMALL)
    south = sorted((box(site, wall) for wall in objects(site, "Wall").values() if spot(wall)[1] == 0), key=lambda wall: wall.x)
    assert [(round(wall.x - wall.width / 2, 2), round(wall.x + wall.width / 2, 2)) for wall in south] == [(-0.05, 4.05), (4.95, 10.05)]
    assert site.map.objects["gate"].type == "AutomaticDoor"


def test_what_could_not_be_brought_in_as_it_is_is_noted() -> None:
    site = import_text(SMALL)
    for words in (
        "Contraption: the size is not known",
        "Table001 (0.36 m): moved out of a wall",
        "Lift1: the lift has no doors",
        "Coke001: nothing is below it",
    ):
        assert any(words in str(note) for note in site.notes), words
    assert site.map.has_fact("isOn", ("Coke001", "Floor001"))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("- [0, 1, {}]", "- [0, 99, {}]", 16, "wall 1 of L1"),
        ("- [4, 5, {name", "- [4, {name", 19, "door 1 of L1"),
        ("x: 5, y: 4,", "y: 4,", 23, "x is missing"),
        ("coordinate_system: cartesian_meters", "coordinate_system: furlongs", 1, "furlongs is not known; it is one of"),
        ("- [0, 1, {}]", "- [-1, 1, {}]", 16, "is no index"),
        ("levels:", "livels:", 1, "has levels"),
        ("- [4, 4, 0, exit]", "- [4, .inf, 0, exit]", 31, "vertex 3 of L2: cannot be read: inf is no number"),
        ("elevation: 3.5", "elevation: high", 26, "high is no number"),
        ("x: 5, y: 4, z: 0, yaw: 0", "x: 5, y: 4, z: 0, yaw: .nan", 23, "nan is no number"),
        ("vertices: [0, 1, 2]}", "vertices: [0, 1]}", 33, "it has 2 corners, and needs three"),
        ("name: Depot 7", "name: [", 4, "not YAML"),
        ("- [4, 5, {name", "- [4, 5, {motion_degrees: [3, wide], name", 19, "wide is no number"),
        ("type: [1, hinged]}", "type: [1, hinged, 2]}", 19, "type is [1.0, 'hinged', 2.0]; a parameter is [type code, value]"),
        ("- [4, 5, {name", "- [4, 5, [hinged], {name", 19, "it has not the form"),
        ("    vertices:\n", "    fiducials: [[1, 2]]\n    vertices:\n", 6, "it has too few values"),
        ("    vertices:\n", "    lanes: [[0, 99, {}]]\n    vertices:\n", 6, "it refers to vertex 99, which is not there"),
    ],
)
def test_what_cannot_be_understood_is_told_with_its_line(old: str, new: str, line: int, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        import_text(SMALL.replace(old, new, 1), "depot.building.yaml")
    assert caught.value.problems[0].line == line
    assert words in str(caught.value)


def test_parameters_may_be_written_by_hand() -> None:
    site = import_text(SMALL.replace("- [4, 4, 0, exit]", "- [4, 4, 0, exit, {is_charger: true}]"))
    assert site.map.objects["exit_L2"].type == "Charger"


def test_navigation_graph_is_told_from_a_building() -> None:
    with pytest.raises(ModelError, match=r"this is a navigation graph, .*; import the .building.yaml file"):
        import_text(
            "building_name: x\nlevels:\n  L1:\n    lanes:\n    - [0, 1, {}]\n    vertices:\n    - [0, 0, {name: a}]\n    - [1, 0, {}]\n"
        )


def test_reference_level_that_is_not_there_is_told() -> None:
    site = import_text(f"reference_level_name: L9\n{SMALL}")
    assert any("L9" in str(note) and "aligned with L1" in str(note) for note in site.notes)


@given(st.data())
def test_no_change_of_a_file_makes_the_import_fail_otherwise(data: st.DataObject) -> None:
    """A file with a value overwritten is brought in, or its problems are told; nothing else happens."""
    values = [match.span(1) for match in re.finditer(r"[:,\[] ?([^\s,\[\]{}]+|\[[^\[\]]*\]|\{\})(?=[\n,\]}])", SMALL)]
    start, end = data.draw(st.sampled_from(values))
    junk = data.draw(st.sampled_from(["-1", "1e400", ".nan", "''", "x", "null", "[]", "{}", "[1]", "{a: 1}", "99999999999", "true"]))
    try:
        site = import_text(SMALL[:start] + junk + SMALL[end:])
    except ModelError:
        return
    assert violations(site.map, site.ontology) == []


def test_a_thing_lies_on_the_floor_of_its_own_level() -> None:
    text = SMALL.replace(
        "      - {parameters: {}, vertices: [0, 1, 2]}",
        """      - {parameters: {}, vertices: [0, 1, 2]}
    models:
      - {model_name: OpenRobotics/Coke, name: Coke, static: false, x: 2, y: 1, z: 0, yaw: 0}""",
    )
    site = import_text(text)
    (floor,) = (fact.arguments[1] for fact in site.map.facts("isOn") if fact.arguments[0] == "Coke002")
    assert site.map.whole(floor) == "L2"
    assert site.map.objects["Coke002"].values["PositionZ"] == 3.5


def test_names_that_are_numbers_are_kept() -> None:
    site = import_text(SMALL.replace("  L1:", "  1:").replace("  L2:", "  2:").replace("Depot 7", "7"))
    assert {"n7", "n1", "n2"} <= site.map.objects.keys()


def test_a_level_that_is_not_there_is_told() -> None:
    level_doors = "level_doors: {L9: [door]}"
    text = re.sub(r"(  Lift1:? *\{)", rf"\1{level_doors}, ", SMALL)
    with pytest.raises(ModelError, match="name the level L9; the levels are L1, L2"):
        import_text(text)


def test_what_other_tools_have_written_is_noted() -> None:
    text = (
        SMALL.replace("    elevation: 0\n", "    elevation: 0\n    aisles:\n      - {vertices: [0, 1]}\n    charging_lots: []\n", 1)
        + "fleets: {a: 1}\n"
    )
    notes = [str(note) for note in import_text(text).notes]
    assert "aisles: parts of levels that SO-MRS does not know" in notes
    assert "fleets: parts of the building that SO-MRS does not know" in notes
    assert not any("charging_lots" in note for note in notes), "there are none"


def test_levels_without_elevation_are_noted() -> None:
    site = import_text(SMALL.replace("    elevation: 3.5\n", ""))
    assert any("level L2: has no elevation" in str(note) for note in site.notes)


def test_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.building\.yaml"):
        IMPORTERS[".building.yaml"](tmp_path / "none.building.yaml", ImportOptions())


coordinates = st.floats(-5, 5)
boxes = st.builds(Box, coordinates, coordinates, st.floats(0.1, 3), st.floats(0.1, 3), st.floats(-7, 7))


@given(boxes, boxes)
def test_separation_moves_a_box_just_out_of_another(first_box: Box, second_box: Box) -> None:
    push = separation(first_box, second_box)
    grid = [first_box.world((u * first_box.width / 20, v * first_box.depth / 20)) for u in range(-10, 11) for v in range(-10, 11)]
    if push is None:
        assert all(second_box.gap(point) > -1e-6 for point in grid)
    else:
        moved_box = first_box.moved((push[0] * 1.0001, push[1] * 1.0001))
        assert separation(moved_box, second_box) is None or math.hypot(*push) < 1e-6
        assert separation(first_box.moved((push[0] * 0.99, push[1] * 0.99)), second_box) is not None or math.hypot(*push) < 1e-6


@given(st.floats(0, 10), st.floats(0.1, 3), st.floats(-0.1, 0.1))
def test_wall_without_a_gap_is_as_much_shorter(start: float, width: float, aside: float) -> None:
    pieces = without_gap((0.0, 0.0), (10.0, 0.0), ((start, aside), (start + width, aside)))
    cut = max(0.0, min(start + width, 10.0) - start)
    assert sum(math.dist(*piece) for piece in pieces) == pytest.approx(10.0 - cut, abs=0.16)
