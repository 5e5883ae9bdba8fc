"""The commands about task templates and standing orders."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from somrs.cli.options import DEFAULT_FOLDER, Data, Json, Priority, Unavailable, UnavailableOption, awaited, guarded
from somrs.cli.task_options import Deadline, PolicyOption, PolicyWanted, Precondition, TimeValue, stated_task
from somrs.protocol.messages.orders import OrderSaved, TemplateSaved

templates_app = typer.Typer(
    help="Templates: tasks for repeated use, with blanks to fill in. Without a command: list them.",
    invoke_without_command=True,
    rich_markup_mode=None,
)
orders_app = typer.Typer(
    help="Standing orders: tasks that the Scheduler submits at set times. Without a command: list them.",
    invoke_without_command=True,
    rich_markup_mode=None,
)

TemplateName = Annotated[str, typer.Argument(help="The template's name.")]
OrderName = Annotated[str, typer.Argument(help="The order's id, or its name.")]
Filling = Annotated[list[str], typer.Argument(help="Values of blanks: NAME=VALUE ...")]


@templates_app.callback()
def templates(context: typer.Context, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the templates of the running system."""
    from somrs.cli.order_commands import list_templates as run

    if context.invoked_subcommand is None:
        awaited(run(data, json=json))


@templates_app.command(name="save")
def save_template(
    name: TemplateName,
    formula: Annotated[str, typer.Argument(help="The goal, which may have blanks: '{Thing} isOn Platform001'.")],
    blank: Annotated[
        list[str], typer.Option(help="A blank and the type of its values: Thing:Jar, or Thing:Jar=Jar002 with a default.")
    ] = [],  # noqa: B006  # typer requires a list as the default
    note: Annotated[str, typer.Option(help="A description of the template.")] = "",
    precondition: Precondition = None,
    policy: PolicyWanted = PolicyOption.price,
    time_value: TimeValue = 0.01,
    deadline: Deadline = None,
    priority: Priority = 0,
    unavailable: Unavailable = UnavailableOption.wait,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Save a task as a template, or change the template of this name."""
    from somrs.cli.order_commands import author_name
    from somrs.cli.order_commands import parse_blank as declared
    from somrs.cli.order_commands import save_template as run

    task = stated_task(formula, precondition, policy, time_value, deadline, priority, unavailable)
    awaited(run(name, TemplateSaved(task=task, blanks=tuple(map(declared, blank)), note=note, by=author_name()), data))


@templates_app.command(name="use")
def use_template(
    name: TemplateName,
    fill: Filling = [],  # noqa: B006  # as above
    wait: Annotated[bool, typer.Option(help="Wait until the task has ended.")] = True,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """Fill in the blanks of a template and submit the task."""
    from somrs.cli.order_commands import use_template as run

    sys.exit(awaited(run(name, fill, data, wait=wait, json=json)))


@templates_app.command(name="rename")
def rename_template(name: TemplateName, to: Annotated[str, typer.Argument(help="Its new name.")], data: Data = DEFAULT_FOLDER) -> None:
    """Rename a template, also in the orders that use it."""
    from somrs.cli.order_commands import rename_template as run

    awaited(run(name, to, data))


@templates_app.command(name="remove")
def remove_template(name: TemplateName, data: Data = DEFAULT_FOLDER) -> None:
    """Remove a template that no order uses."""
    from somrs.cli.order_commands import remove_template as run

    awaited(run(name, data))


@orders_app.callback()
def orders(context: typer.Context, data: Data = DEFAULT_FOLDER, json: Json = False) -> None:
    """List the standing orders. Shows when each is next due, and the result of its last run."""
    from somrs.cli.order_commands import list_orders as run

    if context.invoked_subcommand is None:
        awaited(run(data, json=json))


@orders_app.command(name="add")
def add_order(
    name: Annotated[str, typer.Argument(help="The name of the order.")],
    formula: Annotated[str | None, typer.Argument(help="The goal; alternatively, give --template.")] = None,
    every: Annotated[str | None, typer.Option(help="Due at this interval, counted from now: 30m, 2h, 1d.")] = None,
    daily: Annotated[str | None, typer.Option(help="Due at this time of day: 07:30.")] = None,
    days: Annotated[str | None, typer.Option(help="With --daily: only on these days: Mon,Thu.")] = None,
    at: Annotated[str | None, typer.Option(help="Due once, at this time: 2026-11-24T08:00.")] = None,
    template: Annotated[str | None, typer.Option(help="Submit the task of this template.")] = None,
    fill: Annotated[list[str], typer.Option(help="With --template: the value of a blank: NAME=VALUE.")] = [],  # noqa: B006  # as above
    skip: Annotated[bool, typer.Option(help="Skip a run while the task of the previous run is still running.")] = True,
    precondition: Precondition = None,
    policy: PolicyWanted = PolicyOption.price,
    time_value: TimeValue = 0.01,
    deadline: Deadline = None,
    priority: Priority = 0,
    unavailable: Unavailable = UnavailableOption.wait,
    data: Data = DEFAULT_FOLDER,
) -> None:
    """Add a standing order."""
    from somrs.cli.order_commands import add_order as run
    from somrs.cli.order_commands import author_name, parse_recurrence, parse_values

    order = guarded(
        lambda: OrderSaved(
            name=name,
            when=parse_recurrence(every, daily, days, at),
            task=stated_task(formula, precondition, policy, time_value, deadline, priority, unavailable) if formula is not None else None,
            template=template,
            values=parse_values(fill),
            skip=skip,
            by=author_name(),
        )
    )
    awaited(run(order, data))


@orders_app.command(name="runs")
def show_runs(
    name: OrderName,
    limit: Annotated[int, typer.Option(min=1, max=1_000_000, help="Maximum number of runs.")] = 20,
    data: Data = DEFAULT_FOLDER,
    json: Json = False,
) -> None:
    """List the runs of an order: when it was due, and the result."""
    from somrs.cli.order_commands import show_runs as run

    awaited(run(name, limit, data, json=json))


@orders_app.command(name="pause")
def pause_order(name: OrderName, data: Data = DEFAULT_FOLDER) -> None:
    """Pause an order. A task of the order that is running continues."""
    from somrs.cli.order_commands import turn_order as run

    awaited(run(name, data, is_enabled=False))


@orders_app.command(name="resume")
def resume_order(name: OrderName, data: Data = DEFAULT_FOLDER) -> None:
    """Resume an order. Runs that were due during the pause are not made up for."""
    from somrs.cli.order_commands import turn_order as run

    awaited(run(name, data, is_enabled=True))


@orders_app.command(name="remove")
def remove_order(name: OrderName, data: Data = DEFAULT_FOLDER) -> None:
    """Remove an order."""
    from somrs.cli.order_commands import remove_order as run

    awaited(run(name, data))
