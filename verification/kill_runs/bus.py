"""A site on a bus of three servers, whose components are on two hosts: each has a server and all components, one of them as standbys.

The third host has a server only, so that two of three servers remain whichever is killed. The gateway, the simulator and the devices are on
other hosts, which are not killed.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

from somrs.demo.hosts import Host, Hosts
from somrs.deployment.system import System
from somrs.trust.authority import Authority

COMPONENTS = ("repository", "registry", "task-manager", "scheduler")
HOSTS = ("first", "second", "third")
SITE = "yard"
"""The site's name on its bus."""


class BusOfHosts(Hosts):
    """The three hosts. An asynchronous context manager. `authority`: that of the site."""

    def __init__(self, folder: Path, authority: Authority) -> None:
        super().__init__(folder, HOSTS, {SITE: authority})
        self._lost_host: Host | None = None
        self._take_out_task: asyncio.Task[None] | None = None

    async def _start_components(self, host: Host, site: Path) -> None:
        for component in COMPONENTS:
            site_option = ["--site", str(site)] if component == "repository" else []
            await host.start(component, component, "--bus", self.servers[SITE], *site_option, site=SITE)

    async def replace_components_of(self, system: System, site: Path) -> None:
        """Have two hosts follow the components of a system, and take over from them: they are killed, and not started again."""
        for host in self._with_components:
            await self._start_components(host, site)
        for component in COMPONENTS:
            system.programs[component].process.kill()
        await self.taken_over()

    @property
    def _with_components(self) -> list[Host]:
        return self.hosts[:2]

    @property
    def message_files(self) -> list[Path]:
        """The files with the messages of the Task Managers."""
        return [host.data / "messages.jsonl" for host in self._with_components]

    async def kill_leader(self) -> None:
        """Kill the host that leads the Task Manager, for good."""
        self._lost_host = self._leader_of_tasks()
        await self._lost_host.kill()

    def take_out_leader(self) -> None:
        """Ask the host that leads the Task Manager to end, as before maintenance."""
        self._lost_host = self._leader_of_tasks()
        self._take_out_task = self._lost_host.take_out()

    def _leader_of_tasks(self) -> Host:
        host = self.leader("task-manager")
        assert host is not None, "every component has a leader between two runs"
        return host

    async def taken_over(self) -> None:
        """Return when every component has a leader."""
        await self.led(COMPONENTS)

    async def bring_back(self, site: Path) -> None:
        """Start the host that was lost again, for the next run: its components become standbys."""
        if self._take_out_task is not None:
            await self._take_out_task
            self._take_out_task = None
        if self._lost_host is not None:
            await self.start_servers(self._lost_host)
            await self._start_components(self._lost_host, site)
            self._lost_host = None
