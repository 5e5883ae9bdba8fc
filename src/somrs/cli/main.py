"""The `somrs` command. Each command imports what it needs when it runs, so that `--help` is fast."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Annotated

import typer
from typer.main import get_command

from somrs.cli.access import audit_app, token_app, user_app
from somrs.cli.control import control_app
from somrs.cli.map_commands import map_app
from somrs.cli.ontology import ontology_app
from somrs.cli.options import (
    DEFAULT_FOLDER,
    LOOPBACK,
    SECURE,
    ArcosOption,
    BusOption,
    Certificates,
    Data,
    DevicesPerProcess,
    DriverOption,
    FirstPort,
    Formula,
    Fresh,
    HostOption,
    Json,
    MqttOption,
    Neighbours,
    Oidc,
    OwnBusOption,
    Registries,
    Secure,
    SharedSimulator,
    Simulates,
    SiteFiles,
    SiteName,
    Speed,
    TaskManagers,
    UpCommand,
    Vda5050Option,
    WorldOption,
    awaited,
    fail,
    guarded,
)
from somrs.cli.orders import orders_app, templates_app
from somrs.cli.ros2 import ros2_app
from somrs.cli.run import addresses_of, run_app
from somrs.cli.task_options import PolicyOption
from somrs.cli.tasks import tasks_app
from somrs.cli.things import thing_app
from somrs.cli.trust import trust_app
from somrs.cli.zones import zones_app
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.version import __version__

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.add_typer(map_app, name="map")
app.add_typer(ontology_app, name="ontology")
app.add_typer(tasks_app)
app.add_typer(control_app)
app.add_typer(zones_app)
app.add_typer(templates_app, name="templates")
app.add_typer(orders_app, name="orders")
app.add_typer(user_app, name="user")
app.add_typer(token_app, name="token")
app.add_typer(audit_app, name="audit")
app.add_typer(run_app, name="run")
app.add_typer(ros2_app, name="ros2")
app.add_typer(thing_app, name="thing")
app.add_typer(trust_app, name="trust", help="Certificates of the site: who is who.")


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"somrs {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)] = False,
) -> None:
    """SO-MRS: robots and devices accomplish tasks, which are submitted as formulas."""


class FaultOption(StrEnum):
    """The faults of a simulated device."""

    drive = "drive"
    gripper = "gripper"
    silent = "silent"
    link = "link"


@app.command()
def demo(
    scenario: Annotated[
        str,
        typer.Argument(
            help="1: no faults. 1b: the drive of the first robot breaks. 2: recovery from several faults. 3: several devices and a person. "
            "4: two storeys, and a lift that breaks. 5: two organisations, and a host that is lost for good. "
            "6: robots and a door of five protocols, of which one breaks."
        ),
    ] = "1b",
    out: Annotated[Path | None, typer.Option(help="The folder for pictures, messages and maps.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed for random start positions, and a random time of the fault.")] = None,
    arcos: Annotated[bool, typer.Option("--arcos", help="Drive the robots of scenarios 1 and 1b by ARCOS, in real time.")] = False,
) -> None:
    """Run a scenario of the paper in the simulator."""
    from somrs.deployment.launcher import Launcher, fork_launcher

    launcher_process = fork_launcher()  # before numpy starts threads
    from somrs.demo.scenarios import play

    sys.exit(awaited(play(scenario, out or Path("out") / f"scenario-{scenario}", seed, launcher=Launcher(launcher_process), arcos=arcos)))


@app.command(cls=UpCommand)
def up(
    site: SiteFiles = None,
    data: Data = DEFAULT_FOLDER,
    speed: Speed = "1",
    world: WorldOption = WorldKind.PHYSICS,
    simulator: Simulates = True,
    shared_simulator: SharedSimulator = None,
    host: HostOption = LOOPBACK,
    fresh: Fresh = False,
    devices_per_process: DevicesPerProcess = None,
    task_managers: TaskManagers = None,
    registries: Registries = None,
    bus: OwnBusOption = None,
    mqtt: MqttOption = None,
    name: SiteName = None,
    neighbours: Neighbours = None,
    first_port: FirstPort = None,
    driver: DriverOption = [],  # noqa: B006  # as below
    secure: Secure = SECURE,
    oidc: Oidc = None,
    certificates: Certificates = None,
    vda5050: Vda5050Option = None,
    arcos: ArcosOption = False,
) -> None:
    """Start a system for a site, each component as a process. Ctrl-C stops it."""
    from somrs.cli.commands import run_system, site_to_run
    from somrs.deployment.launcher import Launcher, fork_launcher

    sources = guarded(lambda: site_to_run(site or [], data, fresh=fresh))
    launcher_process = fork_launcher()  # before numpy starts threads
    from somrs.deployment.system import System

    def make_system(files: Sequence[Path]) -> System:
        return System(
            files,
            data,
            speed=speed,
            world=world,
            simulates=simulator,
            world_address=shared_simulator,
            host=host,
            windows=True,
            launcher=Launcher(launcher_process),
            devices_per_process=devices_per_process,
            task_managers=task_managers,
            registries=registries,
            bus=bus,
            mqtt=mqtt,
            name=name,
            neighbours=neighbours,
            first_port=first_port,
            drivers=driver,
            secure=secure,
            oidc=oidc,
            certificates=certificates,
            adapters={"vda5050": {"broker": vda5050}} if vda5050 is not None else {},
            arcos=arcos,
        )

    awaited(run_system(sources, data, make_system, fresh=fresh))


@app.command()
def services(
    type: Annotated[str | None, typer.Option(help="Only services of this type or a subtype.")] = None,
    effect: Annotated[str | None, typer.Option(help="Only services that can achieve this formula.")] = None,
    attribute: Annotated[list[str], typer.Option(help="Only services with this value, such as Payload=2.")] = [],  # noqa: B006  # as below
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the services on offer."""
    from somrs.cli.commands import services as run

    awaited(run(type, effect, attribute, data, json=json))


@app.command()
def backup(
    file: Annotated[Path, typer.Argument(help="The file to write, such as somrs-2026-11-28.tar.gz.")], data: Data = DEFAULT_FOLDER
) -> None:
    """Back up the data folder: tasks, maps and their history. The system may run."""
    from somrs.deployment.backup import back_up

    awaited(back_up(data, file))
    print(f"{file}: the backup of {data}. To use it: somrs restore {file} --data FOLDER")


@app.command()
def restore(file: Annotated[Path, typer.Argument(help="A backup.")], data: Data = DEFAULT_FOLDER) -> None:
    """Make a data folder from a backup."""
    from somrs.deployment.backup import restore as run

    manifest = guarded(lambda: run(file, data))
    print(f"{data}: {len(manifest.files)} files of {manifest.program}. Next: somrs up --data {data}")


@app.command()
def status(data: Data = DEFAULT_FOLDER, bus: BusOption = None, name: SiteName = None, json: Json = False) -> None:
    """Show which components run. On a bus: on which host, who leads, and how far behind the standbys are."""
    from somrs.cli.status import status as run

    awaited(run(guarded(lambda: addresses_of(data, bus, name)), data, json=json))


@app.command()
def fleet(
    follow: Annotated[bool, typer.Option("--follow", help="Update the list as it changes, until Ctrl-C.")] = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the devices. Shows the work, utilisation, battery and faults of each device, and the reliability of its services."""
    from somrs.cli.fleet import fleet as run

    if follow and json:
        fail("--json prints the fleet once; to follow it, programs use the API's WebSocket", 2)
    awaited(run(data, follow=follow, json=json))


@app.command()
def questions(data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the questions that wait for an answer by a person."""
    from somrs.cli.questions import questions as run

    guarded(lambda: run(data, json=json))


@app.command()
def answer(
    number: Annotated[int, typer.Argument(help="The question's number.")],
    formula: Annotated[str | None, typer.Argument(help="The answer as a formula, such as 'Jar002 isOn Table001'.")] = None,
    is_unknown: Annotated[bool, typer.Option("--cannot-tell", help="Answer that you do not know.")] = False,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Answer a question of the system."""
    from somrs.cli.questions import answer as run

    if (formula is None) is not is_unknown:
        fail("an answer is either a formula or --cannot-tell", 2)
    guarded(lambda: run(number, formula, data))


@app.command()
def people(data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the people who do steps of tasks, their pages, and what they are asked to do."""
    from somrs.cli.people import people as run

    awaited(run(data, json=json))


@app.command()
def reply(
    number: Annotated[int, typer.Argument(help="The assignment's number.")],
    kind: Annotated[str, typer.Argument(help="accept, decline, not-now, done or could-not.")],
    because: Annotated[str, typer.Option("--because", help="The reason, for people.")] = "",
    situation: Annotated[
        str | None, typer.Option(help="With could-not, or done: what holds now, such as '?Seen: Jar isOn Floor001 AND ?Seen.Color = Red'.")
    ] = None,
    searched: Annotated[list[str], typer.Option(help="With done: a place that was seen whole; nothing else is there.")] = [],  # noqa: B006  # as above
    value: Annotated[list[str], typer.Option(help="With done: a value that the work has found out, such as Weight='1.2 kg'.")] = [],  # noqa: B006  # as above
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Reply to an assignment of a person."""
    from somrs.cli.people import reply as run
    from somrs.devices.person.assignments import ReplyKind

    kinds = {kind.value.replace(" ", "-"): kind for kind in ReplyKind}
    if kind not in kinds:
        fail(f"a reply is {', '.join(kinds)}, and not {kind}", 2)
    guarded(lambda: run(number, kinds[kind], because, situation, value, searched, data))


@app.command()
def plan(
    formula: Formula,
    precondition: Annotated[str | None, typer.Option(help="A formula that has to hold initially.")] = None,
    quotes: Annotated[bool, typer.Option("--quotes", help="Request the services' current terms, without contracts.")] = False,
    policy: Annotated[PolicyOption, typer.Option(help="With --quotes: how services are chosen.")] = PolicyOption.price,
    time_value: Annotated[float, typer.Option(help="With --policy weighted: what a second is worth, in EUR.")] = 0.01,
    deadline: Annotated[float | None, typer.Option(help="With --quotes: seconds within which the task has to be accomplished.")] = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Show the plan for a goal without executing it. Shows why there is none if planning fails."""
    from somrs.cli.preview import plan as run
    from somrs.protocol.messages.previews import Preview
    from somrs.protocol.messages.submission import Policy

    request = Preview(
        effect=formula, precondition=precondition, quotes=quotes, policy=Policy(policy.value), time_value=time_value, deadline=deadline
    )
    sys.exit(awaited(run(request, data, json=json)))


@app.command()
def check(files: Annotated[list[Path], typer.Argument(help="Ontology and map files.")], json: Json = False) -> None:
    """Check ontology and map files, and list all errors."""
    from somrs.cli.commands import check as run

    sys.exit(guarded(lambda: run(files, json=json)))


@app.command(name="import")
def import_(
    source: Annotated[
        list[Path], typer.Argument(help="A building (Open-RMF's *.building.yaml; *.lif; ROS' map.yaml), or a PDDL domain and its problem.")
    ],
    output: Annotated[Path | None, typer.Option("--out", "-o", help="The map file to write.")] = None,
    sizes: Annotated[Path | None, typer.Option("--sizes", help="A YAML file that says what models stand for, and their sizes.")] = None,
    crowds: Annotated[bool, typer.Option("--crowds", help="Import the people of simulated crowds, too, and their lanes.")] = False,
    details: Annotated[bool, typer.Option("--details", help="Name every object in the notes.")] = False,
) -> None:
    """Import a building or a planning problem as a map file."""
    from somrs.cli.import_commands import import_site as run

    guarded(lambda: run(source, output, sizes=sizes, crowds=crowds, details=details))


@app.command()
def schema(
    output: Annotated[Path | None, typer.Option("--out", "-o", help="The file to write; by default, it is printed.")] = None,
) -> None:
    """Print the JSON Schema of ontology and map files, for editors."""
    from somrs.cli.commands import schema as run

    guarded(lambda: run(output))


@app.command()
def fault(
    robot: Annotated[str, typer.Argument(help="The simulated robot, lift, door or other device.")],
    what: Annotated[FaultOption, typer.Argument(help="The fault.")],
    repair: Annotated[bool, typer.Option("--repair", help="Remove the fault.")] = False,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Inject a fault into a simulated device, or remove it."""
    from somrs.cli.commands import fault as run

    awaited(run(robot, what.value, repair, data))


@app.command()
def picture(
    out: Annotated[Path, typer.Argument(help="The PNG file to write.")],
    of: Annotated[str | None, typer.Option(help="An object, or a storey as seen from above; by default, the building.")] = None,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Save a picture of the simulated world as it is now."""
    from somrs.cli.commands import picture as run

    awaited(run(out, of, data))


@cache
def command() -> Callable[..., object]:
    """The command and all its subcommands, cached: building it is slow, and the launcher builds it before it forks programs."""
    return get_command(app)


def main() -> None:
    command()(prog_name="somrs")


if __name__ == "__main__":
    main()
