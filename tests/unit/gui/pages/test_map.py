"""What moving and adding on the map's page comes to, and how it reads and tells values and changes."""

from __future__ import annotations

import math

import pytest
from msgspec import structs

from somrs.errors import InputError, UsageError
from somrs.gui.pages.map.change_text import describe_changes, format_value
from somrs.gui.pages.map.merging import candidates
from somrs.gui.pages.map.moves import Move, move_changes, shape_changes
from somrs.gui.pages.map.proposals import Spot, creation_changes, form_for, name_for
from somrs.gui.pages.map.relations import fact_changes, relation_roles
from somrs.gui.pages.map.value_input import limits, read, text_of
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import UNKNOWN, Ontology, Value
from somrs.ontology.values import value_of
from somrs.protocol.messages.people import client_address, person_name
from somrs.space.zones import zones_of
from tests.support.lab import lab
from tests.support.paths import SCENARIO_1


@pytest.fixture(scope="module")
def site() -> tuple[Map, Ontology]:
    loaded = load([SCENARIO_1])
    assert loaded.map is not None
    return loaded.map, loaded.ontology


def apply_changes(site: tuple[Map, Ontology], changes: tuple[Change, ...]) -> Map:
    """The map after the changes, which obeys its types."""
    map = site[0].changed(changes)
    assert violations(map, site[1]) == []
    return map


def position_of(map: Map, ontology: Ontology, name: str) -> tuple[float, float, float]:
    x, y, z = (value_of(name, path, map, ontology) for path in ("PositionX", "PositionY", "PositionZ"))
    assert isinstance(x, float)
    assert isinstance(y, float)
    assert isinstance(z, float | int)
    return x, y, z


def test_a_thing_stands_on_what_it_is_put_on(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    map_after = apply_changes(site, move_changes(map, ontology, Move(name="Jar002", x=4.1, y=2.3, turned=0, target="Table001")))
    assert position_of(map_after, ontology, "Jar002") == (4.1, 2.3, 0.74)
    assert map_after.has_fact("isOn", ("Jar002", "Table001"))
    assert not map_after.has_fact("isOn", ("Jar002", "Cupboard001"))
    floor = apply_changes(site, move_changes(map, ontology, Move(name="Jar002", x=2, y=2, turned=0, target="Floor001")))
    assert position_of(floor, ontology, "Jar002")[2] == pytest.approx(0)


def test_a_turned_box_becomes_the_polygon_of_its_new_corners(site: tuple[Map, Ontology]) -> None:
    """A zone keeps what is not its shape."""
    values: dict[str, Value] = {"PositionX": 3.0, "PositionY": 2.0, "RotationZ": 0.5}
    values |= {"Shape.Form": "Box", "Shape.Width": 2.0, "Shape.Depth": 1.0, "SpeedLimit": 0.2}
    with_zone = site[0].changed([ObjectAdded(Object(name="Zone1", type="SlowZone", values=values))])
    corners = ((2.0, 1.0), (4.0, 1.0), (5.0, 3.0), (2.0, 2.0))
    changes = shape_changes(with_zone, "Zone1", corners)
    map_after = apply_changes((with_zone, site[1]), changes)
    (zone,) = zones_of(map_after, site[1]).zones
    assert zone.limit == 0.2
    assert [zone.area.world(*corner) for corner in zone.area.corners()] == [pytest.approx(corner) for corner in corners]
    assert shape_changes(map_after, "Zone1", corners) == ()
    with pytest.raises(UsageError, match="its sides cross"):
        shape_changes(map_after, "Zone1", (corners[0], corners[2], corners[1], corners[3]))


def test_what_stands_on_a_table_moves_and_turns_with_it(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    turned = apply_changes(site, move_changes(map, ontology, Move(name="Table002", x=5, y=5, turned=math.pi / 2)))
    (tx, ty, _), (cx, cy, cz) = position_of(map, ontology, "Table002"), position_of(map, ontology, "Carton001")
    dx, dy = cx - tx, cy - ty
    assert position_of(turned, ontology, "Carton001") == pytest.approx((5 - dy, 5 + dx, cz), abs=1e-4)
    assert value_of("Carton001", "RotationZ", turned, ontology) == pytest.approx(math.pi / 2, abs=1e-5)
    assert turned.has_fact("isOn", ("Carton001", "Table002"))


def test_only_what_changed_is_said(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    changes = move_changes(map, ontology, Move(name="Chair001", x=1, y=1, turned=0))
    assert {change.path for change in changes if isinstance(change, ValueSet)} == {"PositionX", "PositionY"}


def test_a_robot_that_is_moved_away_is_at_its_place_no_more(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    docked_map = map.changed([FactAdded(Fact("isAt", ("Robot1", "Charger001")))])
    assert FactRemoved(Fact("isAt", ("Robot1", "Charger001"))) in move_changes(
        docked_map, ontology, Move(name="Robot1", x=5, y=5, turned=0)
    )
    assert not any(
        isinstance(change, FactRemoved) for change in move_changes(docked_map, ontology, Move(name="Robot1", x=1.1, y=0.8, turned=0))
    )


def test_names_go_on_from_those_of_the_kind(site: tuple[Map, Ontology]) -> None:
    map, _ = site
    assert name_for("Jar", map) == "Jar004"
    assert name_for("PioneerP3DX", map) == "Robot3"
    assert name_for("Plant", map) == "Plant001"


@pytest.mark.parametrize(
    "type_name", ["Jar", "Table", "Plant", "Wall", "Door", "Window", "Camera", "PioneerP3DX", "Place", "Carton", "Pillar"]
)
def test_what_is_proposed_can_be_added(site: tuple[Map, Ontology], type_name: str) -> None:
    map, ontology = site
    spot = Spot(x=3, y=4, turned=0.5, target="Floor001", storey="Storey001")
    name = name_for(type_name, map)
    map_after = apply_changes(site, creation_changes(type_name, name, form_for(type_name, map, ontology), spot, map, ontology))
    assert position_of(map_after, ontology, name)[:2] == (3, 4)


@pytest.mark.parametrize("type_name", ["Person", "Room", "Corridor"])
def test_what_has_no_place_is_a_part_of_the_building(site: tuple[Map, Ontology], type_name: str) -> None:
    map, ontology = site
    map_after = apply_changes(site, creation_changes(type_name, "New1", {}, None, map, ontology))
    assert map_after.whole("New1") == "Building001"


def test_a_thing_that_is_added_on_a_table_stands_on_it(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    map_after = apply_changes(
        site, creation_changes("Cup", "Cup001", {}, Spot(x=4, y=2.2, target="Table001", storey="Storey001"), map, ontology)
    )
    assert map_after.has_fact("isOn", ("Cup001", "Table001"))
    assert position_of(map_after, ontology, "Cup001")[2] == 0.74


def test_values_are_read_in_any_fitting_unit(site: tuple[Map, Ontology]) -> None:
    attributes = site[1].attributes
    assert read("450 g", attributes["Weight"]) == pytest.approx(0.45)
    assert read("0,5", attributes["Weight"]) == 0.5
    assert read("90", attributes["RotationZ"]) == pytest.approx(math.pi / 2)
    assert read("1.5 rad", attributes["RotationZ"]) == 1.5
    assert read("80 %", attributes["Charge"]) == pytest.approx(80)
    assert text_of(math.pi / 2, attributes["RotationZ"]) == "90"


@pytest.mark.parametrize(
    ("path", "text", "expected_text"),
    [
        ("Weight", "heavy", "Weight is a number in kg, not 'heavy'"),
        ("Weight", "3 m", "cannot be expressed in it"),
        ("Weight", "-1", "at least 0"),
        ("Charge", "120", "at most 100"),
        ("Color", "Pink", "Color is one of Black"),
    ],
)
def test_what_is_wrong_with_a_value_is_said(site: tuple[Map, Ontology], path: str, text: str, expected_text: str) -> None:
    with pytest.raises(InputError, match=expected_text):
        read(text, site[1].attributes[path])


def test_ranges_of_type_and_attribute_are_told_together(site: tuple[Map, Ontology]) -> None:
    ontology = site[1]
    assert limits("Weight", ontology.attributes["Weight"], "Jar", ontology) == "0 to 5 kg"
    assert limits("Charge", ontology.attributes["Charge"], "PioneerP3DX", ontology) == "0 to 100 %"


def test_a_fact_that_is_added_drives_out_what_cannot_hold_with_it(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    held_fact = Fact("isHeldBy", ("Jar002", "Robot1"))
    map_after = apply_changes(site, tuple(fact_changes(held_fact, map, ontology)))
    assert [str(fact) for fact in map_after.facts_about("Jar002")] == ["Jar002 isHeldBy Robot1"]
    new_fact = Fact("isOn", ("Jar002", "Table001"))
    assert [str(fact) for fact in apply_changes(site, tuple(fact_changes(new_fact, map, ontology))).facts_about("Jar002")] == [
        "Jar002 isOn Table001"
    ]


def test_every_place_in_a_relation_that_fits_a_type_is_offered(site: tuple[Map, Ontology]) -> None:
    seat_texts = [seat.text() for seat in relation_roles("Door", site[1])]
    assert "connects(this, Space, Space)" in seat_texts
    assert "this isAdjacentTo Object" in seat_texts
    assert "Object isAdjacentTo this" not in seat_texts
    assert "Object isPartOf this" in seat_texts


def test_changes_are_told_in_words(site: tuple[Map, Ontology]) -> None:
    map, ontology = site
    assert describe_changes(move_changes(map, ontology, Move(name="Jar002", x=8.2, y=2.5, turned=0, target="Platform001")), ontology) == [
        "Jar002 moved to x 8.20 m, y 2.50 m, put on Platform001"
    ]
    assert describe_changes([ObjectRemoved("Jar002")], ontology) == ["Jar002 removed"]
    assert describe_changes([ValueSet("Door001", "Open", False)], ontology) == ["Door001 Open set to no"]
    assert describe_changes([ValueSet("Jar002", "Unknown", True)], ontology) == ["Jar002 has an unknown position and state"]
    assert format_value(math.pi, ontology.attributes["RotationZ"]) == "180°"


@pytest.mark.parametrize(
    ("author", "expected_name"),
    [
        ("Anna", "Anna"),
        ("Robot1.TransferObject", "Robot1.TransferObject"),
        ("urn:so-mrs:client:root@vm", "root@vm"),
        (client_address("Anna Maria/2@vm"), "Anna Maria/2@vm"),
        (client_address(client_address("root@vm")), "root@vm"),
        ("http://127.0.0.1:4242/devices/Robot1", "Robot1"),
        ("", "somebody"),
    ],
)
def test_authors_are_told_as_people_know_them(author: str, expected_name: str) -> None:
    assert person_name(author) == expected_name


def test_the_likeliest_object_that_a_discovered_one_may_be_comes_first() -> None:
    ontology, _ = lab()
    places = {"New1": 5.0, "Jar1": 1.0, "Jar2": 4.0, "Lost1": 9.0}
    jars = [Object(name=name, type="Jar", values={"PositionX": x, "PositionY": 0.0, "PositionZ": 0.0}) for name, x in places.items()]
    lost = structs.replace(jars[-1], values={**jars[-1].values, UNKNOWN: True})
    others = [Object(name="Thing1", type="Graspable"), Object(name="Cup1", type="Cup"), Object(name="Robot1", type="PioneerP3DX")]
    found = candidates("New1", Map([*jars[:-1], lost, *others]), ontology)
    assert [option.label for option in found] == [
        "Lost1 · Jar · nobody knows where it is",
        "Jar2 · Jar · 1.0 m away",
        "Jar1 · Jar · 4.0 m away",
        "Thing1 · Graspable",
    ]
