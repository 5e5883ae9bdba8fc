"""The Scheduler's data: templates, standing orders, and the runs of orders."""

from __future__ import annotations

from msgspec import Struct, field, structs

from somrs.client.refusals import Changed, NotFound
from somrs.entish.parse import nearest
from somrs.protocol.messages.orders import Run, StandingOrder, Template
from somrs.protocol.messages.people import person_name

MOST_RUNS = 200
"""Maximum number of runs kept for an order."""


class Book(Struct, kw_only=True):
    """Templates by name, orders by id, and the runs of each order by its id, the latest last."""

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
        """Store a run of an order; it replaces the run with the same due time."""
        other_runs = (entry for entry in self.runs_of(id) if entry.due != run.due)
        self.runs[id] = tuple(sorted([*other_runs, run], key=lambda entry: entry.due))[-MOST_RUNS:]

    def remove_template(self, template: Template) -> None:
        """Remove a template. Raises Changed if an order uses it."""
        if users := [order.name for order in self.orders.values() if order.template == template.name]:
            problem = f"the template {template.name} is used by the order {', '.join(users)}"
            raise Changed(f"{problem}; remove that first, or give it another task")
        del self.templates[template.name]

    def rename_template(self, template: Template, new_name: str, author: str, now: float) -> Template:
        """Rename a template, also in the orders that use it. Raises Changed if another template has the new name."""
        if new_name != template.name and new_name in self.templates:
            raise Changed(f"there is a template {new_name} already; choose another name, or remove that template first")
        del self.templates[template.name]
        self.templates[new_name] = new_template = structs.replace(
            template, name=new_name, version=template.version + 1, changed_at=now, changed_by=author
        )
        for order in self.orders.values():
            if order.template == template.name:
                self.orders[order.id] = structs.replace(order, template=new_name, version=order.version + 1)
        return new_template

    def remove_order(self, id: str) -> None:
        """Remove an order and its runs."""
        del self.orders[id]
        self.runs.pop(id, None)


def expect(version: int | None, current_version: int, subject: str, author: str = "") -> None:
    """Raise Changed if `version` is given and is not the current version. `author`: the author of the current version."""
    if version is not None and version != current_version:
        author_text = f" by {person_name(author)}" if author else ""
        changed = f"was changed{author_text} meanwhile" if current_version else "was removed meanwhile"
        problem = f"{subject} is there already" if version == 0 else f"{subject} {changed}"
        raise Changed(f"{problem}; nothing was saved: read it again, and repeat the change")
