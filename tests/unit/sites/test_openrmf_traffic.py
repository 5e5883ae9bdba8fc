"""What a building file says about traffic is kept: lanes, what waypoints are for, kinds of doors, lifts, robots and what they can do."""

from __future__ import annotations

import math
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.drivers.vehicle import Vehicle
from somrs.errors import ModelError
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load_text
from somrs.ontology.files.site import dump_site
from somrs.sites import ImportOptions, Site
from somrs.sites.openrmf import import_text


def flag(value: bool = True) -> list[object]:
    return [4, value]


def text(value: str) -> list[object]:
    return [1, value]


def number(value: float) -> list[object]:
    return [3, value]


def depot() -> dict[str, Any]:
    """A depot of two storeys with a lift: 10 m by 8 m."""
    vertices: list[list[Any]] = [
        [0, 0, 0, ""],
        [10, 0, 0, ""],
        [10, 8, 0, ""],
        [0, 8, 0, ""],
        [2, 2, 0, "", {"is_holding_point": flag(), "is_parking_spot": flag(False)}],
        [5, 2, 0, "store", {"is_parking_spot": flag(), "pickup_dispenser": text("dispenser 1")}],
        [8, 2, 0, "", {"is_charger": flag(), "spawn_robot_name": text("tiny1"), "spawn_robot_type": text("Open-RMF/TinyRobot")}],
        [
            2,
            5,
            0,
            "wash",
            {"is_cleaning_zone": flag(), "spawn_robot_name": text("wiper"), "spawn_robot_type": text("Open-RMF/CleanerBotA")},
        ],
        [8, 5, 0, "", {"lift_cabin": text("Lift1"), "is_passthrough_point": flag(), "mutex": text("bay")}],
        [5, 6, 0, "dock", {"dock_name": text("rail"), "spawn_robot_name": text("stranger"), "spawn_robot_type": text("Acme/Walker")}],
    ]
    return {
        "name": "depot",
        "coordinate_system": "cartesian_meters",
        "levels": {
            "L1": {
                "elevation": 0,
                "vertices": vertices,
                "floors": [{"vertices": [0, 1, 2, 3], "parameters": {}}],
                "holes": [{"vertices": [0, 1, 4], "parameters": {}}],
                "doors": [
                    [0, 1, {"name": text("gate"), "type": text("double_hinged"), "motion_degrees": [3, 90], "motion_direction": [2, -1],
                            "plugin": text("normal")}],
                    [1, 2, {"name": text("null"), "type": text("telescope"), "plugin": text("none")}],
                    [3, 2, {"name": text("hatch"), "type": text("hinged"), "motion_axis": text("end"), "motion_degrees": [3, -90]}],
                ],
                "lanes": [
                    [4, 5, {"bidirectional": flag(), "graph_idx": [2, 1], "speed_limit": number(0.5), "mutex": text("alley")}],
                    [6, 5, {"bidirectional": flag(False), "graph_idx": [2, 0], "orientation": text("backward"), "speed_limit": number(0)}],
                    [5, 8, {"graph_idx": [2, 0]}],
                ],
                "human_lanes": [[4, 5, {"width": number(3), "graph_idx": [2, 9]}]],
                "models": [
                    {"model_name": "OpenRobotics/TeleportDispenser", "name": "dispenser 1", "x": 5, "y": 1, "z": 0, "yaw": 0}
                ],
            },
            "L2": {
                "elevation": 4,
                "vertices": [[0, 0, 0, ""], [10, 0, 0, ""], [10, 8, 0, ""], [8, 5, 0, "", {"lift_cabin": text("Lift1")}]],
                "floors": [{"vertices": [0, 1, 2], "parameters": {}}],
            },
        },
        "lifts": {
            "Lift1": {
                "x": 8, "y": 5, "yaw": math.pi / 2, "width": 2, "depth": 1.6, "reference_floor_name": "L1", "initial_floor_name": "L2",
                "level_doors": {"L1": ["front"], "L2": ["front"]},
                "doors": {"front": {"door_type": 2, "x": 0, "y": 0.85, "width": 1.2, "motion_axis_orientation": 0}},
            }
        },
        "crowd_sim": {
            "agent_groups": [
                {"agents_name": ["tiny1"], "agents_number": 1, "x": 0, "y": 0},
                {"agents_name": [], "agents_number": 4, "x": 7, "y": 4},
            ]
        },
    }  # fmt: skip


def imported(building: dict[str, Any], options: ImportOptions | None = None) -> Site:
    site = import_text(yaml.safe_dump(building), "depot.building.yaml", options)
    assert violations(site.map, site.ontology) == []
    assert load_text(dump_site(site.ontology, site.map)).map == site.map
    return site


@pytest.fixture(scope="module")
def site() -> Site:
    return imported(depot())


def lanes(site: Site) -> dict[tuple[str, str], dict[str, Any]]:
    """The lanes by their ends."""
    ends = {relation: {f.arguments[0]: f.arguments[1] for f in site.map.facts(relation)} for relation in ("startsAt", "endsAt")}
    return {
        (ends["startsAt"][name], ends["endsAt"][name]): dict(object.values)
        for name, object in site.map.objects.items()
        if object.type == "Lane"
    }


def test_lanes_are_kept_with_directions_graphs_and_limits(site: Site) -> None:
    assert lanes(site) == {
        ("Waypoint001", "store"): {"NavigationGraph": "1", "Bidirectional": True, "SpeedLimit": 0.5, "Mutex": "alley"},
        ("tiny1_start", "store"): {"NavigationGraph": "0", "Travel": "Backward"},
        ("store", "Waypoint002"): {"NavigationGraph": "0"},
    }


def test_what_vertices_are_for_is_kept(site: Site) -> None:
    objects = site.map.objects
    assert (objects["Waypoint001"].type, objects["Waypoint001"].values.get("HoldingPoint")) == ("Waypoint", True)
    assert "ParkingSpot" not in objects["Waypoint001"].values
    assert (objects["store"].type, objects["store"].values["ParkingSpot"]) == ("Place", True)
    assert objects["tiny1_start"].type == "Charger"
    assert objects["wash"].values["CleaningZone"] is True
    assert objects["dock"].values["DockName"] == "rail"
    assert (objects["Waypoint002"].values["PassthroughPoint"], objects["Waypoint002"].values["Mutex"]) == (True, "bay")


def test_waypoints_are_where_the_file_has_them(site: Site) -> None:
    for name, place in (("Waypoint001", (2.0, 2.0)), ("Waypoint002", (8.0, 5.0))):
        values = site.map.objects[name].values
        assert (values["PositionX"], values["PositionY"]) == place


def test_dispenser_is_a_station_at_its_waypoint(site: Site) -> None:
    station = site.map.objects["dispenser_1"]
    assert (station.type, station.values["PositionY"], station.values["ExternalId"]) == ("Station", 1.0, "dispenser 1")
    assert site.map.has_fact("interactsAt", ("dispenser_1", "store"))


def test_dispenser_without_a_model_is_a_station_at_its_vertex() -> None:
    building = depot()
    building["levels"]["L1"]["models"] = []
    site = imported(building)
    assert site.map.objects["dispenser_1"].values["PositionY"] == 2.0
    assert site.map.has_fact("interactsAt", ("dispenser_1", "store"))


def test_doors_have_their_kind_and_swing(site: Site) -> None:
    gate, hatch = site.map.objects["gate"].values, site.map.objects["hatch"].values
    assert (gate["DoorKind"], hatch["DoorKind"]) == ("DoubleHinged", "Hinged")
    assert gate["SwingAngle"] == pytest.approx(math.pi / 2, abs=1e-3), "direction -1: counter-clockwise"
    assert hatch["SwingAngle"] == pytest.approx(-math.pi / 2, abs=1e-3), "by default, clockwise"
    assert math.cos(float(hatch["RotationZ"])) == pytest.approx(-1), "its hinge is at the end, in the east"
    assert site.map.objects["Door002"].values["DoorKind"] == "Telescope"


def test_doors_with_a_drive_open_by_themselves_and_all_are_shut(site: Site) -> None:
    doors = {name: (site.map.objects[name].type, site.map.objects[name].values["Open"]) for name in ("gate", "hatch", "Door002")}
    assert doors == {"gate": ("AutomaticDoor", False), "hatch": ("AutomaticDoor", False), "Door002": ("Door", False)}


def test_lift_has_its_cabin_storeys_and_doors(site: Site) -> None:
    lift = site.map.objects["Lift1"].values
    assert (lift["Shape.Width"], lift["Shape.Depth"], lift["PositionZ"]) == (2.0, 1.6, 4.0)
    assert {f.arguments for f in site.map.facts("stopsAt")} == {("Lift1", "L1"), ("Lift1", "L2")}
    doors = {f.arguments[0] for f in site.map.facts("leadsInto")}
    assert {site.map.objects[door].values["PositionZ"] for door in doors} == {0.0, 4.0}
    for door in doors:
        values = site.map.objects[door].values
        assert (values["PositionX"], values["PositionY"]) == pytest.approx((8 - 0.85, 5)), "the cabin is turned by a quarter"
        assert (values["DoorKind"], values["Open"]) == ("DoubleSliding", False)
    assert {f.arguments[1] for f in site.map.facts("isIn")} == {"Lift1"}


def test_robots_can_do_what_their_model_can(site: Site) -> None:
    robots = {name: site.map.objects[name].type for name in ("tiny1", "wiper", "stranger")}
    assert robots == {"tiny1": "DeliveryRobot", "wiper": "CleaningRobot", "stranger": "Vehicle"}
    assert not site.ontology.is_subtype("CleaningRobot", "MobileManipulator")
    assert site.ontology.driver("CleaningRobot") == site.ontology.driver("Vehicle") == f"{Vehicle.__module__}:Vehicle"
    assert any("Acme" not in str(note) and "Walker: it is not known what this robot can do" in str(note) for note in site.notes)


def test_vehicle_neither_carries_nor_looks() -> None:
    assert set(Vehicle("Cart1").services()) == {"move_to", "charge"}
    assert {"move_to", "charge", "look_at_place"} < set(Manipulator("Arm1").services())


def test_robot_faces_along_its_lane_and_uses_its_graph(site: Site) -> None:
    values = site.map.objects["tiny1"].values
    assert math.cos(float(values.get("RotationZ", 0.0))) == pytest.approx(1.0), "it drives its lane, which leads west, backwards"
    assert values["NavigationGraph"] == "0"


def test_hole_keeps_robots_out(site: Site) -> None:
    (hole,) = (object for object in site.map.objects.values() if object.type == "Hole")
    assert float(hole.values["PositionZ"]) + float(hole.values["Shape.Height"]) > 0.05


def test_crowd_is_an_option(site: Site) -> None:
    assert [str(note) for note in site.notes if "crowd" in note.text] == ["4 people, 1 lanes: the crowd is left out; --crowds imports it"]
    crowded = imported(depot(), ImportOptions(crowds=True))
    people = [object for object in crowded.map.objects.values() if object.type == "Pedestrian"]
    assert len(people) == 4
    assert all(math.dist((float(p.values["PositionX"]), float(p.values["PositionY"])), (7, 4)) < 2 for p in people)
    assert any(lane.get("LaneWidth") == 3.0 and lane["NavigationGraph"] == "9" for lane in lanes(crowded).values())


def test_parameters_that_are_not_known_are_told() -> None:
    building = depot()
    building["levels"]["L1"]["lanes"][0][2]["tilt"] = number(1)
    assert any("tilt" in str(note) for note in imported(building).notes)


def test_mistake_in_a_door_is_told_with_its_line() -> None:
    building = depot()
    building["levels"]["L1"]["doors"][2][2]["motion_degrees"] = text("wide")
    with pytest.raises(ModelError, match="door 3 of L1: cannot be read: wide is no number"):
        imported(building)


JUNK = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-3, 12) | st.sampled_from(["", "x", "L1", "Lift1", "null", "wgs84", "hinged"]),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["L1", "x", "y", "name", "vertices", "doors"]), inner, max_size=4)
    ),
    max_leaves=8,
)


@given(st.data())
def test_no_document_makes_the_import_fail_without_a_reason(data: st.DataObject) -> None:
    """Anything may stand at any place of a file: it is brought in, or its problems are told."""
    building: Any = depot()
    for _ in range(data.draw(st.integers(1, 3))):
        node: Any = building
        while True:
            key = data.draw(st.sampled_from(sorted(node, key=str) if isinstance(node, dict) else range(len(node))))
            child = node[key]
            if not isinstance(child, dict | list) or not child or data.draw(st.booleans()):
                node[key] = data.draw(JUNK)
                break
            node = child
    try:
        site = import_text(yaml.safe_dump(building), options=ImportOptions(crowds=data.draw(st.booleans())))
    except ModelError:
        return
    assert violations(site.map, site.ontology) == []
