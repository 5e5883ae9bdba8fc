"""What the commands about templates and standing orders do."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from somrs.api.remote import Api, api_of
from somrs.cli.task_commands import do
from somrs.client import terminal
from somrs.client.client import Addresses, client_name
from somrs.errors import UsageError
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

_SO_LONG = re.compile(r"(\d+(?:\.\d+)?)\s*(m|min|h|d)")
_MINUTES = {"m": 1, "min": 1, "h": 60, "d": 1440}


def me() -> str:
    """Who changes something, as the histories of templates and orders name them."""
    return person_name(client_name())


def values(said: Sequence[str]) -> dict[str, str]:
    """`Thing=Jar002` ..."""
    found: dict[str, str] = {}
    for one in said:
        name, equals, value = one.partition("=")
        if not equals or not name.strip():
            raise UsageError(f"a blank is filled in as NAME=VALUE, such as Thing=Jar002, and not as {one!r}")
        found[name.strip()] = value.strip()
    return found


def blank(said: str) -> Blank:
    """`Thing:Jar`, or `Thing:Jar=Jar002` with what is taken when nothing is said."""
    declared, _, default = said.partition("=")
    name, _, type = declared.partition(":")
    return Blank(name=name.strip(), type=type.strip() or "Object", default=default.strip())


def when(every: str | None, daily: str | None, days: str | None, at: str | None) -> Schedule:
    """One of them. Raises UsageError."""
    if sum(one is not None for one in (every, daily, at)) != 1:
        raise UsageError("say when: --every 2h, or --daily 07:30 (and perhaps --days Mon,Thu), or --at 2026-11-24T08:00")
    if days is not None and daily is None:
        raise UsageError("--days go with --daily")
    if every is not None:
        found = _SO_LONG.fullmatch(every.strip().lower())
        if found is None:
            raise UsageError(f"{every!r} is no time; write it as 30m, 2h or 1d")
        return Every(minutes=float(found[1]) * _MINUTES[found[2]])
    if at is not None:
        try:
            return Once(at=datetime.fromisoformat(at.strip()).timestamp())
        except ValueError:
            raise UsageError(f"{at!r} is no moment; write it as 2026-11-24T08:00") from None
    assert daily is not None, "one of them is said"
    return Daily(at=daily, days=tuple(_day(day) for day in (days or "").split(",") if day.strip()))


def _day(said: str) -> int:
    short = said.strip().capitalize()[:3]
    if short not in DAYS:
        raise UsageError(f"{said.strip()!r} is no day; they are {', '.join(DAYS)}")
    return DAYS.index(short)


# Templates


async def list_templates(data: Path, *, json: bool) -> None:
    async with api_of(Addresses.read(data)) as api:
        found = (await api.orders.templates()).templates
    if json:
        terminal.print_json(found)
    elif found:
        rows = ((one.name, terminal.lines(one.task.effect, one.note), "\n".join(map(_declared, one.blanks)) or "-") for one in found)
        terminal.console().print(terminal.table("Templates", ("name", "wish", "blanks"), rows))
    else:
        print("no templates yet; `somrs templates save NAME FORMULA` keeps one")


def _declared(blank: Blank) -> str:
    return f"{blank.name}: {blank.type}{f' = {blank.default}' if blank.default else ''}"


async def save_template(name: str, saved: TemplateSaved, data: Path) -> None:
    async with api_of(Addresses.read(data)) as api:
        made = await api.orders.save_template(name, saved)
    print(f"{made.name}: {'saved' if made.version == 1 else 'changed'}")


async def rename_template(name: str, to: str, data: Path) -> None:
    async with api_of(Addresses.read(data)) as api:
        await api.orders.rename_template(name, to, by=me())
    print(f"{name} is called {to} now")


async def remove_template(name: str, data: Path) -> None:
    async with api_of(Addresses.read(data)) as api:
        await api.orders.remove_template(name)
    print(f"{name} is removed")


async def use_template(name: str, said: Sequence[str], data: Path, *, wait: bool, json: bool) -> int:
    """State the task that it is, and follow it; 0 when it was accomplished."""
    async with api_of(Addresses.read(data)) as api:
        task = await api.orders.fill_template(name, Filled(values=values(said)))
    return await do(task, data, wait=wait, json=json)


# Standing orders


async def list_orders(data: Path, *, json: bool) -> None:
    async with api_of(Addresses.read(data)) as api:
        found = (await api.orders.orders()).orders
    if json:
        terminal.print_json(found)
    elif found:
        rows = (
            (one.id, terminal.lines(one.name, wish(one)), in_words(one.when), _next(one), last(one.last) if one.last is not None else "-")
            for one in found
        )
        terminal.console().print(
            terminal.table("Standing orders", ("id", "order", "when", "next", "last time"), rows, whole=("id", "next"))
        )
    else:
        print("no standing orders yet; `somrs orders add NAME FORMULA --every 2h` gives one")


def wish(order: StandingOrder) -> str:
    if order.task is not None:
        return order.task.effect
    return ", ".join((f"template {order.template}", *(f"{name}={value}" for name, value in order.values.items())))


def _next(order: StandingOrder) -> str:
    if order.next is not None:
        return f"{datetime.fromtimestamp(order.next):%Y-%m-%d %H:%M}"
    return "never again" if order.enabled else "paused"


def last(run: Run) -> str:
    """What came of a time at which an order was due."""
    became = run.state.value
    if run.state is RunState.SUBMITTED:
        became = str(run.outcome) if run.outcome is not None else "over" if run.ended_at is not None else "under way"
    elif run.state is RunState.MISSED and run.times > 1:
        became = f"missed, {run.times} times"
    return terminal.lines(f"{datetime.fromtimestamp(run.due):%Y-%m-%d %H:%M}: {became}", run.note)


async def add_order(order: OrderSaved, data: Path) -> None:
    async with api_of(Addresses.read(data)) as api:
        made = await api.orders.add_order(order)
    print(f"{made.id}: {made.name}, {in_words(made.when)}; next: {_next(made)}")


async def show_runs(name: str, limit: int, data: Path, *, json: bool) -> None:
    async with api_of(Addresses.read(data)) as api:
        order = await _named(name, api)
        found = (await api.orders.runs(order.id, limit)).runs
    if json:
        terminal.print_json(found)
        return
    rows = ((last(run), terminal.short(run.task) if run.task is not None else "-") for run in found)
    print(f"{order.name}: {wish(order)}; {in_words(order.when)}; next: {_next(order)}")
    terminal.console().print(terminal.table("", ("due", "task"), rows) if found else "it was not due yet")


async def turn_order(name: str, data: Path, *, on: bool) -> None:
    """Resume it, or pause it."""
    async with api_of(Addresses.read(data)) as api:
        order = await _named(name, api)
        turned = api.orders.resume_order if on else api.orders.pause_order
        made = await turned(order.id, by=me())
    print(f"{made.name}: next: {_next(made)}")


async def remove_order(name: str, data: Path) -> None:
    async with api_of(Addresses.read(data)) as api:
        order = await _named(name, api)
        await api.orders.remove_order(order.id)
    print(f"{order.name} is taken back")


async def _named(name: str, api: Api) -> StandingOrder:
    """The order of that id, or of that name."""
    orders = (await api.orders.orders()).orders
    found = [one for one in orders if one.id == name] or [one for one in orders if one.name == name]
    if len(found) != 1:
        how = f"{len(found)} orders are called {name}: say the id" if found else f"there is no order {name}"
        raise UsageError(f"{how}; `somrs orders` lists them")
    return found[0]
