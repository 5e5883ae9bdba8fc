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
from somrs.protocol.messages.clients import Submit, TaskView
from somrs.protocol.messages.event_text import short_id
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import Revision
from somrs.protocol.messages.orders import StandingOrder, Template, blanks_to_variables


class WordUserKind(StrEnum):
    """What uses a definition."""

    TASK = "task"
    """A running task: it fails when it next evaluates its formula."""
    ORDER = "order"
    """A standing order: its tasks are refused from then on."""
    TEMPLATE = "template"
    """A template: its tasks are refused from then on."""


class WordUse(msgspec.Struct, frozen=True, kw_only=True):
    """A use of the definition `word` (JSON: `what`), which would be renamed to `new_name` (JSON: `to`), or removed if that is empty.

    `user_kind` (JSON: `user`): what uses it; `id`: the id of the task or order, or the name of the template; `name`: its name, or the goal
    of the task.
    """

    user_kind: WordUserKind = msgspec.field(name="user")
    id: str
    name: str
    word: DefinitionKey = msgspec.field(name="what")
    new_name: str = msgspec.field(default="", name="to")

    @property
    def display_name(self) -> str:
        """The name for users; for a task, the beginning of its id and its goal."""
        return f"{short_id(self.id)} ({self.name})" if self.user_kind is WordUserKind.TASK else self.name

    def __str__(self) -> str:
        return f"it uses {self.word}, which would be {f'called {self.new_name}' if self.new_name else 'removed'}"


def find_obsolete_words(revision: Revision | None, renamed: Iterable[Renaming]) -> dict[DefinitionKey, str]:
    """The definitions that a change renames or removes, each with its new name, or an empty text if it is removed."""
    words = {DefinitionKey(section=renaming.section, name=renaming.name): renaming.to for renaming in renamed}
    if revision is None:
        return words
    remaining_words = set(map(key_of, revision.after.all_definitions()))
    return words | {
        word: "" for word in map(key_of, revision.before.all_definitions()) if word not in remaining_words and word not in words
    }


def find_word_uses(
    words: Mapping[DefinitionKey, str],
    ontology: Ontology,
    tasks: Iterable[TaskView],
    orders: Iterable[StandingOrder],
    templates: Mapping[str, Template],
) -> Iterator[WordUse]:
    """The uses of the definitions. `ontology`: as it is before the change."""

    def find_used_words(vocabulary: _Vocabulary) -> Iterator[tuple[DefinitionKey, str]]:
        return ((word, new_name) for word, new_name in words.items() if vocabulary.contains(word, ontology))

    for task in tasks:
        for word, new_name in find_used_words(_Vocabulary(task)):
            yield WordUse(user_kind=WordUserKind.TASK, id=task.task, name=task.effect, word=word, new_name=new_name)
    template_vocabularies = {
        name: _Vocabulary(blanks_to_variables(template), (blank.type for blank in template.blanks)) for name, template in templates.items()
    }
    for order in orders:
        vocabulary = _Vocabulary(order.task) if order.task is not None else template_vocabularies.get(order.template or "")
        for word, new_name in find_used_words(vocabulary) if vocabulary is not None else ():
            yield WordUse(user_kind=WordUserKind.ORDER, id=order.id, name=order.name, word=word, new_name=new_name)
    for name, vocabulary in template_vocabularies.items():
        for word, new_name in find_used_words(vocabulary):
            yield WordUse(user_kind=WordUserKind.TEMPLATE, id=name, name=name, word=word, new_name=new_name)


class _Vocabulary:
    """The definitions that a task or a template uses. `types`: the types of the template's blanks."""

    def __init__(self, task: Submit | TaskView, types: Iterable[str] = ()) -> None:
        self._formulas = tuple(_read_formulas(task))
        services = {handler.service_type for handler in task.handlers}
        if isinstance(task, TaskView):
            services |= {step.service_type for step in task.steps if step.state is not State.COMPLETED}
        self._named: dict[Section, set[str | None]] = {Section.TYPES: set(types), Section.SERVICES: services}

    def contains(self, word: DefinitionKey, ontology: Ontology) -> bool:
        named = word.name in self._named.get(word.section, ())
        return named or any(speaks_of(formula, word, ontology) for formula in self._formulas)


def _read_formulas(task: Submit | TaskView) -> Iterator[Formula]:
    texts = [task.effect, task.precondition]
    for handler in task.handlers:
        texts += [handler.effect, handler.when]
    for text in texts:
        with suppress(FormulaError):  # a task with an invalid formula is refused in any case
            if text is not None:
                yield parse(text)
