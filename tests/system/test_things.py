"""A whole system with things: a robot rides in a lift, and drives through a door, that are behind an MQTT broker; a sensor says what it
measures."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from urllib.parse import urlsplit

import aiomqtt
import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.hang import HANG_TIME

pytestmark = pytest.mark.long

SITE = """
map: Tower
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
          Gate1: {type: LiftDoor, at: [8.05, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
          South1: {type: Wall, at: [3.5, 1.2, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.4, Height: 2.5}}
          North1: {type: Wall, at: [3.5, 4.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.4, Height: 2.5}}
          Door1: {type: AutomaticDoor, at: [3.5, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Upper:
        type: Storey
        Elevation: 4
        parts:
          Floor2: {type: Floor, at: [4, 3, 3.9], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
          Gate2: {type: LiftDoor, at: [8.05, 3, 4], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Lift1: {type: Lift, at: [9.1, 3, 0], Shape: {Form: Box, Width: 1.8, Depth: 1.8, Height: 2.3}}
  Top: {type: Place, at: [3, 3, 4]}
  Robot1: {type: PioneerP3DX, at: [1.5, 3, 0]}
facts: [Lift1 stopsAt Ground, Lift1 stopsAt Upper, Gate1 leadsInto Lift1, Gate2 leadsInto Lift1]
adapters:
  things: {broker: own, mappings: [things.yaml], simulated: {Door1: {}, Lift1: {G: 0, U: 4}}}
"""
THINGS = """
things:
  Lift1: {type: Lift, session: {connection: broker, topic: lifts/1, levels: {Ground: G, Upper: U}}}
  Door1: {type: AutomaticDoor, session: {connection: broker, topic: doors/1}}
  Lamp1:
    type: Light
    connection: broker
    area: Upper
    attributes: {Power: {topic: lamps/1/power}}
    services: {SwitchOn: {write: [{topic: lamps/1, payload: "ON", retain: true}], done_when: sent}}
  Sensor1:
    type: Sensor
    connection: broker
    area: Ground
    attributes: {Temperature: {topic: sensors/1}}
"""


async def listen(broker: str, topics: set[str]) -> None:
    """Note the topics of all messages."""
    address = urlsplit(broker)
    async with aiomqtt.Client(address.hostname or "", address.port or 0) as client:
        await client.subscribe("#")
        await client.publish("sensors/1", "21.5", retain=True)
        await client.publish("lamps/1/power", "9", retain=True)
        async for message in client.messages:
            topics.add(str(message.topic))


def test_a_robot_rides_in_a_lift_and_drives_through_a_door_at_a_broker(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(SITE)
    (tmp_path / "things.yaml").write_text(THINGS)

    async def run() -> None:
        system = System([tmp_path / "site.yaml"], tmp_path / "data", world=WorldKind.KINEMATIC, launcher=warm.launcher())
        async with asyncio.timeout(HANG_TIME), system, Client(system.addresses) as client:
            (adapter,) = json.loads((tmp_path / "data" / "adapters.json").read_text())
            topics: set[str] = set()
            listening = asyncio.create_task(listen(adapter["settings"]["broker"], topics))
            while not any(offer.provider == "Lamp1" for offer in await client.services()):
                await asyncio.sleep(0.05)
            for effect in ("Robot1 isAt Top AND Lamp1.On = TRUE", "Lift1 standsAt Ground"):
                view = await accomplish(client, effect)
                assert view.outcome == "accomplished", view.explanation
            assert (await client.query("Lamp1 isPartOf Upper", limit=1)).rows
            while not (await client.query("Sensor1.Temperature = 21.5 AND Lamp1.Power = 9 AND Sensor1 isPartOf Ground", limit=1)).rows:
                await asyncio.sleep(0.1)
            assert topics >= {"lifts/1/request", "lifts/1/state", "doors/1/request", "doors/1/state", "lamps/1"}
            listening.cancel()

    asyncio.run(run())
