"""The `somrs` command. What a command needs is imported when it runs: `--help` is there at once."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Coroutine
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from somrs.errors import InputError, SomrsError

app = typer.Typer(
    help="SO-MRS: robots and devices accomplish tasks that are stated as formulas about a building.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
map_app = typer.Typer(help="Ask and change the map that the Repository keeps.", no_args_is_help=True, rich_markup_mode=None)
run_app = typer.Typer(help="Run one part of a system by itself.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(map_app, name="map")
app.add_typer(run_app, name="run")

Data = Annotated[Path, typer.Option("--data", envvar="SOMRS_DATA", help="The folder of the running system.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
HostOption = Annotated[str, typer.Option("--host", help="The address to listen at.")]
PortOption = Annotated[int, typer.Option("--port", help="The port to listen at; 0 takes a free one.")]
Formula = Annotated[str, typer.Argument(help="An Entish formula, such as 'Jar002 isOn Platform001'.")]
HERE = Path(".somrs")
LOOPBACK = "127.0.0.1"


class PolicyOption(StrEnum):
    """How services are chosen."""

    price = "price"
    time = "time"
    weighted = "weighted"


class FaultOption(StrEnum):
    """What can be broken."""

    drive = "drive"
    gripper = "gripper"
    silent = "silent"
    link = "link"


@app.command()
def demo(
    scenario: Annotated[str, typer.Argument(help="1: all goes well. 1b: the drive of the first robot breaks.")] = "1b",
    out: Annotated[Path | None, typer.Option(help="Where pictures, messages and maps go.")] = None,
    seed: Annotated[int | None, typer.Option(help="Start at random places, and break the drive at a random moment.")] = None,
) -> None:
    """Play a scenario of the paper in the simulator."""
    from somrs.app.demo import play

    sys.exit(_run(play(scenario, out or Path("out") / f"scenario-{scenario}", seed)))


@app.command()
def up(
    site: Annotated[list[Path], typer.Argument(help="A site: map and ontology files, or a building to import.")],
    data: Data = HERE,
    speed: Annotated[str, typer.Option(help="Of simulated time: 1 is real time, `max` as fast as it goes.")] = "1",
    host: HostOption = LOOPBACK,
    fresh: Annotated[bool, typer.Option("--fresh", help="Forget the map of an earlier run; begin with the site's.")] = False,
) -> None:
    """Start a whole system for a site: every part a process of its own. Ctrl-C ends it."""
    from somrs.app.commands import up as run

    _run(run(site, data, speed, host, fresh))


@app.command()
def task(
    formula: Formula,
    precondition: Annotated[str | None, typer.Option(help="The initial situation, if it matters.")] = None,
    policy: Annotated[PolicyOption, typer.Option(help="What services are chosen by.")] = PolicyOption.price,
    time_value: Annotated[float, typer.Option(help="With `weighted`: what a second is worth.")] = 0.01,
    deadline: Annotated[float | None, typer.Option(help="Give up after so many seconds.")] = None,
    wait: Annotated[bool, typer.Option(help="Stay until the task ended.")] = True,
    data: Data = HERE,
    json: Json = False,
) -> None:
    """Make a formula true. Shows the plan, who does what, and how it ends."""
    from somrs.app.commands import task as run
    from somrs.protocol.clients import Policy, Submit

    wish = Submit(effect=formula, precondition=precondition, policy=Policy(policy.value), time_value=time_value, deadline=deadline)
    sys.exit(_run(run(wish, data, wait=wait, json=json)))


@app.command()
def tasks(data: Data = HERE, json: Json = False) -> None:
    """The tasks of the running system."""
    from somrs.app.commands import tasks as run

    _run(run(data, json=json))


@app.command()
def cancel(
    task: Annotated[str, typer.Argument(help="The task's id, or its beginning.")],
    reason: Annotated[str, typer.Option(help="Why.")] = "cancelled by the client",
    data: Data = HERE,
) -> None:
    """Stop a task."""
    from somrs.app.commands import cancel as run

    _run(run(task, reason, data))


@app.command()
def services(
    type: Annotated[str | None, typer.Option(help="Of this service type, or a sub-type.")] = None,
    effect: Annotated[str | None, typer.Option(help="That can bring this formula about.")] = None,
    attribute: Annotated[list[str], typer.Option(help="With this value of an attribute, such as Payload=2.")] = [],  # noqa: B006  # as below
    data: Data = HERE,
    json: Json = False,
) -> None:
    """The services on offer now."""
    from somrs.app.commands import services as run

    _run(run(type, effect, attribute, data, json=json))


@app.command()
def questions(data: Data = HERE, json: Json = False) -> None:
    """What the system asks people now, because nobody else can look."""
    from somrs.app.answering import questions as run

    _guarded(lambda: run(data, json=json))


@app.command()
def answer(
    number: Annotated[int, typer.Argument(help="The question's number.")],
    formula: Annotated[str | None, typer.Argument(help="What is so, as a formula, such as 'Jar002 isOn Table001'.")] = None,
    cannot_tell: Annotated[bool, typer.Option("--cannot-tell", help="You do not know.")] = False,
    data: Data = HERE,
) -> None:
    """Answer a question that the system asks a person."""
    from somrs.app.answering import answer as run

    if (formula is None) is not cannot_tell:
        _fail("an answer is either a formula or --cannot-tell", 2)
    _guarded(lambda: run(number, formula, data))


@app.command()
def plan(
    formula: Formula,
    precondition: Annotated[str | None, typer.Option(help="The initial situation, if it matters.")] = None,
    data: Data = HERE,
    json: Json = False,
) -> None:
    """The plan for a formula, without carrying it out; or why there is none."""
    from somrs.app.commands import plan as run

    sys.exit(_run(run(formula, precondition, data, json=json)))


@app.command()
def check(files: Annotated[list[Path], typer.Argument(help="Ontology and map files.")], json: Json = False) -> None:
    """Check ontologies and maps; show every error at once."""
    from somrs.app.commands import check as run

    sys.exit(_guarded(lambda: run(files, json=json)))


@app.command(name="import")
def import_(
    source: Annotated[Path, typer.Argument(help="A building, such as an Open-RMF SITE.building.yaml.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The map file to write.")] = None,
) -> None:
    """Bring in an existing building as a map."""
    from somrs.app.commands import import_site as run

    _guarded(lambda: run(source, out))


@app.command()
def schema(out: Annotated[Path | None, typer.Option("--out", "-o", help="The file to write; otherwise it is printed.")] = None) -> None:
    """The JSON Schema of ontology and map files, for editors that complete and check them."""
    from somrs.app.commands import schema as run

    _guarded(lambda: run(out))


@app.command()
def fault(
    robot: Annotated[str, typer.Argument(help="The simulated robot.")],
    what: Annotated[FaultOption, typer.Argument(help="What breaks.")],
    repair: Annotated[bool, typer.Option("--repair", help="Mend it instead.")] = False,
    data: Data = HERE,
) -> None:
    """Break something of a simulated robot, or mend it."""
    from somrs.app.commands import fault as run

    _run(run(robot, what.value, repair, data))


@app.command()
def picture(out: Annotated[Path, typer.Argument(help="The PNG file to write.")], data: Data = HERE) -> None:
    """A picture of the simulated world as it is now."""
    from somrs.app.commands import picture as run

    _run(run(out, data))


@map_app.command()
def query(
    formula: Formula, limit: Annotated[int, typer.Option(help="At most so many.")] = 100, data: Data = HERE, json: Json = False
) -> None:
    """For which objects does a formula hold? Exits with 1 when for none."""
    from somrs.app.commands import query as run

    sys.exit(_run(run(formula, limit, data, json=json)))


@map_app.command()
def show(name: Annotated[str, typer.Argument(help="An object of the map.")], data: Data = HERE, json: Json = False) -> None:
    """What is known of an object."""
    from somrs.app.commands import show_object as run

    _run(run(name, data, json=json))


@map_app.command()
def history(name: Annotated[str, typer.Argument(help="An object of the map.")], data: Data = HERE, json: Json = False) -> None:
    """What happened to an object, newest first."""
    from somrs.app.commands import history as run

    _run(run(name, data, json=json))


@map_app.command()
def update(
    situation: Annotated[str, typer.Argument(help="What is so now, as a formula.")],
    author: Annotated[str, typer.Option(help="Who says so.")] = "somebody at the command line",
    data: Data = HERE,
) -> None:
    """Put a situation on the map."""
    from somrs.app.commands import update as run

    _run(run(situation, author, data))


@map_app.command()
def export(out: Annotated[Path, typer.Argument(help="The YAML file to write.")], data: Data = HERE) -> None:
    """Write the map as it is now to a file."""
    from somrs.app.commands import export as run

    _run(run(out, data))


@run_app.command()
def repository(
    site: Annotated[list[Path], typer.Option(help="Map and ontology files to begin with.")] = [],  # noqa: B006  # typer's way to say a list
    data: Data = HERE,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
) -> None:
    """The Repository."""
    from somrs.app.programs import run_program, run_repository

    _guarded(lambda: run_program(run_repository(data, site, host, port)))


@run_app.command()
def registry(data: Data = HERE, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """The Service Registry."""
    from somrs.app.client import Addresses
    from somrs.app.programs import run_program, run_registry

    _guarded(lambda: run_program(run_registry(Addresses.read(data), host, port)))


@run_app.command(name="task-manager")
def task_manager(data: Data = HERE, host: HostOption = LOOPBACK, port: PortOption = 0) -> None:
    """A Task Manager."""
    from somrs.app.client import Addresses
    from somrs.app.programs import run_program, run_task_manager

    _guarded(lambda: run_program(run_task_manager(data, Addresses.read(data), host, port)))


@run_app.command()
def simulator(
    site: Annotated[list[Path], typer.Option(help="Make the world from these files' map, with no Repository.")] = [],  # noqa: B006  # as above
    data: Data = HERE,
    host: HostOption = LOOPBACK,
    port: PortOption = 0,
    speed: Annotated[str, typer.Option(help="Of simulated time: 1 is real time, `max` as fast as it goes.")] = "1",
) -> None:
    """The simulator; its world is made of the Repository's map."""
    from somrs.app.client import Addresses
    from somrs.app.programs import run_program, run_simulator, run_simulator_of_files, speed_of

    if site:
        _guarded(lambda: run_program(run_simulator_of_files(site, host, port, speed_of(speed))))
    else:
        _guarded(lambda: run_program(run_simulator(Addresses.read(data), host, port, speed_of(speed))))


@run_app.command()
def device(
    driver: Annotated[str, typer.Argument(help="The device's class: `module:Class` or `file.py:Class`.")],
    name: Annotated[str, typer.Option(help="The device's object on the map.")],
    data: Data = HERE,
    host: HostOption = LOOPBACK,
) -> None:
    """The Service Manager of a device."""
    from somrs.app.device import run_driver

    _guarded(lambda: run_driver(driver, name, data, host))


def _run(main: Coroutine[Any, Any, Any]) -> Any:
    return _guarded(lambda: asyncio.run(main))


def _guarded(run: Any) -> Any:
    """Run it; a mistake of the user's is told in words, without a stack trace."""
    try:
        return run()
    except InputError as error:
        _fail(str(error), 2)
    except SomrsError as error:
        _fail(str(error), 1)
    except OSError as error:
        if error.filename is None:
            raise
        _fail(f"{error.filename}: {error.strerror}", 2)
    except KeyboardInterrupt:
        sys.exit(130)


def _fail(text: str, code: int) -> NoReturn:
    typer.echo(text, err=True)
    sys.exit(code)


def main() -> None:
    app()


if __name__ == "__main__":
    main()
