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


class WordUserKind(StrEnum):
    """What uses a word."""

    TASK = "task"
    """It runs, and fails when it has to look at its formula again."""
    ORDER = "order"
    """What it states is refused from then on."""
    TEMPLATE = "template"
    """Nothing can be stated with it any more."""


class WordUse(msgspec.Struct, frozen=True, kw_only=True):
    """Somebody uses the word `word`, which would be called otherwise (`new_name`) or be removed (""). `id` is a task's or an order's, or
    the name of a template; `name` is what people know it by, of a task its wish."""

    user_kind: WordUserKind = msgspec.field(name="user")
    id: str
    name: str
    word: DefinitionKey = msgspec.field(name="what")
    new_name: str = msgspec.field(default="", name="to")

    @property
    def display_name(self) -> str:
        """A task by as much of its id as people need."""
        return f"{self.id.rpartition(':')[2][:8]} ({self.name})" if self.user_kind is WordUserKind.TASK else self.name

    def __str__(self) -> str:
        return f"it uses {self.word}, which would be {f'called {self.new_name}' if self.new_name else 'removed'}"


def find_obsolete_words(revision: Revision | None, renamed: Iterable[Renaming]) -> dict[DefinitionKey, str]:
    """The words that a change takes away, each with what it is called then."""
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
    """Who uses the words, in the ontology as it is before they go."""

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
    """What a task speaks of; `types` are those of its blanks."""

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
        with suppress(FormulaError):  # one that cannot be read cannot be stated, whatever the words
            if text is not None:
                yield parse(text)
