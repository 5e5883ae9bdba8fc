"""The simulated vehicle heeds zones and stores maps as the text of 3.0 says, and refuses what it does not have."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import BuildingChanged
from somrs.adapters.vda5050.messages.header import Topic, Version, timestamp_of
from somrs.adapters.vda5050.messages.orders import GrantType, Response, Responses, Vertex, Zone, ZoneSetContent, ZoneType
from somrs.adapters.vda5050.messages.states import ActionStatus, ErrorLevel, MapStatus, OperatingMode, RequestStatus
from somrs.adapters.vda5050.shapes import distance
from somrs.adapters.vda5050.simulated.exchange import Responded, Switched, Zoned
from somrs.adapters.vda5050.zoning.site import SiteZone
from tests.support.vda5050_pair import Pair
from tests.unit.adapters.vda5050.test_simulated_vehicle import Alone, order


def square(x: float, half: float = 0.4) -> tuple[Vertex, ...]:
    return tuple(Vertex(x=x + dx, y=dy) for dx, dy in ((-half, -half), (half, -half), (half, half), (-half, half)))


def zone(zone_type: ZoneType, x: float, zone_id: str = "z", **fields: Any) -> Zone:
    return Zone(zone_id=zone_id, zone_type=zone_type, vertices=square(x), **fields)


def content(*zones: Zone, zone_set_id: str = "s") -> ZoneSetContent:
    return ZoneSetContent(map_id="hall", zone_set_id=zone_set_id, zones=zones)


def alone(*zones: Zone) -> Alone:
    """A vehicle with these zones enabled."""
    vehicle = Alone(Version.V3_0)
    vehicle.tell(Zoned(content=content(*zones)))
    vehicle.act("enableZoneSet", "enable", zoneSetId="s")
    vehicle.run(0.1)
    return vehicle


def answer(vehicle: Alone, grant_type: GrantType, lease: float | None = None) -> None:
    (request,) = vehicle.state.zone_requests or ()
    expiry = timestamp_of(vehicle.now + lease) if lease is not None else None
    response = Response(request_id=request.request_id, grant_type=grant_type, lease_expiry=expiry)
    vehicle.tell(Responded(responses=Responses(responses=(response,))))


def statuses(vehicle: Alone) -> list[RequestStatus]:
    return [request.request_status for request in vehicle.state.zone_requests or ()]


# What it stores.


def test_a_zone_set_is_stored_disabled_enabled_and_deleted() -> None:
    vehicle = Alone(Version.V3_0)
    vehicle.tell(Zoned(content=content()))
    vehicle.tell(Zoned(content=content(zone_set_id="t")))
    assert [item.zone_set_status for item in vehicle.state.zone_sets or ()] == [MapStatus.DISABLED, MapStatus.DISABLED]
    vehicle.act("enableZoneSet", "1", zoneSetId="s")
    vehicle.act("enableZoneSet", "2", zoneSetId="t")
    assert [item.zone_set_status for item in vehicle.state.zone_sets or ()] == [MapStatus.DISABLED, MapStatus.ENABLED]
    vehicle.act("deleteZoneSet", "3", zoneSetId="t")
    vehicle.act("deleteZoneSet", "4", zoneSetId="s")
    vehicle.act("enableZoneSet", "5", zoneSetId="s")
    failed = [vehicle.status(action_id) for action_id in ("3", "4", "5")]
    assert failed == [ActionStatus.FAILED, ActionStatus.FINISHED, ActionStatus.FAILED], "one that is in use is not deleted"


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        (content(), "DUPLICATE_ZONE_SET"),
        (content(zone(ZoneType.PENALTY, 0.0), zone_set_id="t"), "VALIDATION_FAILURE"),
        (content(Zone(zone_id="z", zone_type=ZoneType.BLOCKED, vertices=square(0.0)[:2]), zone_set_id="t"), "VALIDATION_FAILURE"),
        (content(zone(ZoneType.BLOCKED, 5.0), zone(ZoneType.BLOCKED, 9.0), zone_set_id="t"), "VALIDATION_FAILURE"),
    ],
)
def test_a_zone_set_that_is_wrong_is_not_stored(wrong: ZoneSetContent, error: str) -> None:
    vehicle = alone()
    vehicle.tell(Zoned(content=wrong))
    assert vehicle.errors == [(error, ErrorLevel.WARNING)]
    assert len(vehicle.state.zone_sets or ()) == 1


def test_a_map_that_is_there_is_not_downloaded_again() -> None:
    vehicle = Alone(Version.V3_0)
    vehicle.act("downloadMap", "1", mapId="hall", mapVersion="1", mapDownloadLink="https://maps/hall")
    assert vehicle.status("1") is ActionStatus.FAILED
    assert vehicle.errors == [("DUPLICATE_MAP", ErrorLevel.WARNING)]
    vehicle.act("downloadMap", "2", mapId="hall", mapVersion="2", mapDownloadLink="https://maps/hall")
    assert vehicle.status("2") is ActionStatus.RUNNING
    assert len(vehicle.state.maps or ()) == 1, "a map is listed when it is ready to be enabled"
    vehicle.run(3)
    assert vehicle.status("2") is ActionStatus.FINISHED
    vehicle.act("deleteMap", "3", mapId="hall", mapVersion="1")
    assert vehicle.status("3") is ActionStatus.FAILED, "it is in use"


def test_nothing_is_done_at_an_instant_action_while_somebody_drives_by_hand() -> None:
    vehicle = Alone(Version.V3_0)
    vehicle.tell(Switched(mode=OperatingMode.MANUAL))
    vehicle.act("startPause", "1")
    assert vehicle.status("1") is ActionStatus.FAILED
    assert not vehicle.state.paused
    vehicle.tell(Switched(mode=OperatingMode.INTERVENED))
    vehicle.act("startPause", "2")
    assert vehicle.status("2") is ActionStatus.FAILED


# What it heeds.


def test_it_waits_before_a_release_zone_until_it_is_granted() -> None:
    vehicle = alone(zone(ZoneType.RELEASE, 2.0, release_loss_behavior="STOP"))
    vehicle.order(order("ABCD"))
    vehicle.run(5)
    assert vehicle.body.x == 1.0
    assert statuses(vehicle) == [RequestStatus.REQUESTED]
    answer(vehicle, GrantType.QUEUED)
    vehicle.run(2)
    assert vehicle.body.x == 1.0
    answer(vehicle, GrantType.GRANTED)
    vehicle.run(5)
    assert vehicle.body.x == 3.0
    assert statuses(vehicle) == [], "it has left the zone"


def test_it_asks_only_once_for_what_is_refused() -> None:
    vehicle = alone(zone(ZoneType.RELEASE, 2.0, release_loss_behavior="STOP"))
    vehicle.order(order("ABCD"))
    vehicle.run(3)
    answer(vehicle, GrantType.REJECTED)
    vehicle.run(3)
    assert statuses(vehicle) == []
    assert vehicle.body.x == 1.0


@pytest.mark.parametrize(("behaviour", "errors", "x"), [("STOP", [("RELEASE_LOST", ErrorLevel.CRITICAL)], 2.0), ("CONTINUE", [], 3.0)])
def test_a_lease_that_is_over_in_the_zone(behaviour: str, errors: list[object], x: float) -> None:
    vehicle = alone(zone(ZoneType.RELEASE, 2.0, release_loss_behavior=behaviour))
    vehicle.order(order("ABC"))
    vehicle.run(3)
    answer(vehicle, GrantType.GRANTED, lease=5.0)
    vehicle.run(8)
    assert statuses(vehicle) == [RequestStatus.EXPIRED]
    assert vehicle.errors == errors
    vehicle.order(order("CD", update=1, first=4))
    vehicle.run(5)
    assert vehicle.body.x == x


def test_what_is_revoked_in_the_zone_stops_it() -> None:
    vehicle = alone(zone(ZoneType.RELEASE, 2.0, release_loss_behavior="STOP"))
    vehicle.order(order("ABC"))
    vehicle.run(3)
    answer(vehicle, GrantType.GRANTED)
    vehicle.run(4)
    assert vehicle.body.x == 2.0
    answer(vehicle, GrantType.REVOKED)
    vehicle.run(0.1)
    assert statuses(vehicle) == [RequestStatus.REVOKED]
    assert vehicle.errors == [("RELEASE_LOST", ErrorLevel.CRITICAL)]


def test_its_requests_end_with_its_order() -> None:
    vehicle = alone(zone(ZoneType.RELEASE, 2.0, release_loss_behavior="STOP"))
    vehicle.order(order("ABCD"))
    vehicle.run(1)
    vehicle.act("cancelOrder", "cancel")
    assert statuses(vehicle) == []


def test_a_vehicle_in_a_blocked_zone_says_so_and_stands() -> None:
    vehicle = Alone(Version.V3_0)
    vehicle.order(order("AB"))
    vehicle.run(0.3)
    vehicle.tell(Zoned(content=content(zone(ZoneType.BLOCKED, 0.0))))
    vehicle.act("enableZoneSet", "enable", zoneSetId="s")
    vehicle.run(2)
    assert ("BLOCKED_ZONE_VIOLATION", ErrorLevel.CRITICAL) in vehicle.errors
    assert vehicle.body.x < 0.6


@pytest.mark.parametrize(
    ("blocking", "words"),
    [
        (zone(ZoneType.BLOCKED, 1.5), "is blocked"),
        (zone(ZoneType.LINE_GUIDED, 1.5), "has none"),
        (zone(ZoneType.DIRECTED, 1.5, direction=3.14, directed_limitation="RESTRICTED"), "in the other direction"),
    ],
)
def test_a_node_behind_what_it_may_not_cross_is_unreachable(blocking: Zone, words: str) -> None:
    vehicle = alone(blocking)
    vehicle.order(order("ABC"))
    vehicle.run(5)
    assert vehicle.body.x <= 1.0
    assert vehicle.errors == [("NODE_UNREACHABLE", ErrorLevel.CRITICAL)]
    assert words in (vehicle.state.errors[0].error_description or "")


# Fleet control and vehicle together.


@given(seed=st.integers(0, 10_000))
@settings(max_examples=5)
def test_a_zone_is_entered_only_with_what_traffic_has_granted(seed: int) -> None:
    dice = random.Random(seed)
    pair = Pair(Version.V3_0, lambda topic: dice.choice([0, 1, 1, 2]) if topic in (Topic.RESPONSES, Topic.STATE, Topic.ORDER) else 1)
    outline = tuple((vertex.x, vertex.y) for vertex in square(5.0))
    pair.do(BuildingChanged(zones=(SiteZone(name="Z", zone_type=ZoneType.RELEASE, outline=outline, level=0.0),)))
    pair.run(5)
    names = ("A", "B", "C", "D", "E")
    for released in (2, 3, 4, 5):
        pair.follow(*names, released=released)
        for _ in range(round(20 * dice.random())):
            pair.run(0.2)
            if distance(outline, (pair.body.x, pair.body.y)) <= pair.vehicle.zones.contour:
                assert released > 3, "the zone is behind C, which is the third"
                granted = [request.request_status for request in pair.vehicle.zones.requests]
                assert granted == [RequestStatus.GRANTED]
    for _ in range(90):
        pair.run(1 if pair.body.x < 8.0 else 0)
    assert pair.body.x == 8.0
