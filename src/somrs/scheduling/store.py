"""The file of templates and standing orders, with what came of each time at which one was due. It is small: all of it is in memory, too,
and what is changed is on disk before anybody hears of it."""

from __future__ import annotations

import asyncio
import functools
import sqlite3
from collections.abc import Coroutine
from pathlib import Path
from typing import TypeVar

import msgspec

from somrs.client.refusals import Changed, NotFound
from somrs.entish.parse import nearest
from somrs.protocol.messages.people import person
from somrs.scheduling.standing_orders import Run, StandingOrder
from somrs.scheduling.templates import Template
from somrs.storage.disk import Disk, Kind

T = TypeVar("T")

FILE = "orders.sqlite"
"""In the data folder."""

MOST_RUNS = 200
"""Of each order, so many times at which it was due are known."""

_KIND = Kind(
    owner="an order book's",
    holds="template or order",
    rival="the windows of another system",
    application=0x534F4D4F,  # `SOMO` in ASCII
    version=1,
    tables="""
    CREATE TABLE templates (name TEXT PRIMARY KEY, document TEXT NOT NULL);
    CREATE TABLE orders (id TEXT PRIMARY KEY, document TEXT NOT NULL);
    CREATE TABLE runs (of TEXT NOT NULL, due REAL NOT NULL, document TEXT NOT NULL, PRIMARY KEY (of, due));
    """,
)


class Book:
    """An open file. Raises UsageError for one that is damaged, is somebody else's, or cannot be written."""

    def __init__(self, path: Path) -> None:
        self._disk = Disk(path, _KIND)
        try:
            self.templates, self.orders, self.runs = self._disk.read(_read).result()
        except BaseException:  # whatever it was, nobody else has the file to close it
            self._disk.close()
            raise
        self.changing = asyncio.Lock()
        """Held by whoever looks what there is, and changes it then."""

    def close(self) -> None:
        self._disk.close()

    # Looking

    def template(self, name: str) -> Template:
        if name not in self.templates:
            raise NotFound(f"there is no template {name}; {nearest(name, self.templates) or 'save one first'}")
        return self.templates[name]

    def order(self, id: str) -> StandingOrder:
        if id not in self.orders:
            raise NotFound(f"there is no standing order {id}; the list of orders has their ids")
        return self.orders[id]

    def runs_of(self, id: str) -> list[Run]:
        """The latest last."""
        return self.runs.setdefault(id, [])

    # Changing

    async def change(
        self,
        *,
        templates: dict[str, Template | None] | None = None,
        orders: dict[str, StandingOrder | None] | None = None,
    ) -> None:
        """Keep these templates, by name, and orders, by id; None: remove what there is, the runs of an order, too. For whoever holds
        `changing`."""
        await _finished(self._change(templates or {}, orders or {}))

    async def _change(self, templates: dict[str, Template | None], orders: dict[str, StandingOrder | None]) -> None:
        await asyncio.to_thread(self._disk.do, functools.partial(_change, templates, orders))
        for name, template in templates.items():
            _put(self.templates, name, template)
        for id, order in orders.items():
            _put(self.orders, id, order)
            if order is None:
                self.runs.pop(id, None)

    async def note(self, id: str, run: Run) -> None:
        """Keep what came of a time at which an order was due; in place of what is known of the same time."""
        async with self.changing:
            if id in self.orders:  # it may have been taken back meanwhile
                await _finished(self._note(id, run))

    async def _note(self, id: str, run: Run) -> None:
        await asyncio.to_thread(self._disk.do, functools.partial(_note, id, run))
        runs = self.runs_of(id)
        runs[:] = sorted([*(one for one in runs if one.due != run.due), run], key=lambda one: one.due)[-MOST_RUNS:]


def expect(version: int | None, now: int, what: str, by: str = "") -> None:
    """Raises Changed if somebody else changed it since it had that version."""
    if version is not None and version != now:
        who = f" by {person(by)}" if by else ""
        changed = f"was changed{who} meanwhile" if now else "was removed meanwhile"
        there = f"{what} is there already" if version == 0 else f"{what} {changed}"
        raise Changed(f"{there}; nothing was saved: look at it as it is now, and say again what is to be otherwise")


async def _finished(writing: Coroutine[None, None, None]) -> None:
    """Wait for it, even if whoever wanted it is gone: what is in memory is to be what is on disk."""
    task = asyncio.create_task(writing)
    try:
        await asyncio.shield(task)
    except asyncio.CancelledError:
        await task
        raise


def _put(kept: dict[str, T], key: str, value: T | None) -> None:
    if value is None:
        kept.pop(key, None)
    else:
        kept[key] = value


def _read(db: sqlite3.Connection) -> tuple[dict[str, Template], dict[str, StandingOrder], dict[str, list[Run]]]:
    templates = [msgspec.json.decode(document, type=Template) for (document,) in db.execute("SELECT document FROM templates ORDER BY name")]
    orders = [msgspec.json.decode(document, type=StandingOrder) for (document,) in db.execute("SELECT document FROM orders")]
    runs: dict[str, list[Run]] = {}
    for of, document in db.execute("SELECT of, document FROM runs ORDER BY of, due"):
        runs.setdefault(of, []).append(msgspec.json.decode(document, type=Run))
    return {one.name: one for one in templates}, {one.id: one for one in orders}, runs


def _change(templates: dict[str, Template | None], orders: dict[str, StandingOrder | None], db: sqlite3.Connection) -> None:
    for name, template in templates.items():
        if template is None:
            db.execute("DELETE FROM templates WHERE name = ?", (name,))
        else:
            db.execute("INSERT OR REPLACE INTO templates VALUES (?, ?)", (name, msgspec.json.encode(template).decode()))
    for id, order in orders.items():
        if order is None:
            db.execute("DELETE FROM orders WHERE id = ?", (id,))
            db.execute("DELETE FROM runs WHERE of = ?", (id,))
        else:
            db.execute("INSERT OR REPLACE INTO orders VALUES (?, ?)", (id, msgspec.json.encode(order).decode()))


def _note(id: str, run: Run, db: sqlite3.Connection) -> None:
    db.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", (id, run.due, msgspec.json.encode(run).decode()))
    db.execute(
        "DELETE FROM runs WHERE of = ?1 AND due <= (SELECT due FROM runs WHERE of = ?1 ORDER BY due DESC LIMIT 1 OFFSET ?2)",
        (id, MOST_RUNS),
    )
