"""Vehicles get the versions of their maps that the settings name, and are not sent to maps that they do not have."""

from __future__ import annotations

import msgspec
import pytest

from somrs.adapters.vda5050.control.exchange import Follow, GaveUp, Refused
from somrs.adapters.vda5050.control.policy import Policy
from somrs.adapters.vda5050.control.provision import MapPackage
from somrs.adapters.vda5050.frames import Frame, Frames
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.states import MapStatus
from somrs.adapters.vda5050.simulated.exchange import Misbehaves
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from tests.support.vda5050_pair import Pair, way

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])

HALL_2 = MapPackage(map_id="hall", version="2", link="https://maps/hall-2.zip", hash="9f86d0")


def maps(pair: Pair) -> list[tuple[str, str, MapStatus]]:
    return [(stored.map_id, stored.map_version, stored.map_status) for stored in pair.vehicle.state().maps or ()]


@VERSIONS
def test_a_newer_version_is_downloaded_enabled_and_takes_the_place_of_the_earlier_one(version: Version) -> None:
    pair = Pair(version, policy=Policy(packages=(HALL_2,)))
    pair.run(10)
    assert maps(pair) == [("hall", "2", MapStatus.ENABLED)]
    assert [pair.instant_actions().count(name) for name in ("downloadMap", "enableMap", "deleteMap")] == [1, 1, 1]
    pair.forget()
    pair.run(200)
    assert pair.commands == []


@VERSIONS
def test_a_map_is_enabled_when_the_vehicle_has_no_order(version: Version) -> None:
    pair = Pair(version, policy=Policy(packages=(HALL_2,)))
    pair.follow("A", "B", "C", "D")
    pair.run(4)
    assert maps(pair) == [("hall", "1", MapStatus.ENABLED), ("hall", "2", MapStatus.DISABLED)]
    pair.run(10)
    assert maps(pair) == [("hall", "2", MapStatus.ENABLED)]
    assert pair.body.x == 6.0


@VERSIONS
def test_a_download_that_fails_is_tried_again_later_and_told_once(version: Version) -> None:
    pair = Pair(version, policy=Policy(packages=(HALL_2,)))
    pair.tell(Misbehaves(cannot_download=True))
    pair.run(200)
    assert 2 < pair.instant_actions().count("downloadMap") < 6
    (refused,) = pair.of(Refused)
    assert refused == Refused(description="downloadMap hall 2 https://maps/hall-2.zip 9f86d0 failed: the vehicle does not say why")
    pair.tell(Misbehaves())
    pair.run(120)
    assert maps(pair) == [("hall", "2", MapStatus.ENABLED)]


def test_a_map_that_nobody_can_send_is_asked_for_once() -> None:
    pair = Pair(Version.V3_0, policy=Policy(packages=(MapPackage(map_id="hall", version="2"),)))
    pair.run(100)
    (refused,) = pair.of(Refused)
    assert isinstance(refused, Refused)
    assert refused.description.startswith("does not have version 2 of its map hall: bring it, or give its `link`")


def test_a_vehicle_that_cannot_download_maps_is_named() -> None:
    sheet = factsheet()
    features = sheet.protocol_features
    actions = tuple(action for action in features.mobile_robot_actions if action.action_type != "downloadMap")
    sheet = msgspec.structs.replace(sheet, protocol_features=msgspec.structs.replace(features, mobile_robot_actions=actions))
    pair = Pair(Version.V3_0, policy=Policy(packages=(HALL_2,)), sheet=sheet)
    pair.run(10)
    (refused,) = pair.of(Refused)
    assert isinstance(refused, Refused)
    assert refused.description.startswith("has no downloadMap")


@VERSIONS
def test_a_way_to_a_map_that_the_vehicle_does_not_have_is_given_up(version: Version) -> None:
    pair = Pair(version)
    pair.control.vehicle.frames = Frames([Frame(map_id="hall", level=0.0), Frame(map_id="attic", level=4.0)])
    pair.control._driving._vehicle.frames = pair.control.vehicle.frames
    start, end = way("A", "B")
    pair.do(Follow(way=(start, msgspec.structs.replace(end, level=4.0))))
    pair.run(5)
    assert pair.of(GaveUp) == [GaveUp(description="it has no map attic that is enabled")]
    assert pair.orders() == []
    pair.follow("A", "B")
    pair.run(5)
    assert pair.body.x == 2.0
