"""The services of `deploy/compose`, run as processes: a host is a loopback address and a folder here."""

from __future__ import annotations

import asyncio
import os
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from somrs.cli.main import command
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.bus import find_site, running_components
from somrs.deployment.launcher import Process
from somrs.errors import UsageError
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT, SCENARIO_1

FILE = ROOT / "deploy" / "compose" / "compose.yaml"
COMPONENTS = {"repository", "registry", "task-manager", "scheduler"}
HOSTS = {"first": "127.31.41.1", "second": "127.31.41.2", "third": "127.31.41.3"}
"""The volumes, each of which stands for a host, and the addresses of these hosts."""


def services(profile: str = "") -> dict[str, dict[str, Any]]:
    """The services of a profile; without a name, those that always run. The site file is that of the demonstration, and what a variable of
    the shell sets is the default."""
    text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", FILE.read_text())
    services: dict[str, dict[str, Any]] = yaml.safe_load(text)["services"]
    return {name: service for name, service in services.items() if service.get("profiles", [""]) == [profile]}


def host_of(service: dict[str, Any]) -> str:
    return str(service["volumes"][0]).partition(":")[0]


def test_each_host_has_a_server_of_the_bus_and_two_have_all_components() -> None:
    commands: dict[str, list[str]] = {host: [] for host in HOSTS}
    for service in services().values():
        commands[host_of(service)] += service["command"]
    assert {*commands["first"]} == COMPONENTS | {"bus", "gateway"}
    assert {*commands["second"]} == COMPONENTS | {"bus"}
    assert commands["third"] == ["bus"]
    assert all(service["restart"] == "always" for service in services().values())
    for service in services().values():
        if service["command"] == ["repository"]:
            site = service["volumes"][1].split(":")
            assert (FILE.parent / site[0]).resolve() == SCENARIO_1
            assert site[1] == service["environment"]["SOMRS_SITE"]


def test_the_second_host_has_a_gateway_for_when_the_first_is_lost() -> None:
    [gateway] = services("first-is-lost").values()
    first = services()["gateway"]
    assert (host_of(gateway), gateway["command"], gateway["ports"]) == ("second", first["command"], first["ports"])


@pytest.mark.parametrize("name", [*services(), *services("first-is-lost")])
def test_a_container_gets_its_settings_from_its_environment(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    service = (services() | services("first-is-lost"))[name]
    for variable, value in service["environment"].items():
        monkeypatch.setenv(variable, value or "")
    [component] = service["command"]
    group: Any = command()
    parameters = group.commands["run"].commands[component].make_context(component, []).params
    of_component: dict[str, dict[str, object]] = {"bus": {"host": "0.0.0.0"}, "gateway": {"host": "0.0.0.0", "port": 8600}}
    expected = of_component.get(component, {"data": Path("/var/lib/somrs")})
    if component != "bus":
        expected |= {"bus": service["environment"]["SOMRS_BUS"], "name": "office"}
    assert {key: value for key, value in parameters.items() if key in expected} == expected


class Services:
    """The services as processes, which are started again when they end, as `restart: always` says."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._launcher = folder, warm.launcher()
        self._lives: dict[str, asyncio.Task[None]] = {}
        self._processes: dict[str, Process] = {}

    def start(self) -> None:
        for name, service in services().items():
            self._lives[name] = asyncio.create_task(self._live(name, service))

    async def _live(self, name: str, service: dict[str, Any]) -> None:
        host = host_of(service)
        (self._folder / host).mkdir(exist_ok=True)
        names = {f"bus{number}": address for number, address in enumerate(HOSTS.values(), 1)}
        own = {"SOMRS_HOST": HOSTS[host], "SOMRS_DATA": str(self._folder / host), "SOMRS_SITE": str(SCENARIO_1)}
        settings = {key: re.sub(r"\bbus\d\b", lambda found: names[found[0]], value) for key, value in service["environment"].items()}
        url = {"SOMRS_URL": f"http://{HOSTS['first']}:8600"}
        while True:
            log = self._folder / f"{name}.log"
            process = await self._launcher.start(["run", *service["command"]], log, {**os.environ, **settings, **own, **url})
            self._processes[name] = process
            await process.wait()
            await asyncio.sleep(0.5)

    async def lose(self, host: str) -> None:
        """The host with all its services is lost for good."""
        for name, service in services().items():
            if host_of(service) == host:
                self._lives[name].cancel()
                self._processes[name].kill()

    async def stop(self) -> None:
        for life in self._lives.values():
            life.cancel()
        for process in self._processes.values():
            if process.returncode is None:
                process.kill()
        await self._launcher.stop()


async def led(addresses: Addresses) -> dict[str, set[bool]]:
    """The components that answer, with whether there is a leader and whether there is a standby."""
    assert addresses.bus is not None
    found: dict[str, set[bool]] = {}
    for component in await running_components(addresses.bus):
        found.setdefault(component.component, set()).add(component.leads)
    return found


@pytest.mark.slow
def test_the_services_are_a_site_that_outlives_the_loss_of_a_host(tmp_path: Path) -> None:
    servers = ",".join(f"nats://{address}:4222" for address in HOSTS.values())

    async def scenario() -> None:
        compose = Services(tmp_path)
        compose.start()
        try:
            async with asyncio.timeout(HANG_TIME):
                while True:
                    try:
                        addresses = await find_site(servers, "office")
                        break
                    except (UsageError, OSError):
                        await asyncio.sleep(1)
                while await led(addresses) != {name: {True, False} for name in COMPONENTS}:
                    await asyncio.sleep(0.5)
                async with Client(addresses) as client:
                    assert "Jar002" in (await client.map()).objects
                    await compose.lose("second")
                    while await led(addresses) != {name: {True} for name in COMPONENTS}:
                        await asyncio.sleep(0.5)
                    assert "Jar002" in (await client.map()).objects
        finally:
            await compose.stop()

    asyncio.run(scenario())
