"""The implementations of the commands of `main.py`, except those about tasks (`tasks.py`). Each is a client of the running system."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.cli.geometry import geometry_problems, printed
from somrs.cli.running_site import site_addresses
from somrs.client import terminal
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.state_labels import neighbour_text
from somrs.errors import InputError, ModelError, UsageError
from somrs.ontology.objects import Change, Object, ObjectAdded, ObjectRemoved
from somrs.ontology.types import Value
from somrs.protocol.messages.directory import Discover
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.people import person_name
from somrs.service_manager.sdk.values import python_value

if TYPE_CHECKING:
    from rich.console import Console

    from somrs.deployment.system import System

NO_SERVICES = "No service is on offer yet: devices join when they are reached. `somrs fleet` says how each is."
DEMO_SITE = Path(str(resources.files("somrs.demo") / "data" / "scenario-1.yaml"))
"""The site of `somrs up` when the user gives none."""


def check(files: Sequence[Path], *, json: bool) -> int:
    """Print every error in the files or, if there is none, every mistake in the geometry of the map. Returns the exit status."""
    from somrs.deployment.adapter_checks import adapter_problems
    from somrs.ontology.files.loading import load
    from somrs.ontology.service_kinds import planning_notes
    from somrs.sites.references import Site

    notes: list[str] = []
    try:
        loaded = load(files)
    except ModelError as error:
        problems = error.problems
    else:
        notes = [f"{name}: {note}" for name, service in loaded.ontology.services.items() for note in planning_notes(service)]
        site = Site(loaded.map, loaded.ontology) if loaded.map is not None else None
        adapters = adapter_problems(loaded.adapters, site)
        geometry = geometry_problems(loaded)
        if geometry is None:
            notes.append("the geometry was not checked, because numpy or scipy is missing: pip install 'somrs[simulator]'")
        problems = [*adapters, *(geometry or [])]
        objects = f"a map of {len(loaded.map.objects)} objects" if loaded.map is not None else "no map"
        summary = f"{len(loaded.ontology.types)} types, {len(loaded.ontology.services)} service types, {objects}"
    if json:
        terminal.print_json([{name: getattr(problem, name) for name in problem.__slots__} for problem in problems])
        return 1 if problems else 0
    for note in notes:
        print(f"note: {note}")
    for line in printed(problems):
        print(line)
    print(f"{len(problems)} problem{'s' if len(problems) != 1 else ''} found" if problems else f"no problems: {summary}")
    return 1 if problems else 0


def schema(output: Path | None) -> None:
    """Write the JSON Schema of site files, and print how to use it in an editor."""
    from somrs.ontology.schema import json_schema

    text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    if output is None:
        print(text, end="")
    else:
        output.write_text(text, encoding="utf-8")
        print(f"{output}: for completion in editors, begin a site file with `# yaml-language-server: $schema={output}`")


def site_to_run(site: Sequence[Path], data: Path, *, fresh: bool) -> Sequence[Path]:
    """The files to start a system with: `site`, by default those of the map in the data folder, or the demonstration's if it holds none.

    Raises UsageError for a file that does not exist, and for `fresh` without a site if that deletes the map of another one.
    """
    from somrs.deployment.system import site_of

    if not site:
        earlier_site = site_of(data)
        if fresh and earlier_site not in (None, [DEMO_SITE]):
            names = ", ".join(map(str, earlier_site or ()))
            raise UsageError(f"`--fresh` deletes the map of {names} in {data}; give the site to start with: somrs up SITE --fresh")
        site = earlier_site or [DEMO_SITE]
    for file in site:
        if not file.exists():
            raise UsageError(f"{file}: there is no such file")
    return site


def _reporter(data: Path, console: Console) -> Callable[[str], None]:
    """Says things in the log of the system, and on the terminal if there is one."""

    def report(text: str) -> None:
        folder = data / "logs"
        folder.mkdir(exist_ok=True)
        with (folder / "system.log").open("a", encoding="utf-8") as log:
            log.write(f"{datetime.now().isoformat(timespec='seconds')} {text}\n")
        with contextlib.suppress(OSError):  # the terminal is gone
            console.print(text)

    return report


async def run_system(site: Sequence[Path], data: Path, make_system: Callable[[Sequence[Path]], System], *, fresh: bool) -> None:
    """Run the system that `make_system` makes of the site's files, until it is asked to stop. `fresh`: discard what is kept of it."""
    from somrs.cli.import_commands import import_sources
    from somrs.deployment.private_files import keep_files_private, make_private
    from somrs.deployment.programs import load_site, stop_signal
    from somrs.deployment.system import check_unused

    console = terminal.console()
    keep_files_private()
    make_private(data)
    check_unused(data)
    files = import_sources(site, data)
    system = make_system(files)
    if fresh:
        load_site(files)  # so that a mistake in it deletes nothing
        await system.discard()

    report = _reporter(data, console)
    try:
        world_program = "the simulator" if system.simulates else "traffic"
        with console.status(f"starting the Repository, the Registry, the Task Manager, {world_program} and the devices ..."):
            await system.start()
            async with Client(system.addresses) as client:
                offers = await client.services()
        stopped = asyncio.create_task(stop_signal())
        await asyncio.sleep(0)  # until the signals are handled: a script may send one as soon as it reads that the system runs
        console.print(terminal.services(offers) if offers else NO_SERVICES)
        console.print(
            f"Running. In another terminal: somrs do FORMULA{'' if data == Path('.somrs') else f' --data {data}'}. Ctrl-C stops it."
        )
        console.print(f"The API: {system.addresses.api}")
        for broker in filter(None, (system.addresses.mqtt, system.addresses.broker)):
            console.print(f"The broker for MQTT: {broker}")
        if system.addresses.gui is not None:
            console.print(f"In the browser: {system.addresses.gui}")
            _print_sign_in(system, console)
        _print_open_ports(system, console)
        await _supervise(system, report, stopped)
    except Exception as error:  # whatever it is, the log of the system says why it ended
        report(f"the system stops: {error}" if isinstance(error, InputError) else f"the system stops: {type(error).__name__}: {error}")
        raise
    finally:
        with contextlib.suppress(OSError):  # the terminal is gone
            console.print("stopping ...")
        await system.stop()


def _print_sign_in(system: System, console: Console) -> None:
    """How the person at the terminal gets in."""
    from somrs.access.store import AccessStore
    from somrs.cli.access_commands import sign_in_url

    if not system.secure:
        console.print("Whoever reaches these addresses may do everything (--insecure).")
        return
    store = AccessStore(system.data)
    administrator = store.read().first_administrator()
    secret = store.add_link(administrator.name if administrator is not None else None)
    account_text = f"as {administrator.name}" if administrator is not None else "as the administrator"
    console.print(f"To sign in {account_text}, once: {sign_in_url(system.addresses.gui or '', secret)}", soft_wrap=True)


def _print_open_ports(system: System, console: Console) -> None:
    """That its programs have no certificates, if so, and how they get some."""
    if system.addresses.trust is None:
        console.print(
            "[yellow]Its programs have no certificates[/]: whoever reaches their ports may send messages in any name. To change that: "
            f"stop it, and start it once with somrs up --certificates --data {system.data}",
            soft_wrap=True,
            highlight=False,
        )


async def _supervise(system: System, report: Callable[[str], None], stopped: asyncio.Task[str]) -> None:
    """Keep the programs of a system running until it is asked to stop. `report` receives what happens, and why it stops."""
    from somrs.deployment.supervision import bound_logs, keep_running

    supervisor, rotation = asyncio.create_task(keep_running(system, report)), asyncio.create_task(bound_logs(system.data))
    try:
        await asyncio.wait([supervisor, stopped], return_when=asyncio.FIRST_COMPLETED)
        if supervisor.done():
            supervisor.result()
        report(f"the system stops: it received {stopped.result()}")
    finally:
        for task in (supervisor, rotation, stopped):
            task.cancel()
        await asyncio.gather(supervisor, rotation, stopped, return_exceptions=True)


async def services(type: str | None, effect: str | None, attributes: Sequence[str], data: Path, *, json: bool) -> None:
    required_values: dict[str, Value] = {}
    for attribute in attributes:
        name, equals, text = attribute.partition("=")
        if not equals:
            raise UsageError(f"--attribute takes NAME=VALUE, such as Payload=2, not {attribute!r}")
        required_values[name.strip()] = python_value(text.strip())
    async with Client(await site_addresses(data)) as client:
        discover = Discover(service_type=type, effect=effect, attributes=required_values)
        offers, withheld, neighbours = await client.services(discover), await client.withheld_services(discover), await client.neighbours()
    if json:
        terminal.print_json(offers)
        return
    terminal.console().print(terminal.services(offers) if offers else "no matching service is on offer")
    for offer, reason in withheld:
        origin = f" of {offer.registry}" if offer.registry else ""
        terminal.console().print(f"not on offer: {offer.service}{origin}: {reason}", highlight=False, markup=False)
    for neighbour in neighbours:
        if neighbour.away_since is not None:
            text = neighbour_text(neighbour, terminal.clock)
            terminal.console().print(f"{neighbour.name} at {neighbour.address}: {text}", highlight=False, markup=False)


async def query(formula: str, limit: int, data: Path, *, json: bool) -> int:
    """Print the bindings for which the formula holds. Returns the exit status: 0 if there are any."""
    async with Client(await site_addresses(data)) as client:
        result = await client.query(formula, limit)
    if json:
        terminal.print_json([row.bindings for row in result.rows])
    elif not result.rows:
        print("no: it does not hold")
    elif not result.rows[0].bindings:
        print("yes: it holds")
    else:
        columns = list(result.rows[0].bindings)
        terminal.console().print(
            terminal.table(formula, [f"?{c}" for c in columns], ([row.bindings[c] for c in columns] for row in result.rows))
        )
        if result.more:
            print(f"there are more than {limit} results; a higher --limit shows more")
    return 0 if result.rows else 1


async def show_object(name: str, data: Path, *, json: bool) -> None:
    from somrs.entish.parse import nearest

    async with Client(await site_addresses(data)) as client:
        map, ontology = await client.map(), await client.ontology()
        discovered = (await client.history(name, limit=1)).discovered if name in map.objects else None
    if name not in map.objects:
        raise UsageError(f"there is no {name} on the map; {nearest(name, map.similar_names(name)) or '`somrs map query` finds objects'}")
    object, facts = map.objects[name], [str(fact) for fact in map.facts_about(name)]
    if json:
        terminal.print_json({"name": name, "type": object.type, "values": object.values, "facts": facts, "discovered": discovered})
        return
    console = terminal.console()
    attributes = ontology.attributes_of(object.type)
    units = {path: f" {attribute.unit}" for path, attribute in attributes.items() if attribute.unit is not None}
    rows = [(path, f"{value}{units.get(path, '')}") for path, value in sorted(object.values.items())]
    console.print(terminal.table(f"{name}: {object.type}", ("attribute", "value"), rows))
    for fact in facts:
        console.print(fact)
    if discovered is not None:
        console.print(terminal.discovered(discovered))


async def history(name: str, limit: int, before_version: int | None, data: Path, *, json: bool) -> None:
    from somrs.cli.edit_commands import describe_event

    async with Client(await site_addresses(data)) as client:
        page = await client.history(name, limit, before_version)
    if json:
        terminal.print_json(page.events)
        return
    rows = ((event.version, terminal.clock(event.at), person_name(event.author), "\n".join(describe_event(event))) for event in page.events)
    terminal.console().print(
        terminal.table(name, ("version", "time", "author", "change"), rows) if page.events else f"{name} has no earlier history"
    )
    if page.discovered is not None:
        print(terminal.discovered(page.discovered))
    if page.more:
        print(f"there are more before version {page.events[-1].version}; --before {page.events[-1].version} shows them")


async def update(situation: str | None, added: Sequence[str], removed: Sequence[str], author: str, data: Path) -> None:
    changes: list[Change] = [*map(_added_object, added), *map(ObjectRemoved, removed)]
    if situation is None and not changes:
        raise UsageError("there is nothing to change; state a situation, such as 'Jar001 isOn Table001', or use --add or --remove")
    async with Client(await site_addresses(data)) as client:
        updated = await client.report(UpdateMap(changes=tuple(changes), situation=situation, author=author))
    for variable, name in updated.reception.names.items() if updated.reception is not None else ():
        print(f"?{variable} is {name}{', new on the map' if updated.reception and name in updated.reception.added else ''}")
    for variable in updated.reception.unidentified if updated.reception is not None else ():
        print(f"?{variable} is left out: it may be an object that somebody holds or has moved since, or a device that has not joined")
    print(f"the map is at version {updated.version}")


def _added_object(text: str) -> ObjectAdded:
    name, colon, type = (part.strip() for part in text.partition(":"))
    if not (name and colon and type):
        raise UsageError(f"--add takes NAME:TYPE, such as Jar009:Jar, and not {text!r}")
    return ObjectAdded(Object(name=name, type=type))


async def export(output: Path, data: Path, sources: Sequence[Path] = ()) -> None:
    """Write the map of the running system, or of the source files, in the format that the name of the output says."""
    from somrs.ontology.files.loading import load
    from somrs.ontology.files.site import dump_site

    if sources:
        loaded = load(sources)
        if loaded.map is None:
            raise UsageError(f"{', '.join(map(str, sources))}: there is no map in it")
        ontology, site_map = loaded.ontology, loaded.map
    else:
        async with Client(await site_addresses(data)) as client:
            ontology, site_map = await client.ontology(), await client.map()
    if output.name.endswith((".lif", ".lif.json")):
        from somrs.sites.lif import export_layouts

        layouts = export_layouts(ontology, site_map, exported_at=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"))
        output.write_bytes(layouts)
        print(f"{output}: the lanes of the map, in the Layout Interchange Format")
        return
    output.write_text(dump_site(ontology, site_map), encoding="utf-8")
    print(f"{output}: {len(site_map.objects)} objects")


async def fault(robot: str, fault_name: str, repair: bool, data: Path) -> None:
    from somrs.client.simulator_link import operator_link
    from somrs.devices.simulator.link.commands import Fault

    async with operator_link(Addresses.read(data)) as operator:
        await (operator.repair if repair else operator.fault)(robot, Fault(fault_name))
    print(f"{robot}: {fault_name} {'repaired' if repair else 'broken'}")


async def picture(output: Path, subject: str | None, data: Path) -> None:
    from somrs.client.simulator_link import operator_link

    async with operator_link(Addresses.read(data)) as operator:
        output.write_bytes(await operator.picture(subject))
    print(output)
