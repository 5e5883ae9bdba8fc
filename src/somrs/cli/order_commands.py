"""The implementations of the commands about templates and standing orders."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from somrs.api.remote import Api, api_of
from somrs.cli.task_commands import run_task
from somrs.client import terminal
from somrs.client.client import client_name
from somrs.errors import UsageError
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.orders import (
    Blank,
    Daily,
    Every,
    Filled,
    Once,
    OrderSaved,
    Run,
    RunState,
    Schedule,
    StandingOrder,
    TemplateSaved,
)
from somrs.protocol.messages.people import person_name
from somrs.scheduling.recurrence import DAYS, in_words

_DURATION = re.compile(r"(\d+(?:\.\d+)?)\s*(m|min|h|d)")
_MINUTES = {"m": 1, "min": 1, "h": 60, "d": 1440}


def author_name() -> str:
    """The author of changes of templates and orders: the user of this program."""
    return person_name(client_name())


def parse_values(fillings: Sequence[str]) -> dict[str, str]:
    """The values of blanks from texts such as `Thing=Jar002`. Raises UsageError for other texts."""
    values_by_name: dict[str, str] = {}
    for filling in fillings:
        name, equals, value = filling.partition("=")
        if not equals or not name.strip():
            raise UsageError(f"a blank is filled in as NAME=VALUE, such as Thing=Jar002, not as {filling!r}")
        values_by_name[name.strip()] = value.strip()
    return values_by_name


def parse_blank(text: str) -> Blank:
    """The blank declared by `Thing:Jar`, or by `Thing:Jar=Jar002` with a default."""
    declared, _, default = text.partition("=")
    name, _, type = declared.partition(":")
    return Blank(name=name.strip(), type=type.strip() or "Object", default=default.strip())


def parse_recurrence(interval: str | None, daily: str | None, days: str | None, moment: str | None) -> Schedule:
    """The schedule from the command's options, of which one must be given; `days` goes with `daily`. Raises UsageError."""
    if sum(option is not None for option in (interval, daily, moment)) != 1:
        raise UsageError("give one of --every 2h, --daily 07:30 (with --days Mon,Thu if needed), and --at 2026-11-24T08:00")
    if days is not None and daily is None:
        raise UsageError("--days is used with --daily")
    if interval is not None:
        match = _DURATION.fullmatch(interval.strip().lower())
        if match is None:
            raise UsageError(f"{interval!r} is not a duration; write it as 30m, 2h or 1d")
        return Every(minutes=float(match[1]) * _MINUTES[match[2]])
    if moment is not None:
        try:
            return Once(at=datetime.fromisoformat(moment.strip()).timestamp())
        except ValueError:
            raise UsageError(f"{moment!r} is not a time; write it as 2026-11-24T08:00") from None
    assert daily is not None, "one of the options is given"
    return Daily(at=daily, days=tuple(_parse_day(day) for day in (days or "").split(",") if day.strip()))


def _parse_day(text: str) -> int:
    short = text.strip().capitalize()[:3]
    if short not in DAYS:
        raise UsageError(f"{text.strip()!r} is not a day; the days are {', '.join(DAYS)}")
    return DAYS.index(short)


# Templates


async def list_templates(data: Path, *, json: bool) -> None:
    async with api_of(data) as api:
        templates = (await api.orders.templates()).templates
    if json:
        terminal.print_json(templates)
    elif templates:
        rows = (
            (template.name, terminal.lines(template.task.effect, template.note), "\n".join(map(_describe_blank, template.blanks)) or "-")
            for template in templates
        )
        terminal.console().print(terminal.table("Templates", ("name", "goal", "blanks"), rows))
    else:
        print("no templates yet; `somrs templates save NAME FORMULA` saves one")


def _describe_blank(blank: Blank) -> str:
    return f"{blank.name}: {blank.type}{f' = {blank.default}' if blank.default else ''}"


async def save_template(name: str, saved: TemplateSaved, data: Path) -> None:
    async with api_of(data) as api:
        template = await api.orders.save_template(name, saved)
    print(f"{template.name}: {'saved' if template.version == 1 else 'changed'}")


async def rename_template(name: str, new_name: str, data: Path) -> None:
    async with api_of(data) as api:
        await api.orders.rename_template(name, new_name, by=author_name())
    print(f"{name}: renamed to {new_name}")


async def remove_template(name: str, data: Path) -> None:
    async with api_of(data) as api:
        await api.orders.remove_template(name)
    print(f"{name}: removed")


async def use_template(name: str, fillings: Sequence[str], data: Path, *, wait: bool, json: bool) -> int:
    """Submit the task of a template, and follow it. Returns the exit status: 0 if it was accomplished."""
    async with api_of(data) as api:
        task = await api.orders.fill_template(name, Filled(values=parse_values(fillings)))
    return await run_task(task, data, wait=wait, json=json)


# Standing orders


async def list_orders(data: Path, *, json: bool) -> None:
    async with api_of(data) as api:
        orders = (await api.orders.orders()).orders
    if json:
        terminal.print_json(orders)
    elif orders:
        rows = (
            (
                order.id,
                terminal.lines(order.name, _goal_text(order)),
                in_words(order.when),
                _describe_next(order),
                _describe_run(order.last) if order.last is not None else "-",
            )
            for order in orders
        )
        terminal.console().print(
            terminal.table("Standing orders", ("id", "order", "schedule", "next", "last run"), rows, whole=("id", "next"))
        )
    else:
        print("no standing orders yet; `somrs orders add NAME FORMULA --every 2h` adds one")


def _goal_text(order: StandingOrder) -> str:
    if order.task is not None:
        return order.task.effect
    return ", ".join((f"template {order.template}", *(f"{name}={value}" for name, value in order.values.items())))


def _describe_next(order: StandingOrder) -> str:
    if order.next is not None:
        return f"{datetime.fromtimestamp(order.next):%Y-%m-%d %H:%M}"
    return "never again" if order.enabled else "paused"


def _describe_run(run: Run) -> str:
    """The time and the result of a run, as text."""
    result = run.state.value
    if run.state is RunState.SUBMITTED:
        result = str(run.outcome) if run.outcome is not None else "over" if run.ended_at is not None else "under way"
    elif run.state is RunState.MISSED and run.times > 1:
        result = f"missed, {run.times} times"
    return terminal.lines(f"{datetime.fromtimestamp(run.due):%Y-%m-%d %H:%M}: {result}", run.note)


async def add_order(order: OrderSaved, data: Path) -> None:
    async with api_of(data) as api:
        added_order = await api.orders.add_order(order)
    print(f"{added_order.id}: {added_order.name}, {in_words(added_order.when)}; next: {_describe_next(added_order)}")


async def show_runs(name: str, limit: int, data: Path, *, json: bool) -> None:
    async with api_of(data) as api:
        order = await _find_order(name, api)
        runs = (await api.orders.runs(order.id, limit)).runs
    if json:
        terminal.print_json(runs)
        return
    rows = ((_describe_run(run), short_id(run.task) if run.task is not None else "-") for run in runs)
    print(f"{order.name}: {_goal_text(order)}; {in_words(order.when)}; next: {_describe_next(order)}")
    terminal.console().print(terminal.table("", ("due", "task"), rows) if runs else "the order was not due yet")


async def turn_order(name: str, data: Path, *, is_enabled: bool) -> None:
    """Resume an order, or pause it."""
    async with api_of(data) as api:
        order = await _find_order(name, api)
        turned = api.orders.resume_order if is_enabled else api.orders.pause_order
        updated_order = await turned(order.id, by=author_name())
    print(f"{updated_order.name}: next: {_describe_next(updated_order)}")


async def remove_order(name: str, data: Path) -> None:
    async with api_of(data) as api:
        order = await _find_order(name, api)
        await api.orders.remove_order(order.id)
    print(f"{order.name}: removed")


async def _find_order(name: str, api: Api) -> StandingOrder:
    """The order with this id or name. Raises UsageError if there is none, or several."""
    orders = (await api.orders.orders()).orders
    matches = [order for order in orders if order.id == name] or [order for order in orders if order.name == name]
    if len(matches) != 1:
        problem = f"{len(matches)} orders have the name {name}: give the id" if matches else f"there is no order {name}"
        raise UsageError(f"{problem}; `somrs orders` lists them")
    return matches[0]
