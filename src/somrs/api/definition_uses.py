"""Uses of definitions that a change of the ontology removes or renames: in running tasks, standing orders, and templates.

A change of the ontology does not change their formulas.
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
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Revision
from somrs.protocol.messages.orders import StandingOrder, Template, blanks_to_variables
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import TaskView


class DefinitionUserKind(StrEnum):
    """What uses a definition."""

    TASK = "task"
    """A running task: it fails when it next evaluates its formula."""
    ORDER = "order"
    """A standing order: its tasks are refused from then on."""
    TEMPLATE = "template"
    """A template: its tasks are refused from then on."""


class DefinitionUse(msgspec.Struct, frozen=True, kw_only=True):
    """A use of the definition `definition` (JSON: `what`), which would be renamed to `new_name` (JSON: `to`), or removed if that is empty.

    `user_kind` (JSON: `user`): what uses it; `id`: the id of the task or order, or the name of the template; `name`: its name, or the goal
    of the task.
    """

    user_kind: DefinitionUserKind = msgspec.field(name="user")
    id: str
    name: str
    definition: DefinitionKey = msgspec.field(name="what")
    new_name: str = msgspec.field(default="", name="to")

    @property
    def display_name(self) -> str:
        """The name for users; for a task, the beginning of its id and its goal."""
        return f"{short_id(self.id)} ({self.name})" if self.user_kind is DefinitionUserKind.TASK else self.name

    def __str__(self) -> str:
        return f"it uses {self.definition}, which would be {f'called {self.new_name}' if self.new_name else 'removed'}"


def find_obsolete_definitions(revision: Revision | None, renamed: Iterable[Renaming]) -> dict[DefinitionKey, str]:
    """The definitions that a change renames or removes, each with its new name, or an empty text if it is removed."""
    obsolete = {DefinitionKey(section=renaming.section, name=renaming.name): renaming.to for renaming in renamed}
    if revision is None:
        return obsolete
    remaining_definitions = set(map(key_of, revision.after.all_definitions()))
    return obsolete | {
        definition: ""
        for definition in map(key_of, revision.before.all_definitions())
        if definition not in remaining_definitions and definition not in obsolete
    }


def find_definition_uses(
    obsolete: Mapping[DefinitionKey, str],
    ontology: Ontology,
    tasks: Iterable[TaskView],
    orders: Iterable[StandingOrder],
    templates: Mapping[str, Template],
) -> Iterator[DefinitionUse]:
    """The uses of the definitions. `ontology`: as it is before the change."""

    def find_used_definitions(vocabulary: _Vocabulary) -> Iterator[tuple[DefinitionKey, str]]:
        return ((definition, new_name) for definition, new_name in obsolete.items() if vocabulary.contains(definition, ontology))

    for task in tasks:
        for definition, new_name in find_used_definitions(_Vocabulary(task)):
            yield DefinitionUse(user_kind=DefinitionUserKind.TASK, id=task.task, name=task.effect, definition=definition, new_name=new_name)
    template_vocabularies = {
        name: _Vocabulary(blanks_to_variables(template), (blank.type for blank in template.blanks)) for name, template in templates.items()
    }
    for order in orders:
        vocabulary = _Vocabulary(order.task) if order.task is not None else template_vocabularies.get(order.template or "")
        for definition, new_name in find_used_definitions(vocabulary) if vocabulary is not None else ():
            yield DefinitionUse(user_kind=DefinitionUserKind.ORDER, id=order.id, name=order.name, definition=definition, new_name=new_name)
    for name, vocabulary in template_vocabularies.items():
        for definition, new_name in find_used_definitions(vocabulary):
            yield DefinitionUse(user_kind=DefinitionUserKind.TEMPLATE, id=name, name=name, definition=definition, new_name=new_name)


class _Vocabulary:
    """The definitions that a task or a template uses. `types`: the types of the template's blanks."""

    def __init__(self, task: Submit | TaskView, types: Iterable[str] = ()) -> None:
        self._formulas = tuple(_read_formulas(task))
        services = {handler.service_type for handler in task.handlers}
        if isinstance(task, TaskView):
            services |= {step.service_type for step in task.steps if step.state is not State.COMPLETED}
        self._named: dict[Section, set[str | None]] = {Section.TYPES: set(types), Section.SERVICES: services}

    def contains(self, definition: DefinitionKey, ontology: Ontology) -> bool:
        named = definition.name in self._named.get(definition.section, ())
        return named or any(speaks_of(formula, definition, ontology) for formula in self._formulas)


def _read_formulas(task: Submit | TaskView) -> Iterator[Formula]:
    texts = [task.effect, task.precondition]
    for handler in task.handlers:
        texts += [handler.effect, handler.when]
    for text in texts:
        with suppress(FormulaError):  # a task with an invalid formula is refused in any case
            if text is not None:
                yield parse(text)
