"""What the Scheduler keeps, as data: templates, standing orders, and what came of each time at which one was due."""

from __future__ import annotations

import msgspec
from msgspec import Struct, structs

from somrs.client.refusals import Changed, NotFound
from somrs.entish.parse import nearest
from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.protocol.messages.people import person

MOST_RUNS = 200
"""Of each order, so many times at which it was due are known."""


class BookChange(Struct, frozen=True, kw_only=True, tag=True):
    """These templates, by name, and orders, by id, are so from now on; None: there is none any more, nor are there its runs."""

    templates: dict[str, Template | None] = {}
    orders: dict[str, StandingOrder | None] = {}


class RunNoted(Struct, frozen=True, kw_only=True, tag=True):
    """What came of a time at which an order was due; in place of what is known of the same time."""

    order: str
    run: Run


Entry = BookChange | RunNoted
"""What is to be on disk."""


class Book(Struct, kw_only=True):
    """`runs` by an order's id, the latest last."""

    templates: dict[str, Template] = msgspec.field(default_factory=dict)
    orders: dict[str, StandingOrder] = msgspec.field(default_factory=dict)
    runs: dict[str, tuple[Run, ...]] = msgspec.field(default_factory=dict)

    def template(self, name: str) -> Template:
        if name not in self.templates:
            raise NotFound(f"there is no template {name}; {nearest(name, self.templates) or 'save one first'}")
        return self.templates[name]

    def order(self, id: str) -> StandingOrder:
        if id not in self.orders:
            raise NotFound(f"there is no standing order {id}; the list of orders has their ids")
        return self.orders[id]

    def runs_of(self, id: str) -> tuple[Run, ...]:
        return self.runs.get(id, ())

    def enter(self, entry: Entry) -> None:
        match entry:
            case RunNoted(order=id, run=run):
                others = (one for one in self.runs_of(id) if one.due != run.due)
                self.runs[id] = tuple(sorted([*others, run], key=lambda one: one.due))[-MOST_RUNS:]
            case BookChange(templates=templates, orders=orders):
                for name, template in templates.items():
                    if template is None:
                        self.templates.pop(name, None)
                    else:
                        self.templates[name] = template
                for id, order in orders.items():
                    if order is None:
                        self.orders.pop(id, None)
                        self.runs.pop(id, None)
                    else:
                        self.orders[id] = order

    def without(self, template: Template) -> BookChange:
        """What removes a template. Raises Changed when an order uses it."""
        if users := [order.name for order in self.orders.values() if order.template == template.name]:
            used = f"the template {template.name} is used by the order {', '.join(users)}"
            raise Changed(f"{used}; remove that first, or give it another task")
        return BookChange(templates={template.name: None})

    def renamed(self, template: Template, to: str, by: str, now: float) -> BookChange:
        """What gives a template another name, also where orders use it."""
        if to != template.name and to in self.templates:
            raise Changed(f"there is a template {to} already; take another name, or remove that one first")
        made = structs.replace(template, name=to, version=template.version + 1, changed_at=now, changed_by=by)
        users = [order for order in self.orders.values() if order.template == template.name]
        return BookChange(
            templates={template.name: None, to: made},
            orders={order.id: structs.replace(order, template=to, version=order.version + 1) for order in users},
        )


def expect(version: int | None, now: int, what: str, by: str = "") -> None:
    """Raises Changed if somebody else changed it since it had that version."""
    if version is not None and version != now:
        who = f" by {person(by)}" if by else ""
        changed = f"was changed{who} meanwhile" if now else "was removed meanwhile"
        there = f"{what} is there already" if version == 0 else f"{what} {changed}"
        raise Changed(f"{there}; nothing was saved: look at it as it is now, and say again what is to be otherwise")
