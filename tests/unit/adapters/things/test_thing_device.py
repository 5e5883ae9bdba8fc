"""Which orders things refuse: for now, and for good."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.hub import Hub
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.model import Command, Source
from somrs.adapters.things.thing_device import ThingDevice, thing_device
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.device import Task
from somrs.service_manager.sdk.orders import Order, Refusal, ServiceFailed
from tests.support.virtual_devices import make_ask

MAPPING = """
connections: {house: {url: mqtt://broker}, boiler: {url: modbus://plc}}
things:
  Heater1:
    type: Heater
    available: {topic: heater/status, connection: house}
    attributes: {TargetTemperature: {register: holding 7, as: int16, scale: 0.1, connection: boiler}}
    services:
      SetTemperature:
        write:
          - connection: boiler
            register: holding 7
            as: int16
            payload: '?Temperature'
            convert: {Temperature: {inverse_of: TargetTemperature, range: [RANGE]}}
"""


def refusal(folder: Path, temperature: str, status: bytes | None, limits: str) -> Refusal | None:
    """Why the heater refuses an order for a temperature, after it has said how it is."""
    (folder / "things.yaml").write_text(MAPPING.replace("RANGE", limits))

    async def ask_heater() -> None:
        loaded, hub = read_mapping(folder / "things.yaml"), Hub()
        for connection in loaded.connections.values():
            hub.connect(connection)
        (thing,) = loaded.things
        hub.add(thing, loaded.ontology)
        if status is not None:
            hub.received(("house", "heater/status", None), status)
        device = thing_device(thing, hub)
        assert isinstance(device, ThingDevice)
        order = Order(participant="p", method="SetTemperature", inputs={"Temperature": temperature}, effect=thing.services[0].effect)
        repository = Repository("http://here/repository", Contents(ontology=upper(), map=Map()))
        await device.check_ability(thing.services[0], Task(thing.name, order, make_ask(repository, lambda: 0.0), lambda _: None))

    try:
        asyncio.run(ask_heater())
    except Refusal as error:
        return error
    return None


@pytest.mark.parametrize(
    ("temperature", "status", "limits", "reason", "passes"),
    [
        ("21", b"online", "5, 90", None, True),
        ("21", None, "5, 90", "has not said yet that it works", True),
        ("21", b"offline", "5, 90", "does not work", True),
        ("4000", b"online", "-1e6, 1e6", "holding 7: 40000 does not fit into int16", False),
        ("91", b"online", "5, 90", "Temperature: 91 degC is beyond range: 5 to 90 degC", False),
    ],
)
def test_a_heater_refuses_what_it_cannot_do(
    tmp_path: Path, temperature: str, status: bytes | None, limits: str, reason: str | None, passes: bool
) -> None:
    error = refusal(tmp_path, temperature, status, limits)
    if reason is None:
        assert error is None
    else:
        assert error is not None
        assert reason in error.reason
        assert error.not_now is passes


class Wire:
    """The connection of a heater that has a fault, and says so when it is sent something (somrs.adapters.things.connector.Connector)."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub

    async def run(self) -> None:
        """It is there."""

    def follow(self, source: Source) -> None:
        """It says all."""

    def unfollow(self, source: Source) -> None:
        """It says all."""

    async def send(self, command: Command, raw: Raw) -> None:
        asyncio.get_running_loop().call_soon(self._hub.received, ("house", "heater/fault", None), b"true")


def test_a_service_has_failed_as_long_as_the_thing_says_so_although_its_effect_holds(tmp_path: Path) -> None:
    (tmp_path / "things.yaml").write_text("""
connections: {house: {url: mqtt://broker}}
attributes: {Fault: {kind: truth}}
types: {FaultyHeater: {parent: Heater, attributes: [Fault]}}
things:
  Heater1:
    type: FaultyHeater
    attributes: {TargetTemperature: {topic: heater/target}, Fault: {topic: heater/fault}}
    services: {SetTemperature: {write: [{topic: heater/set, payload: '?Temperature'}], failed_when: "?Provider.Fault = TRUE"}}
""")

    async def order_it() -> None:
        loaded, hub = read_mapping(tmp_path / "things.yaml"), Hub()
        hub.connectors["house"] = Wire(hub)
        (thing,) = loaded.things
        hub.add(thing, loaded.ontology)
        hub.received(("house", "heater/target", None), b"21")
        hub.received(("house", "heater/fault", None), b"true")
        device = thing_device(thing, hub)
        order = Order(participant="p", method="SetTemperature", inputs={"Temperature": "21"}, effect=thing.services[0].effect)
        repository = Repository("http://here/repository", Contents(ontology=upper(), map=Map()))
        await device.perform(thing.services[0], Task(thing.name, order, make_ask(repository, lambda: 0.0), lambda _: None))

    with pytest.raises(ServiceFailed, match=r"Heater1 says Heater1\.Fault = TRUE"):
        asyncio.run(order_it())
