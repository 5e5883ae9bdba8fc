"""Layouts in the Layout Interchange Format: in, out, and both again, also by the official schema and examples, if they are there."""

from __future__ import annotations

import copy
import json
import math
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import InputError, ModelError, UsageError
from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.files.site import dump_site
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactRemoved, Object
from somrs.ontology.types import PART_OF, Value
from somrs.sites import IMPORTERS, ImportOptions, Site
from somrs.sites.lif.reading import import_bytes
from somrs.sites.lif.writing import ANY_VEHICLE, export_layouts
from tests.support.paths import SHARED

LIF = SHARED / "lif"
NOW = "2026-11-27T01:00:00Z"

needs_format = pytest.mark.skipif(not LIF.exists(), reason="the schema and the text of LIF are not in ../shared/lif")


def node(id: str, x: float, y: float, *, name: str | None = None, actions: tuple[str, ...] = ()) -> dict[str, Any]:
    listed = [{"actionType": action, "blockingType": "HARD", "requirementType": "OPTIONAL"} for action in actions]
    properties = [{"vehicleTypeId": "cart", "actions": listed}, {"vehicleTypeId": "truck"}]
    label = {"nodeName": name} if name is not None else {}
    return {"nodeId": id, "nodePosition": {"x": x, "y": y}, "mapId": "m", "vehicleTypeNodeProperties": properties, **label}


def edge(id: str, start: str, end: str, **properties: Any) -> dict[str, Any]:
    """An edge for carts, with these properties, and for trucks."""
    vehicles = [{"vehicleTypeId": "cart", "rotationAllowed": True, **properties}, {"vehicleTypeId": "truck", "rotationAllowed": False}]
    return {"edgeId": id, "startNodeId": start, "endNodeId": end, "vehicleTypeEdgeProperties": vehicles}


def works() -> dict[str, Any]:
    """Two levels, joined by an edge as of a lift."""
    return {
        "metaInformation": {"projectIdentification": "Works 3", "creator": "us", "exportTimestamp": NOW, "lifVersion": "1.0.0"},
        "layouts": [
            {
                "layoutId": "ground",
                "layoutVersion": "1",
                "layoutLevelId": "0",
                "nodes": [
                    node("n-1", 0, 0, name="bay"),
                    node("n-2", 10, 0, actions=("startCharging", "beep")),
                    node("n-3", 10, 5),
                    node("n-4", 4, 5),
                ],
                "edges": [
                    edge("e1", "n-1", "n-2", maxSpeed=0.5, vehicleOrientation=math.pi),
                    edge("e2", "n-2", "n-3", vehicleOrientation=0.0, trajectory={"knotVector": [], "controlPoints": []}),
                    edge("e3", "n-3", "n-1", vehicleOrientation=1.5),
                    edge("up", "n-3", "m-1"),
                ],
                "stations": [
                    {"stationId": "rack 7", "interactionNodeIds": ["n-3", "n-4"], "stationName": "Rack", "stationHeight": "0.6"},
                    {"stationId": "press", "interactionNodeIds": ["n-1"], "stationPosition": {"x": 0, "y": -1, "theta": 1.57}},
                ],
            },
            {"layoutId": "upper", "layoutVersion": "1", "layoutLevelId": "1", "nodes": [node("m-1", 10, 5)], "edges": []},
        ],
    }


def imported(layouts: dict[str, Any]) -> Site:
    site = import_bytes(json.dumps(layouts).encode())
    assert violations(site.map, site.ontology) == []
    assert load_text(dump_site(site.ontology, site.map)).map == site.map
    return site


@pytest.fixture(scope="module")
def site() -> Site:
    return imported(works())


Lanes = set[tuple[str, str, tuple[tuple[str, Value], ...]]]


def lanes(site_map: Map) -> Lanes:
    """The lanes by the positions of their ends, with what they state; those in both directions as two."""
    ends = {relation: {f.arguments[0]: f.arguments[1] for f in site_map.facts(relation)} for relation in ("startsAt", "endsAt")}
    result: Lanes = set()
    turned = {"Forward": "Backward", "Backward": "Forward"}
    for name, object in site_map.objects.items():
        if object.type == "Lane":
            start, end = (str(place(site_map.objects[ends[relation][name]])) for relation in ("startsAt", "endsAt"))
            values = {path: value for path, value in object.values.items() if path not in ("ExternalId", "Bidirectional")}
            result.add((start, end, tuple(sorted(values.items()))))
            if object.values.get("Bidirectional"):
                if "Travel" in values:
                    values["Travel"] = turned[str(values["Travel"])]
                result.add((end, start, tuple(sorted(values.items()))))
    return result


def place(object: Object) -> tuple[float, float]:
    return float(object.values["PositionX"]), float(object.values["PositionY"])


def test_edges_are_lanes_for_each_type_of_vehicle(site: Site) -> None:
    bay, charger = "(0.0, 0.0)", "(10.0, 0.0)"
    assert {lane for lane in lanes(site.map) if lane[:2] == (bay, charger)} == {
        (bay, charger, (("NavigationGraph", "cart"), ("SpeedLimit", 0.5), ("Travel", "Backward"))),
        (bay, charger, (("NavigationGraph", "truck"),)),
    }
    assert len(lanes(site.map)) == 8


def test_nodes_are_what_they_are_for(site: Site) -> None:
    by_id = {object.values.get("ExternalId", name): object for name, object in site.map.objects.items()}
    assert {id: by_id[id].type for id in ("n-1", "n-2", "n-3", "m-1")} == {
        "n-1": "Place",
        "n-2": "Charger",
        "n-3": "Place",
        "m-1": "Waypoint",
    }
    assert by_id["n-1"].values["Label"] == "bay"
    assert by_id["m-1"].values["PositionZ"] == 4.0


def test_stations_are_where_they_are_or_amid_their_nodes(site: Site) -> None:
    assert place(site.map.objects["rack_7"]) == (7.0, 5.0)
    assert (site.map.objects["rack_7"].values["PositionZ"], site.map.objects["rack_7"].values["Label"]) == (0.6, "Rack")
    assert place(site.map.objects["press"]) == (0.0, -1.0)
    assert len(list(site.map.facts("interactsAt"))) == 3


def test_what_is_not_kept_is_told_once(site: Site) -> None:
    notes = [str(note) for note in site.notes]
    for words in ("e2: the curve", "e3: an orientation across", "n-2: the action beep", "no floors", "no elevations"):
        assert sum(words in note for note in notes) == 1, words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda layouts: layouts["layouts"][0]["edges"][0].update(startNodeId="n-9"), "edge e1: there is no node n-9"),
        (lambda layouts: layouts["layouts"][0]["stations"][0].update(interactionNodeIds=["n-9"]), "station rack 7: there is no node n-9"),
        (lambda layouts: layouts["layouts"][1]["nodes"].append(node("n-1", 0, 0)), "node n-1: is defined twice"),
        (lambda layouts: layouts["layouts"][0]["edges"].append(edge("e1", "n-1", "n-2")), "edge e1: is defined twice"),
        (lambda layouts: layouts["layouts"][0]["nodes"][0].update(nodePosition={"x": "far", "y": 0}), r"nodes\[0\].nodePosition.x"),
        (lambda layouts: layouts.update(layouts=[]), "nothing to import"),
        (lambda layouts: layouts.pop("metaInformation"), "metaInformation"),
        (lambda layouts: layouts["metaInformation"].update(lifVersion="2.0.0"), "its lifVersion is 2.0.0, and SO-MRS reads 0.x and 1.x"),
    ],
)
def test_mistakes_are_told_with_their_place(change: Any, words: str) -> None:
    layouts = works()
    change(layouts)
    with pytest.raises(ModelError, match=words):
        import_bytes(json.dumps(layouts).encode())


def test_exported_layouts_are_imported_as_they_were(site: Site) -> None:
    again = import_bytes(export_layouts(site.ontology, site.map, exported_at=NOW))
    assert lanes(again.map) == lanes(site.map)
    ids = {object.values.get("ExternalId") for object in again.map.objects.values() if object.type == "Lane"}
    assert {object.values.get("ExternalId") for object in site.map.objects.values() if object.type == "Lane"} - {None} <= ids | {None}
    assert {f.arguments[0] for f in again.map.facts("interactsAt")} == {"rack_7", "press"}


def test_vehicles_stand_at_a_node_as_the_file_says() -> None:
    layouts = works()
    charger = layouts["layouts"][0]["nodes"][1]
    for properties in charger["vehicleTypeNodeProperties"]:
        properties["theta"] = -1.5
    layouts["layouts"][0]["nodes"][2]["vehicleTypeNodeProperties"][0]["theta"] = 1.0
    layouts["layouts"][0]["nodes"][2]["vehicleTypeNodeProperties"][1]["theta"] = 2.0
    site = imported(layouts)
    assert site.map.objects["n_2"].values["RotationZ"] == -1.5
    assert any("n-3: the headings at a node" in str(note) for note in site.notes)
    written = json.loads(export_layouts(site.ontology, site.map, exported_at=NOW))
    (again,) = (node for node in written["layouts"][0]["nodes"] if node["nodeId"] == "n-2")
    assert [properties["theta"] for properties in again["vehicleTypeNodeProperties"]] == [-1.5, -1.5]
    assert "theta" not in again["nodePosition"], "the format has the heading of vehicles, not of nodes"


@given(st.floats(-1000, 1000))
def test_headings_are_from_minus_half_a_turn_to_half_a_turn(turn: float) -> None:
    objects = [Object(name=name, type="Waypoint", values={"PositionX": 0.0, "PositionY": 0.0, "RotationZ": turn}) for name in "AB"]
    lane = [Object(name="L", type="Lane")]
    written = json.loads(
        export_layouts(upper(), Map([*objects, *lane], [Fact("startsAt", ("L", "A")), Fact("endsAt", ("L", "B"))]), exported_at=NOW)
    )
    theta = written["layouts"][0]["nodes"][0]["vehicleTypeNodeProperties"][0]["theta"]
    assert -math.pi <= theta <= math.pi
    assert math.cos(theta - turn) == pytest.approx(1.0)


def test_station_beside_the_storeys_is_in_the_layout_of_its_waypoint(site: Site) -> None:
    elsewhere = site.map.changed([FactRemoved(Fact(PART_OF, ("press", "Level_0")))])
    written = json.loads(export_layouts(site.ontology, elsewhere, exported_at=NOW))
    assert [station["stationId"] for station in written["layouts"][0]["stations"]] == ["rack 7", "press"]


def test_map_without_lanes_is_not_exported() -> None:
    with pytest.raises(UsageError, match="no lanes"):
        export_layouts(upper(), Map([Object(name="B", type="Building")]), exported_at=NOW)


# Any map

spots = st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=2, max_size=6, unique=True)


@st.composite
def tracks(draw: st.DrawFn) -> Map:
    """A storey with waypoints and lanes between them, of different types of vehicles. Other systems may know several by one name."""
    points = draw(spots)
    external_ids: st.SearchStrategy[dict[str, Value]] = st.fixed_dictionaries(
        {}, optional={"ExternalId": st.sampled_from(["W1", "L1", "L1_reverse", "7"])}
    )
    objects = [Object(name="B", type="Building"), Object(name="S", type="Storey")]
    floor: dict[str, Value] = {"PositionX": 0.0, "PositionY": 0.0, "PositionZ": -0.1, "Shape.Form": "Box", "Shape.Width": 200.0}
    objects.append(Object(name="F", type="Floor", values=floor | {"Shape.Depth": 200.0, "Shape.Height": 0.1}))
    facts = [Fact(PART_OF, ("S", "B")), Fact(PART_OF, ("F", "S"))]
    for index, (x, y) in enumerate(points):
        values: dict[str, Value] = {"PositionX": float(x), "PositionY": float(y), "PositionZ": 0.0, **draw(external_ids)}
        objects.append(Object(name=f"W{index}", type=draw(st.sampled_from(["Waypoint", "Place", "Charger"])), values=values))
        facts.append(Fact(PART_OF, (f"W{index}", "S")))
    for index in range(draw(st.integers(1, 6))):
        start, end = draw(st.sampled_from([(a, b) for a in range(len(points)) for b in range(len(points)) if a != b]))
        stated: dict[str, Value] = draw(
            st.fixed_dictionaries(
                {},
                optional={
                    "NavigationGraph": st.sampled_from(["0", "cart"]),
                    "SpeedLimit": st.floats(0.1, 2),
                    "Travel": st.sampled_from(["Forward", "Backward"]),
                    "Bidirectional": st.booleans(),
                },
            )
        )
        objects.append(Object(name=f"L{index}", type="Lane", values=stated | draw(external_ids)))
        facts += [Fact("startsAt", (f"L{index}", f"W{start}")), Fact("endsAt", (f"L{index}", f"W{end}")), Fact(PART_OF, (f"L{index}", "S"))]
    return Map(objects, facts)


@given(tracks())
def test_any_lanes_come_back(drawn: Map) -> None:
    again = import_bytes(export_layouts(upper(), drawn, exported_at=NOW)).map
    graphs = sorted({str(o.values["NavigationGraph"]) for o in drawn.objects.values() if "NavigationGraph" in o.values}) or [ANY_VEHICLE]
    expected = {
        (start, end, tuple(sorted({**dict(values), "NavigationGraph": graph}.items())))
        for start, end, values in lanes(drawn)
        for graph in ([dict(values)["NavigationGraph"]] if "NavigationGraph" in dict(values) else graphs)
    }
    assert lanes(again) == expected


JUNK = st.recursive(
    st.none()
    | st.booleans()
    | st.floats(allow_nan=False)
    | st.sampled_from(["", "n-1", "x", "\ud800".encode("utf-8", "replace").decode()]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["nodeId", "x", "y", "nodes"]), inner, max_size=3),
    max_leaves=6,
)


@given(st.data())
def test_no_document_makes_the_import_fail_without_a_reason(data: st.DataObject) -> None:
    layouts: Any = copy.deepcopy(works())
    target: Any = layouts
    while True:
        key = data.draw(st.sampled_from(sorted(target) if isinstance(target, dict) else range(len(target))))
        if not isinstance(target[key], dict | list) or not target[key] or data.draw(st.booleans()):
            target[key] = data.draw(JUNK)
            break
        target = target[key]
    try:
        site = import_bytes(json.dumps(layouts).encode())
    except ModelError:
        return
    assert violations(site.map, site.ontology) == []


@given(st.binary(max_size=60))
def test_no_bytes_make_the_import_fail_without_a_reason(content: bytes) -> None:
    with pytest.raises(ModelError):
        import_bytes(content)


def test_file_that_is_not_there() -> None:
    with pytest.raises(InputError, match="LIF file"):
        IMPORTERS[".lif"](LIF / "none.lif", ImportOptions())


# The official format


def schema_errors(document: object) -> list[str]:
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed: make setup")
    schema = json.loads((LIF / "LIF.schema").read_text())
    return [f"{error.json_path}: {error.message}" for error in jsonschema.Draft7Validator(schema).iter_errors(document)]


@needs_format
def test_export_conforms_to_the_official_schema(site: Site) -> None:
    assert schema_errors(works()) == [
        "$.layouts[0].stations[0].stationHeight: '0.6' is not of type 'number'",
        "$.layouts[1]: 'stations' is a required property",
    ], "the reader takes more than the schema, as the text of the format and its examples do"
    assert schema_errors(json.loads(export_layouts(site.ontology, site.map, exported_at=NOW))) == []


@needs_format
@given(tracks())
def test_export_of_any_map_conforms_to_the_official_schema(drawn: Map) -> None:
    assert schema_errors(json.loads(export_layouts(upper(), drawn, exported_at=NOW))) == []


@needs_format
def test_the_examples_of_the_format_are_imported() -> None:
    """All examples in the text of the format, but the first one, which shows the data types in place of values."""
    template, *examples = re.findall(r"```json\n(.*?)```", (LIF / "LIF.md").read_text(), re.DOTALL)
    assert len(examples) == 18
    for example in examples:
        site = imported(json.loads(example))
        written = export_layouts(site.ontology, site.map, exported_at=NOW)
        assert lanes(import_bytes(written).map) == lanes(site.map)
        assert schema_errors(json.loads(written)) == []
    with pytest.raises(ModelError, match="float"):
        import_bytes(template.encode())
