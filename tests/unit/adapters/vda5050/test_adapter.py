"""The adapter finds vehicles by what they say, and gives each a name of its own."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import pytest

from somrs.adapters.vda5050.adapter import FACTSHEET_TICKS, Vda5050Adapter
from somrs.adapters.vda5050.messages.encoding import encode
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from tests.support.vda5050_fleet import NotedFleet
from tests.support.vda5050_messages import HEADER
from tests.unit.adapters.vda5050.test_messages import MINIMAL

POSITION = {"x": 1.0, "y": 2.0, "theta": 0.0, "positionInitialized": True}


class Site:
    """An adapter without a broker, and its fleet."""

    def __init__(self, **settings: Any) -> None:
        self.adapter = Vda5050Adapter({"broker": "mqtt://broker", **settings}, Path())
        self.fleet = NotedFleet()

    def hear(self, identity: str, *, describes: bool = True, version: str = "v2", map_id: str = "hall") -> None:
        """The state of a vehicle arrives, and its factsheet. `identity`: manufacturer and serial number, with a slash between them."""
        if describes:
            spoken = Version.V3_0 if version == "v3" else Version.V2_1
            self.adapter._receive(f"uagv/{version}/{identity}/factsheet", encode(factsheet(), HEADER, spoken))
        state = MINIMAL | {"agvPosition": POSITION | {"mapId": map_id}}
        self.adapter._receive(f"uagv/{version}/{identity}/state", json.dumps(state).encode())

    def wait(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            for session in self.adapter.sessions.values():
                self.adapter._add_when_known(self.fleet, session)


def test_a_vehicle_has_a_device_when_it_has_said_where_it_is_and_what_it_can() -> None:
    site = Site()
    site.adapter._receive("uagv/v2/acme/1/factsheet", encode(factsheet(), HEADER, Version.V2_1))
    site.wait()
    assert site.fleet.devices == {}
    site.hear("acme/1")
    site.wait()
    assert list(site.fleet.devices) == ["Acme1"]
    assert site.fleet.devices["Acme1"].values["PositionX"] == 1.0


def test_a_vehicle_without_a_factsheet_only_drives_unless_the_settings_say_more(caplog: pytest.LogCaptureFixture) -> None:
    named = {"manufacturer": "acme", "serialNumber": "2", "actions": ["pick", "drop"]}
    site = Site(vehicles={"Forklift": named})
    site.hear("acme/1", describes=False)
    site.hear("acme/2", describes=False)
    site.wait()
    assert list(site.fleet.devices) == ["Forklift"]
    assert set(site.fleet.devices["Forklift"].services()) == {"move_to", "transfer"}
    site.wait(FACTSHEET_TICKS)
    assert set(site.fleet.devices["Acme1"].services()) == {"move_to"}
    assert "acme 1: has sent no factsheet" in caplog.text


def test_a_vehicle_that_would_have_the_name_of_another_one_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    site = Site()
    site.hear("acme/11")
    site.wait()
    site.hear("acme1/1")
    site.wait(2)
    assert list(site.fleet.devices) == ["Acme11"]
    assert caplog.text.count("acme1 1 would be Acme11, as acme 11 is") == 1


def test_a_vehicle_that_speaks_a_newer_version_takes_its_own_place() -> None:
    site = Site()
    site.hear("acme/1")
    site.wait()
    earlier = site.fleet.devices["Acme1"]
    site.hear("acme/1", version="v3")
    site.wait()
    assert site.fleet.devices["Acme1"] is not earlier


def test_a_message_that_cannot_be_read_is_told_once_and_changes_nothing(caplog: pytest.LogCaptureFixture) -> None:
    site = Site()
    site.hear("acme/1")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            site.adapter._receive("uagv/v2/acme/1/state", b"{")
    assert caplog.text.count("a message cannot be read") == 1
    site.wait()
    assert list(site.fleet.devices) == ["Acme1"]


def test_other_topics_and_vehicles_are_ignored() -> None:
    site = Site(namedOnly=True)
    site.hear("acme/1")
    site.adapter._receive("uagv/v2/acme/1/telemetry", b"{}")
    site.adapter._receive("weather", b"{}")
    assert site.adapter.sessions == {}


def test_in_a_building_with_several_storeys_each_is_a_map_and_others_are_refused_before_they_drive(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Seen: a vehicle whose map was none of the site's was placed on the ground, also when it had ridden a lift, and drove there."""
    site = Site()
    site.fleet.heights = {"L1": 0.0, "L2": 8.0}
    site.adapter._frames = site.adapter._settings.frames(site.fleet.heights)
    site.hear("acme/1")
    site.hear("acme/2", map_id="L2")
    site.wait(3)
    assert list(site.fleet.devices) == ["Acme2"]
    assert site.fleet.devices["Acme2"].values["PositionZ"] == 8.0
    assert "is on the map hall, and the site has only L1, L2: give its `level` under `maps` in the settings" in caplog.text


def test_what_a_vehicle_warns_of_and_why_it_cannot_drive_is_in_the_log_once(caplog: pytest.LogCaptureFixture) -> None:
    site = Site(maps={"hall": {"level": 0}})
    worn = {"errorType": "brushWorn", "errorLevel": "WARNING", "errorDescription": "change it"}
    elsewhere = {"agvPosition": POSITION | {"mapId": "cellar"}}
    for number in range(5):
        said = MINIMAL | elsewhere | {"errors": [worn], "headerId": number, "timestamp": f"2026-11-29T10:00:0{number}.000Z"}
        site.adapter._receive("uagv/v2/acme/1/state", json.dumps(said).encode())
        site.adapter._receive("uagv/v2/acme/1/state", (" " * number + '{"headerId": NaN}').encode())
    assert caplog.text.count("acme 1: brushWorn: change it") == 1
    assert caplog.text.count("acme 1: cannot drive: is on the map cellar, and the site has only hall") == 1
    assert caplog.text.count("acme 1: a message cannot be read") == 1
    site.wait()
    assert site.fleet.devices == {}


def test_people_are_told_why_a_vehicle_of_the_settings_is_not_there() -> None:
    site = Site(vehicles={"Forklift": {"manufacturer": "acme", "serialNumber": "2"}}, maps={"hall": {}})

    def problem() -> str | None:
        site.adapter._report_absences(site.fleet)
        return site.fleet.problems.get("Forklift")

    assert problem() == "cannot be reached: its broker is not there"
    site.adapter._notice_broker(is_connected=True)
    assert problem() == "cannot be reached: its broker is there, and nothing has come of acme 2"
    site.hear("acme/2", map_id="cellar")
    assert "is on the map cellar, and the site has only hall" in (problem() or "")
    site.hear("acme/2")
    site.wait()
    del site.fleet.problems["Forklift"]
    assert problem() is None, "its device says it now"
