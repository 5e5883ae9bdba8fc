"""Adapters at the broker of a bus, with certificates: a vehicle, and things whose adapter runs from a folder of another host."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path

import aiomqtt
import pytest

from somrs.client.client import Client
from somrs.client.credentials import credentials_for
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import BUS, OWN_BUS, System
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.runtime.trust_client import enrol_at
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE, Credentials
from somrs.trust.identity import Identity, Role
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.building import building
from tests.support.hang import HANG_TIME

pytestmark = pytest.mark.long

SITE = (
    building("Lab", 8, 6)
    + """
  Exit: {type: Place, at: [6, 3, 0]}
  Robot1: {type: PioneerP3DX, at: [2, 3, 0], Speed: 0.8}
adapters:
  vda5050: {broker: bus, vehicles: {Robot1: {simulated: "2.1"}}}
"""
)
ELSEWHERE = "adapters: {things: {broker: bus, mappings: [things.yaml]}}"
THINGS = """
things:
  Lamp1:
    type: Light
    area: Storey1
    connection: broker
    attributes: {On: {topic: lamps/1/state}}
    services: {SwitchOn: {write: [{topic: lamps/1/set, payload: "ON"}]}}
"""


async def enrolled(system: System, folder: Path, identity: Identity) -> Path:
    """The certificate of an identity, which it has got from the service of the authority."""
    assert system.addresses.trust is not None
    assert system.addresses.trust_service is not None
    word = Authority(Path(system.addresses.trust)).invite(identity, datetime.now(UTC))
    await enrol_at(system.addresses.trust_service, word, folder)
    return folder / f"{identity.name}.pem"


@contextlib.asynccontextmanager
async def things(system: System, folder: Path) -> AsyncIterator[None]:
    """The adapter of the things, as it runs on another host."""
    assert system.addresses.bus is not None
    for name, text in (("adapters.yaml", ELSEWHERE), ("things.yaml", THINGS)):
        (folder / name).write_text(text)
    names = frozenset({"Gateway", "Lamp1"})
    identity = Identity(name="things", roles=frozenset({Role.DEVICE}), speaks_for=names, topics=frozenset({"lamps/#"}))
    line = [
        "run",
        "adapter",
        "things",
        "--site",
        str(folder / "adapters.yaml"),
        "--bus",
        system.addresses.bus.servers,
        "--data",
        str(folder),
    ]
    launcher, log = warm.launcher(), folder / "adapter.log"
    process = await launcher.start(line, log, {VARIABLE: str(await enrolled(system, folder, identity))})
    yield
    assert process.returncode is None, log.read_text()
    process.send_signal(signal.SIGTERM)
    await process.wait()
    await launcher.stop()


async def be_a_lamp(broker: str, certificate: Path) -> None:
    """Do what one is told by MQTT, and say that one has. The connection is made again whenever it is lost."""
    host, _, port = broker.removeprefix("mqtts://").rpartition(":")
    while True:
        with contextlib.suppress(aiomqtt.MqttError):
            async with aiomqtt.Client(host, int(port), tls_context=Credentials(certificate).client) as client:
                await client.subscribe("lamps/1/set")
                async for message in client.messages:
                    assert isinstance(message.payload, bytes)
                    await client.publish("lamps/1/state", message.payload, qos=1, retain=True)
        await asyncio.sleep(0.1)


def kill_server(system: System) -> None:
    """Kill the NATS server of the bus, as when its host is lost."""
    pid = system.programs[BUS].process.pid
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        os.kill(int(child), signal.SIGKILL)


def test_tasks_go_on_after_the_server_of_the_bus_was_killed_on_the_way(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(SITE)
    (elsewhere := tmp_path / "elsewhere").mkdir()
    notices: list[str] = []

    async def run() -> None:
        system = System([tmp_path / "site.yaml"], tmp_path / "data", bus=OWN_BUS, world=WorldKind.KINEMATIC, launcher=warm.launcher())
        async with asyncio.timeout(HANG_TIME), system, Client(system.addresses) as client, things(system, elsewhere):
            assert system.addresses.mqtt is not None
            assert system.addresses.simulator is not None
            lamp = Identity(name="Lamp1", roles=frozenset({Role.THING}), topics=frozenset({"lamps/1/#"}))
            being_lamp = asyncio.create_task(be_a_lamp(system.addresses.mqtt, await enrolled(system, tmp_path / "lamp", lamp)))
            keeping = asyncio.create_task(keep_running(system, notices.append))
            while not {"Robot1", "Lamp1"} <= {offer.provider for offer in await client.services()}:
                await asyncio.sleep(0.1)
            working = asyncio.create_task(accomplish(client, "Robot1 isAt Exit"))
            async with OperatorLink.at(system.addresses.simulator, credentials_for(system.addresses)) as link:
                while (await link.robots())["Robot1"].x < 2.5:
                    await asyncio.sleep(0.05)
            kill_server(system)
            for view, provider in ((await working, "Robot1"), (await accomplish(client, "Lamp1.On = TRUE"), "Lamp1")):
                assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
                assert [work.service.partition(".")[0] for work in view.work] == [provider]
            assert "bus is back" in notices
            for task in (keeping, being_lamp):
                task.cancel()

    asyncio.run(run())
