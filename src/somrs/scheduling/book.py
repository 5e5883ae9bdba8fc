"""The Scheduler's book: templates, standing orders, and what came of each time at which one was due."""

from __future__ import annotations

from msgspec import Struct, field, structs

from somrs.client.refusals import Changed, NotFound
from somrs.entish.parse import nearest
from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.protocol.messages.people import person_name

MOST_RUNS = 200
"""Of each order, so many times at which it was due are known."""


class Book(Struct, kw_only=True):
    """`templates` by name, `orders` by id; `runs` by an order's id, the latest last."""

    templates: dict[str, Template] = field(default_factory=dict)
    orders: dict[str, StandingOrder] = field(default_factory=dict)
    runs: dict[str, tuple[Run, ...]] = field(default_factory=dict)

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

    def note(self, id: str, run: Run) -> None:
        """Note what came of a time at which an order was due, in place of what is known of the same time."""
        other_runs = (entry for entry in self.runs_of(id) if entry.due != run.due)
        self.runs[id] = tuple(sorted([*other_runs, run], key=lambda entry: entry.due))[-MOST_RUNS:]

    def remove_template(self, template: Template) -> None:
        """Raises Changed when an order uses it."""
        if users := [order.name for order in self.orders.values() if order.template == template.name]:
            problem = f"the template {template.name} is used by the order {', '.join(users)}"
            raise Changed(f"{problem}; remove that first, or give it another task")
        del self.templates[template.name]

    def rename_template(self, template: Template, new_name: str, author: str, now: float) -> Template:
        """Give a template another name, also where orders use it."""
        if new_name != template.name and new_name in self.templates:
            raise Changed(f"there is a template {new_name} already; take another name, or remove that one first")
        del self.templates[template.name]
        self.templates[new_name] = new_template = structs.replace(
            template, name=new_name, version=template.version + 1, changed_at=now, changed_by=author
        )
        for order in self.orders.values():
            if order.template == template.name:
                self.orders[order.id] = structs.replace(order, template=new_name, version=order.version + 1)
        return new_template

    def remove_order(self, id: str) -> None:
        """Take an order back, with what is known of its times."""
        del self.orders[id]
        self.runs.pop(id, None)


def expect(version: int | None, current_version: int, subject: str, author: str = "") -> None:
    """Raises Changed if somebody else changed it since it had that version."""
    if version is not None and version != current_version:
        author_text = f" by {person_name(author)}" if author else ""
        changed = f"was changed{author_text} meanwhile" if current_version else "was removed meanwhile"
        problem = f"{subject} is there already" if version == 0 else f"{subject} {changed}"
        raise Changed(f"{problem}; nothing was saved: look at it as it is now, and say again what is to be otherwise")
