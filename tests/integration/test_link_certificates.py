"""The links to a simulated and to a symbolic world, whose clients prove who they are."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.devices import link_security
from somrs.devices.link_security import link_credentials
from somrs.devices.simulator.link import connection
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.link import OperatorLink, RobotLink
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.symbolic.lines import Begin, Hello, Welcome
from somrs.devices.symbolic.link import ask
from somrs.devices.symbolic.server import WorldServer
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.errors import RemoteError, UsageError
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE, Credentials
from somrs.trust.identity import Identity, Role
from tests.support.robot_lab import run, site


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    authority = Authority.of_data(tmp_path)
    authority.create("lab", datetime.now(UTC))
    return authority


def enrolled(authority: Authority, name: str, role: Role, *speaks_for: str) -> Credentials:
    identity = Identity(name=name, roles=frozenset({role}), speaks_for=frozenset(speaks_for))
    return Credentials(authority.issue_program(identity, ("127.0.0.1",), datetime.now(UTC))[0])


@asynccontextmanager
async def simulator(authority: Authority) -> AsyncIterator[Server]:
    loaded, map = site()
    server = Server(Simulation(map, loaded.ontology, WorldKind.KINEMATIC), credentials=enrolled(authority, "simulator", Role.TRAFFIC))
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


def test_a_robot_is_controlled_by_who_speaks_for_it(authority: Authority, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "PATIENCE", 2.0)
    devices, manager = enrolled(authority, "devices", Role.DEVICE, "Robot1"), enrolled(authority, "task-manager", Role.TASK_MANAGER)

    async def test() -> None:
        async with simulator(authority) as server:
            async with RobotLink(server.host, server.port, "Robot1", credentials=devices) as robot:
                assert (await robot.drive_to(2.5, 1.5)).state is not None
                for credentials, problem in ((devices, "devices may not speak for Robot2"), (manager, "that is for the roles device")):
                    with pytest.raises(RobotGaveUp, match=problem):
                        await RobotLink(server.host, server.port, "Robot2", credentials=credentials).connect()
                authority.revoke("devices", datetime.now(UTC))
                with pytest.raises((RobotGaveUp, UsageError), match=r"the certificate of devices .* is revoked"):
                    await robot.drive_to(2.0, 1.5)
            with pytest.raises(RobotGaveUp, match="is revoked"):
                await RobotLink(server.host, server.port, "Robot1", credentials=devices).connect()

    run(test())


def test_the_world_is_changed_by_people_and_read_by_the_site(authority: Authority) -> None:
    client, manager = enrolled(authority, "client", Role.CLIENT), enrolled(authority, "task-manager", Role.TASK_MANAGER)

    async def test() -> None:
        async with simulator(authority) as server:
            async with OperatorLink(server.host, server.port, credentials=manager) as operator:
                assert (await operator.clock()).speed is None
                with pytest.raises(UsageError, match="task-manager may not do this: that is for the roles api, client"):
                    await operator.fault("Robot1", Fault.DRIVE)
                with pytest.raises(UsageError, match="that is for the roles api, client, device"):
                    await operator.move("Jar1", 3, 3, 0)
            async with OperatorLink.at(f"tls://{server.host}:{server.port}", client) as operator:
                await operator.fault("Robot1", Fault.DRIVE)
                assert Fault.DRIVE in (await operator.robots())["Robot1"].faults
            reader, writer = await asyncio.open_connection(server.host, server.port)
            writer.write(b'{"say":"hello"}\n')
            assert b"welcome" not in await reader.read()
            writer.close()

    run(test())


def test_a_symbolic_device_is_spoken_for_by_its_program(authority: Authority, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded, map = site()
    server = WorldServer(SymbolicWorld(loaded.ontology, map), speed=None, credentials=enrolled(authority, "world", Role.VIEWER))
    certificate = enrolled(authority, "devices", Role.DEVICE, "Robot1").certificate

    async def test() -> None:
        await server.start()
        address = f"tls://{server.host}:{server.port}"
        with pytest.raises(UsageError, match="for programs with a certificate of its site"):
            await ask(address, Hello(device="Robot1"), Welcome)
        monkeypatch.setenv(VARIABLE, str(certificate))
        assert (await ask(address, Hello(device="Robot1"), Welcome)).type == "PioneerP3DX"
        for request in (Hello(device="Robot2"), Begin(device="Robot2", service="TransferObject", inputs={})):
            with pytest.raises(RemoteError, match="devices may not speak for Robot2"):
                await ask(address, request, Welcome)
        await server.stop()

    run(test())


def test_without_certificates_no_program_has_to_prove_anything() -> None:
    assert link_credentials("127.0.0.1:4000") is None
    link_security.OPEN.check(frozenset(), "Robot1")
