"""Zones of the site become zone sets, and vehicles get what traffic has granted when they ask for zones."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import BuildingChanged, Follow, GaveUp, Refused
from somrs.adapters.vda5050.frames import Frame
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Topic, Version, seconds_of
from somrs.adapters.vda5050.messages.orders import (
    ActionParameter,
    BlockingType,
    ControlPoint,
    GrantType,
    Responses,
    Trajectory,
    ZoneAction,
    ZoneSet,
    ZoneType,
)
from somrs.adapters.vda5050.messages.states import ActionStatus, MapStatus, RequestStatus, ZoneRequest
from somrs.adapters.vda5050.shapes import comes_near, counterclockwise, curve_points, distance, overlap
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.simulated.zones import SUPPORTED, PendingRequest
from somrs.adapters.vda5050.zoning.sets import zone_set
from somrs.adapters.vda5050.zoning.site import SiteZone, ZoneActions, ZoneCatalogue, site_zones
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Value
from tests.support.vda5050_messages import HEADER, check_schema
from tests.support.vda5050_pair import Pair, way


def square(x: float, y: float, half: float = 0.5) -> tuple[tuple[float, float], ...]:
    return ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))


def zone(zone_type: ZoneType, x: float, name: str = "Zone1", **fields: Any) -> SiteZone:
    return SiteZone(name=name, zone_type=zone_type, outline=square(x, fields.pop("y", 0.0)), level=0.0, **fields)


def zoned(*zones: SiteZone, **options: Any) -> Pair:
    """A vehicle with zones, after it has got them."""
    pair = Pair(Version.V3_0, **options)
    pair.do(BuildingChanged(zones=zones))
    pair.run(2)
    return pair


def stored(pair: Pair) -> list[MapStatus]:
    return [item.zone_set_status for item in pair.vehicle.state().zone_sets or ()]


def answers(pair: Pair) -> list[GrantType]:
    return [response.grant_type for _, message in pair.commands if isinstance(message, Responses) for response in message.responses]


# Zone sets are sent, enabled, and deleted.


def test_zones_are_sent_enabled_and_replaced() -> None:
    pair = zoned(zone(ZoneType.BLOCKED, 3.0, y=5.0))
    assert stored(pair) == [MapStatus.ENABLED]
    first = pair.vehicle.state().zone_sets
    pair.do(BuildingChanged(zones=(zone(ZoneType.BLOCKED, 4.0, y=5.0),)))
    pair.run(5)
    assert stored(pair) == [MapStatus.ENABLED], "the earlier one is deleted"
    assert pair.vehicle.state().zone_sets != first
    assert pair.instant_actions().count("deleteZoneSet") == 1
    pair.forget()
    pair.run(200)
    assert pair.commands == [], "nothing is said again"


def test_zones_that_are_all_gone_are_taken_away_from_the_vehicle() -> None:
    pair = zoned(zone(ZoneType.BLOCKED, 3.0, y=5.0))
    pair.do(BuildingChanged(zones=()))
    pair.run(5)
    assert stored(pair) == [MapStatus.ENABLED]
    (content,) = pair.vehicle.storage.contents.values()
    assert content.zones == ()


@pytest.mark.parametrize("sheet", [factsheet(supported_zones=()), factsheet(supported_zones=("PENALTY",))])
def test_a_vehicle_without_zones_of_these_types_gets_none(sheet: Any) -> None:
    pair = zoned(zone(ZoneType.BLOCKED, 3.0), sheet=sheet)
    assert [message for _, message in pair.commands if isinstance(message, ZoneSet)] == []


def test_zone_sets_are_for_vehicles_with_3_0() -> None:
    pair = Pair(Version.V2_1)
    pair.do(BuildingChanged(zones=(zone(ZoneType.BLOCKED, 3.0),)))
    pair.run(20)
    assert [message for _, message in pair.commands if isinstance(message, ZoneSet)] == []


def test_a_zone_set_that_is_lost_is_sent_again() -> None:
    lost = iter([0, 0])
    pair = Pair(Version.V3_0, lambda topic: next(lost, 1) if topic is Topic.ZONE_SET else 1)
    pair.do(BuildingChanged(zones=(zone(ZoneType.BLOCKED, 3.0, y=5.0),)))
    pair.run(10)
    assert stored(pair) == [MapStatus.ENABLED]


def test_a_vehicle_that_takes_no_zone_set_is_named_once() -> None:
    pair = Pair(Version.V3_0, lambda topic: 0 if topic is Topic.ZONE_SET else 1)
    pair.do(BuildingChanged(zones=(zone(ZoneType.BLOCKED, 3.0),)))
    pair.run(200)
    (refused,) = pair.of(Refused)
    assert isinstance(refused, Refused)
    assert "does not show that it has the zone set somrs-hall-" in refused.description
    assert len(pair.commands) < 20


def horn(status: str) -> ZoneAction:
    return ZoneAction(action_type="horn", blocking_type=BlockingType.NONE, action_parameters=(ActionParameter(key="status", value=status),))


def test_a_vehicle_does_in_a_zone_what_it_has_for_that() -> None:
    lamp = ZoneAction(action_type="lamp", blocking_type=BlockingType.SINGLE)
    actions = ZoneActions(entry=(horn("on"), lamp), exit=(horn("off"),))
    pair = zoned(zone(ZoneType.ACTION, 3.0, actions=actions), sheet=factsheet(zone_actions=("horn",)))
    assert pair.of(Refused) == [Refused(description="does not have lamp in Zone1")]
    pair.follow("A", "B", "C", "D")
    pair.run(10)
    performed = pair.vehicle.state().zone_action_states or ()
    assert [(state.action_type, state.action_status) for state in performed] == [("horn", ActionStatus.FINISHED)] * 2
    pair.follow(*"DBDBDBDBD", first=3)
    pair.run(60)
    assert "clearZoneActions" in pair.instant_actions()
    assert len(pair.vehicle.state().zone_action_states or ()) < 20


def test_a_vehicle_that_has_none_of_the_actions_gets_no_action_zone() -> None:
    pair = zoned(zone(ZoneType.ACTION, 3.0, actions=ZoneActions(during=(horn("on"),))))
    assert pair.orders() == []
    assert [message for _, message in pair.commands if isinstance(message, ZoneSet)] == []


# A vehicle asks for zones.


def test_a_release_zone_on_the_granted_way_is_granted_and_left() -> None:
    pair = zoned(zone(ZoneType.RELEASE, 3.0))
    pair.follow("A", "B", "C", "D")
    pair.run(2)
    (request,) = pair.vehicle.state().zone_requests or ()
    assert (request.request_type, request.request_status) == ("ACCESS", RequestStatus.GRANTED)
    pair.run(10)
    assert pair.body.x == 6.0
    assert pair.vehicle.state().zone_requests == ()
    assert answers(pair) == [GrantType.GRANTED]
    assert pair.of(Refused) == []


def test_a_release_zone_that_is_only_planned_is_waited_for() -> None:
    pair = zoned(zone(ZoneType.RELEASE, 5.0))
    pair.follow("A", "B", "C", "D", released=2)
    pair.run(5)
    assert pair.body.x == 2.0
    pair.follow("A", "B", "C", "D")
    pair.run(10)
    assert pair.body.x == 6.0


def test_a_lease_is_renewed_while_the_vehicle_needs_it() -> None:
    pair = zoned(zone(ZoneType.RELEASE, 2.0))
    pair.follow("A", "B")
    pair.run(120)
    (request,) = pair.vehicle.state().zone_requests or ()
    assert request.request_status is RequestStatus.GRANTED, "it stands in the zone"
    assert answers(pair).count(GrantType.GRANTED) in range(7, 10), "every 15 seconds"


def test_a_vehicle_without_fleet_control_does_not_enter_when_its_lease_is_over() -> None:
    pair = zoned(zone(ZoneType.RELEASE, 35.0))
    start, end = way("A", "B")
    pair.do(Follow(way=(start, msgspec.structs.replace(end, x=40.0))))
    pair.run(3)
    pair.is_cut = True
    pair.run(40)
    assert 28.0 < pair.body.x < 33.0
    pair.is_cut = False
    pair.run(15)
    assert pair.body.x == 40.0, "it has asked again"


def test_a_lease_is_by_the_clock_of_the_vehicle() -> None:
    pair = Pair(Version.V3_0, clock_lead=-7200.0)
    pair.do(BuildingChanged(zones=(zone(ZoneType.RELEASE, 3.0),)))
    pair.run(2)
    pair.follow("A", "B", "C", "D")
    pair.run(1)
    (response,) = next(message for _, message in pair.commands if isinstance(message, Responses)).responses
    assert response.lease_expiry is not None
    assert abs((seconds_of(response.lease_expiry) or 0.0) - (pair.now - 7200.0) - 30.0) < 2.0


def test_what_is_no_longer_on_the_way_is_revoked() -> None:
    pair = zoned(zone(ZoneType.RELEASE, 5.0))
    pair.follow("A", "B", "C", "D")
    pair.run(0.5)
    assert answers(pair) == [GrantType.GRANTED]
    pair.halt()
    pair.run(5)
    assert pair.vehicle.state().zone_requests == ()


def test_a_granted_path_through_a_zone_for_replanning_is_driven() -> None:
    sheet = factsheet(finds_paths=True)
    pair = zoned(zone(ZoneType.LINE_GUIDED, 3.0), sheet=sheet)
    (content,) = pair.vehicle.storage.contents.values()
    assert [item.zone_type for item in content.zones] == ["COORDINATED_REPLANNING"], "it takes no trajectories"
    pair.follow("A", "B", "C", "D", released=3)
    pair.run(1)
    pair.follow("A", "B", "C", "D")
    pair.run(12)
    assert pair.body.x == 6.0
    assert set(answers(pair)) == {GrantType.GRANTED}
    assert pair.of(GaveUp, Refused) == []


def test_a_path_is_not_revoked_for_what_is_behind_the_vehicle() -> None:
    floor = SiteZone(name="Floor1", zone_type=ZoneType.LINE_GUIDED, outline=square(0.0, 0.0, 50.0), level=0.0)
    pair, names = zoned(floor, sheet=factsheet(finds_paths=True)), ("A", "B", "C", "D", "E")
    pair.follow(*names, released=4)
    for _ in range(40):
        pair.run(0.3)
        passed = max(pair.passed(), default=0)
        pair.follow(*names[passed:], first=passed, released=min(4, 5 - passed))
    assert pair.body.x == 8.0
    assert set(answers(pair)) == {GrantType.GRANTED}
    assert pair.vehicle.state().zone_requests == ()


def test_a_vehicle_that_finds_paths_follows_the_lines_that_it_is_given_if_it_can() -> None:
    pair = zoned(zone(ZoneType.LINE_GUIDED, 3.0), sheet=factsheet(finds_paths=True, takes_trajectories=True))
    (content,) = pair.vehicle.storage.contents.values()
    assert [item.zone_type for item in content.zones] == ["LINE_GUIDED"]
    pair.follow("A", "B", "C", "D")
    pair.run(12)
    assert pair.body.x == 6.0


def test_a_path_that_leaves_the_granted_way_is_refused_once() -> None:
    pair = zoned(zone(ZoneType.LINE_GUIDED, 3.0), sheet=factsheet(finds_paths=True))
    (set_id,) = pair.vehicle.storage.contents
    detour = tuple(ControlPoint(x=x, y=y) for x, y in ((0.0, 0.0), (3.0, 2.0), (6.0, 0.0)))
    for number in (1, 2):
        request = ZoneRequest(
            request_id=f"r{number}",
            request_type="REPLANNING",
            zone_id="Zone1",
            zone_set_id=set_id,
            request_status=RequestStatus.REQUESTED,
            trajectory=Trajectory(degree=2, knot_vector=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0), control_points=detour),
        )
        pair.follow("A", "B", "C", "D")
        pair.vehicle.zones.pending = [PendingRequest(request=request, covers=frozenset({2, 4, 6, 8}))]
        pair.run(0.3)
    assert set(answers(pair)) == {GrantType.REJECTED}
    assert [effect.description for effect in pair.effects if isinstance(effect, Refused)] == [
        f"asks for a path through the zone Zone1 of {set_id} that leaves its way"
    ]


def test_a_slow_zone_is_driven_slowly_and_a_blocked_one_not_at_all() -> None:
    pair = zoned(zone(ZoneType.SPEED_LIMIT, 3.0, maximum_speed=0.2))
    pair.follow("A", "B", "C")
    pair.run(10)
    assert pair.body.x < 3.0
    pair = zoned(zone(ZoneType.BLOCKED, 3.0))
    pair.follow("A", "B", "C")
    pair.run(10)
    assert 1.5 < pair.body.x <= 2.0
    (gave_up,) = pair.of(GaveUp)
    assert gave_up == GaveUp(description="NODE_UNREACHABLE: the zone Zone1 is blocked")


# Zones of the site.


def test_areas_of_the_map_are_action_zones_where_the_settings_say_so() -> None:
    area: dict[str, Value] = {
        "PositionX": 3.0,
        "PositionY": 1.0,
        "PositionZ": 4.0,
        "Shape.Form": "Box",
        "Shape.Width": 2.0,
        "Shape.Depth": 1.0,
    }
    actions = ZoneActions(entry=(horn("on"),))
    map = Map([Object(name=name, type="Zone", values=area) for name in ("Crossing", "Yard")], [])
    (made,) = site_zones(map, upper(), {"Crossing": actions, "Nowhere": actions})
    assert (made.name, made.zone_type, made.level, made.actions) == ("Crossing", ZoneType.ACTION, 4.0, actions)
    assert set(made.outline) == {(2.0, 0.5), (4.0, 0.5), (4.0, 1.5), (2.0, 1.5)}


def site(*objects: Object, facts: tuple[Fact, ...] = ()) -> tuple[SiteZone, ...]:
    return site_zones(Map(list(objects), list(facts)), upper())


def box(name: str, type: str, x: float, y: float, **values: Value) -> Object:
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 2.0, "Shape.Depth": 1.0, "Shape.Height": 0.1}
    return Object(name=name, type=type, values={"PositionX": x, "PositionY": y, "PositionZ": 0.0, **shape, **values})


def waypoint(name: str, x: float, y: float) -> Object:
    return Object(name=name, type="Waypoint", values={"PositionX": x, "PositionY": y})


def test_zones_of_the_map_and_floors() -> None:
    zones = site(
        box("Z1", "NoGoZone", 5.0, 3.0), box("Z2", "SlowZone", 1.0, 1.0, SpeedLimit=0.3), box("F1", "Floor", 0.0, 0.0, PositionZ=-0.1)
    )
    assert [(item.name, item.zone_type, item.maximum_speed, round(item.level, 6)) for item in zones] == [
        ("Z1", ZoneType.BLOCKED, None, 0.0),
        ("Z2", ZoneType.SPEED_LIMIT, 0.3, 0.0),
        ("F1", ZoneType.LINE_GUIDED, None, 0.0),
    ]
    assert set(zones[0].outline) == {(4.0, 2.5), (6.0, 2.5), (6.0, 3.5), (4.0, 3.5)}


def test_one_way_lanes_that_meet_no_other_are_directed_zones() -> None:
    names = ("A", "B", "C", "D", "E")
    points = [waypoint(name, x, y) for name, (x, y) in zip(names, ((0, 0), (10, 0), (10, 5), (5, -3), (5, 3)), strict=True)]
    lanes = [Object(name=f"L{number}", type="Lane", values={}) for number in (1, 2)]
    lanes.append(Object(name="L3", type="Lane", values={"Bidirectional": True}))
    ends = (("L1", "A", "B"), ("L2", "B", "C"), ("L3", "D", "E"))
    facts = tuple(fact for lane, start, end in ends for fact in (Fact("startsAt", (lane, start)), Fact("endsAt", (lane, end))))
    (only,) = site(*points, *lanes, facts=facts)
    assert (only.name, only.zone_type, only.direction) == ("L2", ZoneType.DIRECTED, math.pi / 2)
    assert min(y for _, y in only.outline) == 0.25


def test_a_catalogue_keeps_what_has_not_changed() -> None:
    catalogue, ontology = ZoneCatalogue(), upper()
    first = catalogue.zones(Map([box("Z1", "NoGoZone", 5.0, 3.0)]), ontology)
    assert catalogue.zones(Map([box("Z1", "NoGoZone", 5.0, 3.0), waypoint("A", 0.0, 0.0)]), ontology) is first
    assert catalogue.zones(Map([box("Z1", "NoGoZone", 6.0, 3.0)]), ontology) is not first


ZONES = st.lists(
    st.builds(
        SiteZone,
        name=st.text(max_size=8),
        zone_type=st.sampled_from([ZoneType(name) for name in SUPPORTED if name != "COORDINATED_REPLANNING"]),
        outline=st.builds(square, st.floats(-50, 50), st.floats(-50, 50)),
        level=st.sampled_from([0.0, 3.0]),
        maximum_speed=st.just(0.5),
        direction=st.floats(-math.pi, math.pi),
    ),
    max_size=5,
)


@given(zones=ZONES, finds_paths=st.booleans(), turned=st.floats(-3.0, 3.0))
def test_a_zone_set_is_valid_and_its_id_tells_its_content(zones: list[SiteZone], finds_paths: bool, turned: float) -> None:
    sheet, frame = factsheet(finds_paths=finds_paths), Frame(map_id="hall", x=1.0, yaw=turned, level=0.0)
    content = zone_set(frame, zones, sheet)
    check_schema(Topic.ZONE_SET, encode(ZoneSet(zone_set=content), HEADER, Version.V3_0), Version.V3_0)
    assert content == zone_set(frame, zones, sheet)
    other_content = zone_set(Frame(map_id="hall", x=2.0, yaw=turned, level=0.0), zones, sheet)
    assert (content.zones == other_content.zones) == (content.zone_set_id == other_content.zone_set_id)
    for item in content.zones:
        corners = [(vertex.x, vertex.y) for vertex in item.vertices]
        assert counterclockwise(corners) == tuple(corners)


# Shapes.


@given(
    points=st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=4, max_size=8),
    degree=st.integers(1, 3),
    weights=st.lists(st.floats(0.1, 5.0), min_size=8, max_size=8),
)
def test_a_curve_begins_and_ends_at_its_control_points_and_stays_between_them(
    points: list[tuple[float, float]], degree: int, weights: list[float]
) -> None:
    control = tuple(ControlPoint(x=x, y=y, weight=weight) for (x, y), weight in zip(points, weights, strict=False))
    curve = curve_points(Trajectory(degree=degree, control_points=control))
    assert curve[0] == pytest.approx(points[0], abs=1e-6)
    assert curve[-1] == pytest.approx(points[-1], abs=1e-6)
    for axis in (0, 1):
        values = [point[axis] for point in points]
        assert all(min(values) - 1e-6 <= point[axis] <= max(values) + 1e-6 for point in curve)
    if degree == 1:
        assert [pytest.approx(point, abs=1e-6) for point in curve] == points


@given(
    trajectory=st.builds(
        Trajectory,
        degree=st.none() | st.integers(0, 4),
        knot_vector=st.none() | st.lists(st.floats(0, 1) | st.just(math.nan), max_size=8).map(tuple),
        control_points=st.lists(
            st.builds(ControlPoint, x=st.floats(-1, 1), y=st.just(0.0), weight=st.none() | st.floats(-1, 2)), max_size=5
        ).map(tuple),
    )
)
def test_what_is_no_curve_is_refused(trajectory: Trajectory) -> None:
    try:
        points = curve_points(trajectory)
    except ValueError:
        return
    assert all(math.isfinite(value) for point in points for value in point)


def test_a_quarter_of_a_circle() -> None:
    control = (ControlPoint(x=1.0, y=0.0), ControlPoint(x=1.0, y=1.0, weight=math.sqrt(0.5)), ControlPoint(x=0.0, y=1.0))
    curve = curve_points(Trajectory(degree=2, control_points=control))
    assert all(math.hypot(*point) == pytest.approx(1.0) for point in curve)


def test_distances_and_overlaps() -> None:
    area = square(0.0, 0.0)
    assert distance(area, (0.2, 0.1)) == 0.0
    assert distance(area, (2.5, 0.0)) == 2.0
    assert comes_near([(-3.0, 0.9), (3.0, 0.9)], area, 0.4)
    assert not comes_near([(-3.0, 0.9), (3.0, 0.9)], area, 0.39)
    assert overlap(area, square(0.9, 0.0))
    assert not overlap(area, square(1.0, 0.0))
