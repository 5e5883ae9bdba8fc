"""What uses words of the ontology that a change takes away: tasks that run, standing orders, and templates. They are not changed with the
ontology: their formulas stay as they were written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from enum import StrEnum

import msgspec

from somrs.entish import Formula
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.naming import DefinitionKey, Renaming, Section, key_of
from somrs.ontology.renaming import speaks_of
from somrs.ontology.types import Ontology
from somrs.protocol.messages.clients import Submit, TaskView
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Revision
from somrs.protocol.messages.orders import StandingOrder, Template, blanks_to_variables


class User(StrEnum):
    """What uses a word."""

    TASK = "task"
    """It runs, and fails when it has to look at its formula again."""
    ORDER = "order"
    """What it states is refused from then on."""
    TEMPLATE = "template"
    """Nothing can be stated with it any more."""


class Affected(msgspec.Struct, frozen=True, kw_only=True):
    """Somebody uses the word `what`, which would be called otherwise (`to`) or be removed (""). `id` is a task's or an order's, or the name
    of a template; `name` is what people know it by, of a task its wish."""

    user: User
    id: str
    name: str
    what: DefinitionKey
    to: str = ""

    @property
    def called(self) -> str:
        """A task by as much of its id as people need."""
        return f"{self.id.rpartition(':')[2][:8]} ({self.name})" if self.user is User.TASK else self.name

    def __str__(self) -> str:
        return f"it uses {self.what}, which would be {f'called {self.to}' if self.to else 'removed'}"


def gone(revision: Revision | None, renamed: Iterable[Renaming]) -> dict[DefinitionKey, str]:
    """The words that a change takes away, each with what it is called then."""
    words = {DefinitionKey(section=one.section, name=one.name): one.to for one in renamed}
    if revision is None:
        return words
    there = set(map(key_of, revision.after.all_definitions()))
    return words | {what: "" for what in map(key_of, revision.before.all_definitions()) if what not in there and what not in words}


def affected(
    words: Mapping[DefinitionKey, str],
    ontology: Ontology,
    tasks: Iterable[TaskView],
    orders: Iterable[StandingOrder],
    templates: Mapping[str, Template],
) -> Iterator[Affected]:
    """Who uses the words, in the ontology as it is before they go."""

    def used(by: _Words) -> Iterator[tuple[DefinitionKey, str]]:
        return ((what, to) for what, to in words.items() if by.have(what, ontology))

    for task in tasks:
        for what, to in used(_Words(task)):
            yield Affected(user=User.TASK, id=task.task, name=task.effect, what=what, to=to)
    known = {name: _Words(blanks_to_variables(template), (blank.type for blank in template.blanks)) for name, template in templates.items()}
    for order in orders:
        by = _Words(order.task) if order.task is not None else known.get(order.template or "")
        for what, to in used(by) if by is not None else ():
            yield Affected(user=User.ORDER, id=order.id, name=order.name, what=what, to=to)
    for name, by in known.items():
        for what, to in used(by):
            yield Affected(user=User.TEMPLATE, id=name, name=name, what=what, to=to)


class _Words:
    """What a task speaks of; `types` are those of its blanks."""

    def __init__(self, task: Submit | TaskView, types: Iterable[str] = ()) -> None:
        self._formulas = tuple(_read(task))
        services = {handler.service_type for handler in task.handlers}
        if isinstance(task, TaskView):
            services |= {step.service_type for step in task.steps if step.state is not State.COMPLETED}
        self._named: dict[Section, set[str | None]] = {Section.TYPES: set(types), Section.SERVICES: services}

    def have(self, what: DefinitionKey, ontology: Ontology) -> bool:
        named = what.name in self._named.get(what.section, ())
        return named or any(speaks_of(formula, what, ontology) for formula in self._formulas)


def _read(task: Submit | TaskView) -> Iterator[Formula]:
    texts = [task.effect, task.precondition]
    for handler in task.handlers:
        texts += [handler.effect, handler.when]
    for text in texts:
        with suppress(FormulaError):  # one that cannot be read cannot be stated, whatever the words
            if text is not None:
                yield parse(text)
