"""The settings of the adapter say what is wrong with them, and where."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from somrs.adapters.vda5050.adapter import Vda5050Adapter
from somrs.adapters.vda5050.messages.header import Topic
from somrs.adapters.vda5050.messages.orders import ActionParameter
from somrs.adapters.vda5050.mqtt import Certificates, broker_address
from somrs.adapters.vda5050.settings import made_name, read_settings
from somrs.adapters.vda5050.topics import VehicleAddress, read_topic
from somrs.errors import InputError
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.sites.references import Site

BROKER = {"broker": "mqtt://10.0.0.5:1883"}


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({}, "broker: mqtt://HOST:PORT"),
        ({"broker": "10.0.0.5"}, "'10.0.0.5' is no address of a broker"),
        ({"broker": "mqtt://10.0.0.5:port"}, "has no valid port: write mqtt://HOST:PORT"),
        ({"broker": "mqtt://me:secret@10.0.0.5"}, "SOMRS_MQTT_PASSWORD"),
        ({"broker": "mqtt:// 10.0.0.5"}, "is no address of a broker"),
        (BROKER | {"vehicles": {"Robot1": {"manufacturer": "acme", "serialNumber": "a/7"}}}, "Robot1.serialNumber: 'a/7' has one of + # /"),
        (BROKER | {"interface": "uagv/#"}, "interface: 'uagv/#'"),
        (BROKER | {"vehicle": {}}, "vehicle: unknown key vehicle; did you mean vehicles?"),
        (BROKER | {"vehicles": {"Robot1": {"manufacturer": "acme"}}}, "serialNumber"),
        (
            BROKER | {"vehicles": {name: {"manufacturer": "acme", "serialNumber": "1"} for name in ("Robot1", "Robot2")}},
            "vehicles.Robot2: is acme 1, as Robot1 is",
        ),
        (BROKER | {"zoneActions": {"Crossing": {}}}, "zoneActions.Crossing: say what vehicles do there"),
        (BROKER | {"zoneActions": {"Crossing": {"entry": [{"blockingType": "SOFT"}]}}}, "actionType"),
        ({"broker": "mqtts://10.0.0.5", "certificates": {"authority": "none.pem"}}, "certificates: "),
    ],
)
def test_a_mistake_is_named(settings: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError) as error:
        Vda5050Adapter(settings, Path("/nowhere"))
    assert problem in str(error.value)


def test_actions_of_areas_are_read_and_the_map_has_to_have_these() -> None:
    adapter = Vda5050Adapter(BROKER | {"zoneActions": {"Crosing": {"exit": [{"actionType": "horn", "parameters": {"on": False}}]}}}, Path())
    ((path, message),) = adapter.misfits(Site(Map([Object(name="Crossing", type="Zone")]), upper()))
    assert path == ("zoneActions", "Crosing")
    assert "did you mean Crossing?" in message
    (horn,) = adapter._settings.zones["Crosing"].exit
    assert (horn.action_type, horn.blocking_type) == ("horn", "NONE")
    assert horn.action_parameters == (ActionParameter(key="on", value=False),)


def test_the_address_of_a_broker() -> None:
    plain = broker_address("mqtt://broker", Certificates(), Path())
    assert (plain.servers, plain.user, plain.security) == ((("broker", 1883),), None, None)
    secure = broker_address("mqtts://fleet@broker:8884", Certificates(), Path())
    assert (secure.servers, secure.user) == ((("broker", 8884),), "fleet")
    assert secure.security is not None


def test_names_of_vehicles() -> None:
    settings = read_settings(BROKER | {"vehicles": {"Robot1": {"manufacturer": "acme", "serialNumber": "7"}}})
    assert settings.name(address("acme", "7")) == "Robot1"
    assert settings.name(address("acme", "8")) == "Acme8"
    assert read_settings(BROKER | {"namedOnly": True}).name(address("acme", "8")) is None
    assert made_name(address("3m", "x-7")) == "Vehicle3mx7"


def address(manufacturer: str, serial_number: str) -> VehicleAddress:
    return VehicleAddress(interface="uagv", major=2, manufacturer=manufacturer, serial_number=serial_number)


def test_topics() -> None:
    assert address("acme", "7").topic(Topic.ORDER) == "uagv/v2/acme/7/order"
    assert read_topic("uagv/v2/acme/7/order") == (address("acme", "7"), Topic.ORDER)
    deep = read_topic("site/hall/v3/acme/7/state")
    assert deep is not None
    assert (deep[0].interface, deep[0].major) == ("site/hall", 3)
    assert [read_topic(text) for text in ("uagv/v1/acme/7/state", "v2/acme/7/state", "uagv/v2/acme/7/telemetry")] == [None] * 3


@pytest.mark.parametrize(
    ("maps", "storeys", "levels"),
    [
        ({}, {"L1": 0.0, "L2": 8.0}, {"L1": 0.0, "L2": 8.0}),
        ({}, {"L1": 0.0}, {}),
        ({}, {}, {}),
        ({"L2": {"version": "7"}, "hall": {"level": 0.5}}, {"L1": 0.0, "L2": 8.0}, {"L2": 8.0, "hall": 0.5}),
    ],
)
def test_maps_are_on_the_floors_of_the_storeys_with_their_names(
    maps: dict[str, Any], storeys: dict[str, float], levels: dict[str, float]
) -> None:
    frames = read_settings({**BROKER, "maps": maps}).frames(storeys)
    assert {frame.map_id: frame.level for frame in frames.all} == levels


def test_a_map_that_may_be_that_of_any_storey_is_a_mistake_in_the_settings() -> None:
    adapter = Vda5050Adapter({**BROKER, "maps": {"hall": {}, "L2": {}}}, Path())
    storeys = [Object(name="L1", type="Storey"), Object(name="L2", type="Storey", values={"Elevation": 8.0})]
    ((path, message),) = adapter.misfits(Site(Map(storeys), upper()))
    assert path == ("maps", "hall")
    assert message == "give the `level` of its floor, in metres: the building has several storeys, L1 at 0 m, L2 at 8 m"
    assert [*adapter.misfits(Site(Map(storeys[:1]), upper()))] == []
