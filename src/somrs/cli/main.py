"""The `somrs` command. What a command needs is imported when it runs: `--help` is there at once."""

from __future__ import annotations

import sys
from collections.abc import Callable
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Annotated

import typer
from typer.main import get_command

from somrs.cli.ontology import DEFAULT_AUTHOR, Author, BeforeOption, Dry, Limit, ontology_app, undo
from somrs.cli.options import DEFAULT_FOLDER, LOOPBACK, Data, Formula, HostOption, Json, awaited, fail, guarded
from somrs.cli.orders import orders_app, templates_app
from somrs.cli.run import run_app
from somrs.cli.tasks import PolicyOption, tasks_app

app = typer.Typer(
    help="SO-MRS: robots and devices accomplish tasks that are stated as formulas about a building.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
map_app = typer.Typer(help="Ask and change the map that the Repository keeps.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(map_app, name="map")
app.add_typer(ontology_app, name="ontology")
app.add_typer(tasks_app)
app.add_typer(templates_app, name="templates")
app.add_typer(orders_app, name="orders")
app.add_typer(run_app, name="run")


class FaultOption(StrEnum):
    """What can be broken."""

    drive = "drive"
    gripper = "gripper"
    silent = "silent"
    link = "link"


@app.command()
def demo(
    scenario: Annotated[
        str, typer.Argument(help="1: all goes well. 1b: the drive of the first robot breaks. 2: what a transaction survives.")
    ] = "1b",
    out: Annotated[Path | None, typer.Option(help="Where pictures, messages and maps go.")] = None,
    seed: Annotated[int | None, typer.Option(help="Start at random places, and break the drive at a random moment.")] = None,
) -> None:
    """Play a scenario of the paper in the simulator."""
    from somrs.deployment.launcher import Launcher, fork_launcher

    launcher_process = fork_launcher()  # before there are threads, as numpy has them
    from somrs.demo.scenarios import play

    sys.exit(awaited(play(scenario, out or Path("out") / f"scenario-{scenario}", seed, launcher=Launcher(launcher_process))))


@app.command()
def up(
    site: Annotated[list[Path], typer.Argument(help="A site: map and ontology files, or a building to import.")],
    data: Data = DEFAULT_FOLDER,
    speed: Annotated[str, typer.Option(help="Of simulated time: 1 is real time, `max` as fast as it goes.")] = "1",
    host: HostOption = LOOPBACK,
    fresh: Annotated[bool, typer.Option("--fresh", help="Forget the map of an earlier run; begin with the site's.")] = False,
) -> None:
    """Start a whole system for a site: every part a process of its own. Ctrl-C ends it."""
    from somrs.cli.commands import check_files
    from somrs.cli.commands import run_system as run
    from somrs.deployment.launcher import Launcher, fork_launcher

    guarded(lambda: check_files(site))
    launcher_process = fork_launcher()
    awaited(run(site, data, speed, host, fresh, Launcher(launcher_process)))


@app.command()
def services(
    type: Annotated[str | None, typer.Option(help="Of this service type, or a sub-type.")] = None,
    effect: Annotated[str | None, typer.Option(help="That can bring this formula about.")] = None,
    attribute: Annotated[list[str], typer.Option(help="With this value of an attribute, such as Payload=2.")] = [],  # noqa: B006  # as below
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """The services on offer now."""
    from somrs.cli.commands import services as run

    awaited(run(type, effect, attribute, data, json=json))


@app.command()
def fleet(
    follow: Annotated[bool, typer.Option("--follow", help="Go on showing it as it changes, until Ctrl-C.")] = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """The devices. What each does, its load and battery, how its services have done so far, and its faults."""
    from somrs.cli.fleet import fleet as run

    if follow and json:
        fail("--json prints once; programs that follow the fleet use the API's WebSocket", 2)
    awaited(run(data, follow=follow, json=json))


@app.command()
def questions(data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """What the system asks people now, because nobody else can look."""
    from somrs.cli.questions import questions as run

    guarded(lambda: run(data, json=json))


@app.command()
def answer(
    number: Annotated[int, typer.Argument(help="The question's number.")],
    formula: Annotated[str | None, typer.Argument(help="What is so, as a formula, such as 'Jar002 isOn Table001'.")] = None,
    is_unknown: Annotated[bool, typer.Option("--cannot-tell", help="You do not know.")] = False,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Answer a question that the system asks a person."""
    from somrs.cli.questions import answer as run

    if (formula is None) is not is_unknown:
        fail("an answer is either a formula or --cannot-tell", 2)
    guarded(lambda: run(number, formula, data))


@app.command()
def plan(
    formula: Formula,
    precondition: Annotated[str | None, typer.Option(help="The initial situation, if it matters.")] = None,
    quotes: Annotated[
        bool, typer.Option("--quotes", help="Ask services what they would want for it now; nobody commits to anything.")
    ] = False,
    policy: Annotated[PolicyOption, typer.Option(help="With --quotes: what services are chosen by.")] = PolicyOption.price,
    time_value: Annotated[float, typer.Option(help="With the policy `weighted`: what a second is worth.")] = 0.01,
    deadline: Annotated[float | None, typer.Option(help="With --quotes: it has to be done within so many seconds.")] = None,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """The plan for a formula, without carrying it out; or why there is none."""
    from somrs.cli.preview import plan as run
    from somrs.protocol.messages.clients import Policy, Preview

    request = Preview(
        effect=formula, precondition=precondition, quotes=quotes, policy=Policy(policy.value), time_value=time_value, deadline=deadline
    )
    sys.exit(awaited(run(request, data, json=json)))


@app.command()
def check(files: Annotated[list[Path], typer.Argument(help="Ontology and map files.")], json: Json = False) -> None:
    """Check ontologies and maps; show every error at once."""
    from somrs.cli.commands import check as run

    sys.exit(guarded(lambda: run(files, json=json)))


@app.command(name="import")
def import_(
    source: Annotated[list[Path], typer.Argument(help="A building (Open-RMF's SITE.building.yaml), or a PDDL domain and its problem.")],
    output: Annotated[Path | None, typer.Option("--out", "-o", help="The map file to write.")] = None,
) -> None:
    """Bring in an existing building, or a planning problem, as a map."""
    from somrs.cli.import_commands import import_site as run

    guarded(lambda: run(source, output))


@app.command()
def schema(output: Annotated[Path | None, typer.Option("--out", "-o", help="The file to write; otherwise it is printed.")] = None) -> None:
    """The JSON Schema of ontology and map files, for editors that complete and check them."""
    from somrs.cli.commands import schema as run

    guarded(lambda: run(output))


@app.command()
def fault(
    robot: Annotated[str, typer.Argument(help="The simulated robot.")],
    what: Annotated[FaultOption, typer.Argument(help="What breaks.")],
    repair: Annotated[bool, typer.Option("--repair", help="Mend it instead.")] = False,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Break something of a simulated robot, or mend it."""
    from somrs.cli.commands import fault as run

    awaited(run(robot, what.value, repair, data))


@app.command()
def picture(out: Annotated[Path, typer.Argument(help="The PNG file to write.")], data: Data = DEFAULT_FOLDER) -> None:
    """A picture of the simulated world as it is now."""
    from somrs.cli.commands import picture as run

    awaited(run(out, data))


@map_app.command()
def query(
    formula: Formula, limit: Annotated[int, typer.Option(help="At most so many.")] = 100, data: Data = DEFAULT_FOLDER, json: Json = False
) -> None:
    """For which objects does a formula hold? Exits with 1 when for none."""
    from somrs.cli.commands import query as run

    sys.exit(awaited(run(formula, limit, data, json=json)))


@map_app.command()
def show(name: Annotated[str, typer.Argument(help="An object of the map.")], data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """What is known of an object."""
    from somrs.cli.commands import show_object as run

    awaited(run(name, data, json=json))


@map_app.command()
def history(name: Annotated[str, typer.Argument(help="An object of the map.")], data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """What happened to an object, newest first."""
    from somrs.cli.commands import history as run

    awaited(run(name, data, json=json))


@map_app.command()
def update(
    situation: Annotated[str, typer.Argument(help="What is so now, as a formula.")],
    author: Annotated[str, typer.Option(help="Who says so.")] = "somebody at the command line",
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Put a situation on the map."""
    from somrs.cli.commands import update as run

    awaited(run(situation, author, data))


@map_app.command()
def events(limit: Limit = 20, before: BeforeOption = None, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """What happened to the map and the ontology, newest first: by whom, when, and what."""
    from somrs.cli.edit_commands import history as run

    awaited(run(limit, data, ontology=False, before_version=before, json=json))


map_app.command()(undo)


@map_app.command()
def rename(
    name: Annotated[str, typer.Argument(help="An object of the map.")],
    to: Annotated[str, typer.Argument(help="What it is to be called.")],
    author: Author = DEFAULT_AUTHOR,
    dry: Dry = False,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Give an object another name, everywhere where it is spoken of."""
    from somrs.cli.edit_commands import alter
    from somrs.protocol.messages.knowledge import RenameObject

    sys.exit(awaited(alter(RenameObject(name=name, to=to, author=author), data, dry=dry, json=json)))


@map_app.command()
def export(out: Annotated[Path, typer.Argument(help="The YAML file to write.")], data: Data = DEFAULT_FOLDER) -> None:
    """Write the map as it is now to a file."""
    from somrs.cli.commands import export as run

    awaited(run(out, data))


@cache
def command() -> Callable[..., object]:
    """The command with all that is below it. To make it takes longer than to understand a line: programs are forked when it is made."""
    return get_command(app)


def main() -> None:
    command()(prog_name="somrs")


if __name__ == "__main__":
    main()
