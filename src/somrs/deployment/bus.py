"""The gateway of a site's bus (`somrs run gateway`), and where a site is on a bus. `bus_server.py` has the NATS server."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from somrs.client.addresses import Addresses, registry_path, task_manager_path
from somrs.deployment.programs import until_stopped
from somrs.errors import UsageError
from somrs.ports import host_and_port
from somrs.runtime.bus import Bus
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.bus_gateway import BusParts
from somrs.runtime.http import Server
from somrs.runtime.node import ANSWER_TIME
from somrs.runtime.trust_client import following
from somrs.storage.nats_connection import made_with_copies, patiently
from somrs.storage.running_component import RunningComponent, status_subject
from somrs.storage.stores import REQUESTS, SITES_REQUEST, answer_of_servers, discard_stores, have_made
from somrs.trust.credentials import Credentials

if TYPE_CHECKING:
    from nats.js import JetStreamContext
    from nats.js.kv import KeyValue

FIRST_ANSWER_TIME, ANSWERS_TIME = 30.0, 1.0
"""Seconds for which the first answer, and a further one, is waited for when all processes of a site are asked what they run. If none runs,
the bus says so at once."""

log = logging.getLogger(__name__)

SITES = "somrs-sites"
"""The bucket of the bus's key-value store with the addresses of each site, by its name."""

_LAG = 3.0
"""Seconds within which a server that has just come back knows what the others have stored."""
_STORE_TIME = 60.0
"""Seconds for which the store of the bus is asked again: after its start, its servers first elect one that leads."""


def bus_address(servers: str, site: str, gateway: str) -> BusAddress:
    """Where a site's bus is. Raises UsageError for a name that subjects cannot have."""
    try:
        return BusAddress(servers=servers, site=site, gateway=gateway.rstrip("/"))
    except ValueError as error:
        raise UsageError(str(error)) from None


def mqtt_url(address: str, *, secure: bool) -> str:
    """The URL of the broker at HOST:PORT; of several servers, separated by commas. `secure`: its clients have certificates.

    Raises UsageError for a wrong address.
    """
    servers = address.split(",")
    for server in servers:
        host_and_port(server)
    return ",".join(f"{'mqtts' if secure else 'mqtt'}://{server}" for server in servers)


async def run_gateway(bus: BusAddress, host: str, port: int, mqtt: str | None = None) -> None:
    """Run the gateway of a site until this process is asked to stop, and list the site's addresses on the bus.

    `mqtt`: the HOST:PORT, separated by commas, at which the servers of the bus are a broker for MQTT; None: as it is listed, if it is.
    """
    credentials = Credentials.of_environment()
    connection = Bus(bus, credentials)
    await connection.start()
    try:
        sites = await _sites(connection)
        listed = await _listed(connection, sites)
        if listed is not None:
            await _check_same_site(bus, listed)
        server = Server(host, port, BusParts(connection, ANSWER_TIME), public_url=bus.gateway, credentials=credentials)
        await server.start()
        broker = mqtt_url(mqtt, secure=credentials is not None) if mqtt is not None else (listed.mqtt if listed is not None else None)
        if listed is None or listed.bus != bus:
            listed = await _running_addresses(bus, credentials)
            await _put(sites, msgspec.structs.replace(listed, mqtt=broker))
        elif listed.mqtt != broker:
            await _put(sites, msgspec.structs.replace(listed, mqtt=broker))
        async with following(credentials):
            await until_stopped("gateway", bus.gateway)
        await server.stop()
    finally:
        await connection.close()


async def _check_same_site(bus: BusAddress, listed: Addresses) -> None:
    """Raises UsageError when components run that belong to another site of the same name: both would get the messages of each other."""
    assert listed.bus is not None, "written by its gateway"
    if listed.bus.gateway != bus.gateway and (running := await running_components(bus)):
        rival = f"the site {bus.site} there is another one, with the gateway {listed.bus.gateway}"
        raise UsageError(
            f"{bus.servers}: {rival}; its {running[0].component} runs on {running[0].host}: stop it, or select another name with `--name`"
        )


async def check_reachable(bus: BusAddress, credentials: Credentials | None = None) -> None:
    """Return when a server of the bus can be reached. Raises UsageError for a wrong URL. `credentials`: as of `Bus`."""
    connection = Bus(bus, credentials)
    await connection.start()
    await connection.close()


def addresses_on(bus: BusAddress) -> Addresses:
    """The addresses of a site's components on the bus."""
    return Addresses(
        repository=f"{bus.gateway}/repository",
        registry=f"{bus.gateway}/registry",
        task_manager=f"{bus.gateway}/task-manager",
        scheduler=f"{bus.gateway}/scheduler",
        bus=bus,
    )


async def _running_addresses(bus: BusAddress, credentials: Credentials | None) -> Addresses:
    """The addresses of a site of which the bus knows nothing, with all Task Managers and Registries that run."""
    names = [running.component for running in await running_components(bus, credentials)]
    task_manager, registry = (_highest_number(f"{kind}-", names) for kind in ("task-manager", "registry"))
    return _with_numbers(addresses_on(bus), bus.gateway, task_manager, registry)


def _highest_number(prefix: str, names: Sequence[str]) -> int:
    """The highest number of components whose names begin like this; the first one has none in its name."""
    return max((int(name.removeprefix(prefix)) for name in names if name.startswith(prefix)), default=1)


async def find_site(servers: str, name: str | None = None, credentials: Credentials | None = None) -> Addresses:
    """The addresses of a site on the bus; without a name, of the only one. Raises UsageError when it is not there. `credentials`: as of
    `Bus`."""
    connection = Bus(BusAddress(servers=servers, site="any", gateway="http://127.0.0.1"), credentials)
    await connection.start()
    try:
        sites = await _all_addresses(connection)
        end = asyncio.get_running_loop().time() + _LAG
        while (name or next(iter(sites), None)) not in sites and asyncio.get_running_loop().time() < end:
            await asyncio.sleep(0.2)
            sites = await _all_addresses(connection)
    finally:
        await connection.close()
    if name is None and len(sites) == 1:
        [name] = sites
    if name is None or name not in sites:
        site_list = f"the sites there are {', '.join(sites)}; name one with --name" if sites else "no gateway has been started there"
        raise UsageError(f"{servers}: {f'there is no site {name}' if name else 'no site is named'}; {site_list}")
    addresses = sites[name]
    assert addresses.bus is not None, "written by its gateway"
    # This process may reach the servers by other names than the gateway does.
    return msgspec.structs.replace(addresses, bus=msgspec.structs.replace(addresses.bus, servers=servers))


async def running_components(bus: BusAddress, credentials: Credentials | None = None) -> list[RunningComponent]:
    """The processes on the bus that run the site's components, leaders first. All that answer within `ANSWERS_TIME` of the last answer.

    `credentials`: as of `Bus`.
    """
    components, _ = await _ask_components(bus, credentials)
    return components


async def _ask_components(bus: BusAddress, credentials: Credentials | None) -> tuple[list[RunningComponent], bool]:
    """What the processes of a site answer, and whether any of them listens, which may be too busy to answer."""
    from nats import errors

    connection = Bus(bus, credentials)
    await connection.start()
    components: list[RunningComponent] = []
    try:
        inbox = connection.client.new_inbox()
        answers = await connection.client.subscribe(inbox)
        await connection.client.publish(status_subject(bus.site), reply=inbox)
        with contextlib.suppress(errors.TimeoutError):
            while True:
                answer = await answers.next_msg(timeout=ANSWERS_TIME if components else FIRST_ANSWER_TIME)
                if not answer.data:  # the server says that nobody listens
                    return [], False
                components.append(msgspec.msgpack.decode(answer.data, type=RunningComponent))
    finally:
        await connection.close()
    return sorted(components, key=lambda running: (running.component, not running.leads, running.host, running.process)), True


async def discard_site(servers: str, name: str, credentials: Credentials | None = None) -> None:
    """Delete what the bus keeps of a site. Raises UsageError if its components run. `credentials`: as of `Bus`."""
    bus = bus_address(servers, name, "http://127.0.0.1")
    running, is_heard = await _ask_components(bus, credentials)
    if running:
        raise UsageError(
            f"{running[0].component} of the site {name} runs on {running[0].host}; stop it, or select another name with `--name`"
        )
    if is_heard:
        raise UsageError(f"components of the site {name} run, and do not answer; stop them, or select another name with `--name`")
    connection = Bus(bus, credentials)
    await connection.start()
    try:
        await _sites(connection)  # waits until the servers can be asked
        await discard_stores(connection.client, name)
    finally:
        await connection.close()


def site_name(site: Sequence[Path]) -> str:
    """The name on a bus of a site with these files, if it is given none."""
    return "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in site[0].stem)


async def list_site(addresses: Addresses, credentials: Credentials | None = None) -> None:
    """List the addresses of a site on its bus. `credentials`: as of `Bus`."""
    assert addresses.bus is not None, "the site is on a bus"
    connection = Bus(addresses.bus, credentials)
    await connection.start()
    try:
        await _put(await _sites(connection), addresses)
    finally:
        await connection.close()


async def list_number(bus: BusAddress, *, task_manager: int = 1, registry: int = 1) -> None:
    """List the Task Managers or Registries of a site up to this number, where they are not listed yet.

    Waits while the servers do not answer: who takes over lists itself just after the loss of a host, which may have had one of them.
    """
    from nats.js.errors import KeyWrongLastSequenceError

    async def update(sites: KeyValue, complete: Addresses, revision: int | None) -> bool:
        """Returns whether this is listed now. Otherwise another one has listed itself in between."""
        try:
            await sites.update(bus.site, msgspec.json.encode(complete), last=revision)
        except KeyWrongLastSequenceError:
            return False
        return True

    connection = Bus(bus)
    await connection.start()
    try:
        sites = await _sites(connection)
        while bus.site in await listed_sites(connection.client.jetstream()):
            entry = await patiently(lambda: sites.get(bus.site))  # once: the revision has to be that of these addresses
            listed = _addresses(entry)
            complete = _with_numbers(listed, bus.gateway, task_manager, registry)
            if complete == listed or await patiently(partial(update, sites, complete, entry.revision)):
                return
    finally:
        await connection.close()


def _with_numbers(listed: Addresses, gateway: str, task_manager: int, registry: int) -> Addresses:
    managers = (*listed.task_managers.values(), *(f"{gateway}{task_manager_path(n)}" for n in range(1, task_manager + 1)))
    registries = (*listed.registries.values(), *(f"{gateway}{registry_path(n)}" for n in range(1, registry + 1)))
    return msgspec.structs.replace(
        listed, further_task_managers=tuple(dict.fromkeys(managers))[1:], further_registries=tuple(dict.fromkeys(registries))[1:]
    )


async def _listed(connection: Bus, sites: KeyValue) -> Addresses | None:
    """The addresses of the site; None if it is not listed."""
    site = connection.address.site
    return _addresses(await patiently(lambda: sites.get(site))) if site in await listed_sites(connection.client.jetstream()) else None


def _addresses(entry: KeyValue.Entry) -> Addresses:
    return msgspec.json.decode(entry.value or b"", type=Addresses)


async def _all_addresses(connection: Bus) -> dict[str, Addresses]:
    """The addresses of all sites on the bus, by their names. Raises UsageError for a bus that does not say them."""
    if not connection.has_certificate:
        await _sites(connection)  # waits until the servers can be asked
        return await listed_addresses(connection.client.jetstream())
    try:
        async with asyncio.timeout(_STORE_TIME):
            return msgspec.json.decode(await answer_of_servers(connection.client, SITES_REQUEST), type=dict[str, Addresses])
    except TimeoutError:
        raise UsageError(f"{connection.address.servers}: this bus has no sites; start its servers with `somrs run bus`") from None


async def listed_addresses(store: JetStreamContext) -> dict[str, Addresses]:
    """The addresses of all sites that are listed, by their names."""
    from nats.js.errors import NotFoundError

    try:
        names = await listed_sites(store)
    except NotFoundError:
        return {}
    sites = await patiently(lambda: store.key_value(SITES))
    return {name: _addresses(await patiently(partial(sites.get, name))) for name in names}


async def listed_sites(store: JetStreamContext) -> list[str]:
    """The names of the sites. Waits while the servers cannot say, as they do after the loss of one of them.

    Raises nats.js.errors.NotFoundError if no site has been listed.
    """
    subjects = f"$KV.{SITES}."
    stream = await patiently(lambda: store.stream_info(f"KV_{SITES}", subjects_filter=f"{subjects}>"))
    return sorted(subject.removeprefix(subjects) for subject in stream.state.subjects or {})


async def _sites(connection: Bus) -> KeyValue:
    """The bucket of sites, made if there is none. Raises UsageError for a bus without JetStream."""
    from nats.js.errors import NotFoundError

    store = connection.client.jetstream()
    try:
        async with asyncio.timeout(_STORE_TIME):
            subject, by_servers = f"{REQUESTS}.{connection.address.site}", connection.has_certificate
            while True:  # of several servers, the one that is asked may not know yet what another one has made
                with contextlib.suppress(NotFoundError):  # who only reads may not have it made
                    return await patiently(lambda: store.key_value(SITES))
                await have_made(connection.client, subject, partial(make_sites, store), by_servers=by_servers)
    except TimeoutError:
        advice = "start its servers with JetStream, and more than half of them"
        raise UsageError(f"{connection.address.servers}: this bus stores nothing; {advice}") from None


async def _put(sites: KeyValue, addresses: Addresses) -> None:
    """List a site. Servers may lose the answer when they read their configuration, as they do for a new site."""
    assert addresses.bus is not None, "it is on a bus"
    await patiently(partial(sites.put, addresses.bus.site, msgspec.json.encode(addresses)))


async def make_sites(store: JetStreamContext) -> None:
    """Make the bucket of sites if there is none."""
    from nats.js.api import KeyValueConfig

    await made_with_copies(lambda copies: store.create_key_value(KeyValueConfig(bucket=SITES, replicas=copies)))
