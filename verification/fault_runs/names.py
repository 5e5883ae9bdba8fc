"""The names of objects in runs with several maps: plain and unique in the true state, qualified on maps that are not their homes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from msgspec import structs

from somrs.ontology.qualified_names import SEPARATOR, plain_name, translated
from somrs.runtime.virtual_time import QUIET, Work
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone

_QUALIFIER = re.compile(rf"\b\w+{SEPARATOR}(?=\w)")
_NAME = re.compile(rf"\b[A-Za-z]\w*(?:{SEPARATOR}\w+)?\b")


@cache
def plain_text(text: str) -> str:
    """The text of a formula with plain names."""
    return _QUALIFIER.sub("", text)


class DeviceNames:
    """Translates between the true state and a device: on the wire, names are those of the map of its home.

    `homes`: the maps of the objects that never get another home. A thing has the name that the order gives it.
    """

    def __init__(self, home: str, homes: Mapping[str, str]) -> None:
        self._fixed_names = {name: translated(name, map, home) for name, map in homes.items()} if home else {}

    @property
    def is_qualifying(self) -> bool:
        """Whether there are several maps."""
        return bool(self._fixed_names)

    def understood(self, task: object) -> object:
        """The task of the device with plain names."""
        if not self.is_qualifying:
            return task
        match task:
            case Undo(order, situation):
                return Undo(_plain_order(order), plain_text(situation))
            case Quote(order) | Perform(order) | Halt(order):
                return type(task)(_plain_order(order))
        return task

    def answers(self, task: object, work: Work) -> Work:
        """The answers of the device to the task, which has its names as they came."""
        if not self.is_qualifying:
            yield from work
            return
        names = self._fixed_names | dict(_given_names(task))
        for seconds, value in work:
            yield seconds, value if value is QUIET else _spelled(value, names)


def _plain_order(order: Order) -> Order:
    return structs.replace(
        order,
        inputs={parameter: plain_text(term) for parameter, term in order.inputs.items()},
        effect=plain_text(order.effect),
        precondition=plain_text(order.precondition) if order.precondition is not None else None,
        situation=plain_text(order.situation) if order.situation is not None else None,
    )


def _given_names(task: object) -> Iterator[tuple[str, str]]:
    """The names in a task, by plain names. Those in a situation that is to be restored are the latest."""
    order: Order | None = getattr(task, "order", None)
    if order is not None:
        for text in (order.effect, *order.inputs.values(), task.situation if isinstance(task, Undo) else ""):
            yield from ((plain_name(name), name) for name in _NAME.findall(text))


def _spelled(value: object, names: Mapping[str, str]) -> object:
    """An answer of a device with the names of its map."""

    def text(plain: str | None) -> str | None:
        return _NAME.sub(lambda match: names.get(match[0], match[0]), plain) if plain is not None else None

    match value:
        case ServiceFailed(description=description, situation=situation):
            return ServiceFailed(description, text(situation))
        case Refusal(reason=reason, not_now=not_now, condition=condition):
            return Refusal(reason, not_now=not_now, condition=text(str(condition)) if condition is not None else None)
        case Quoted(condition=condition):
            return structs.replace(value, condition=text(condition))
        case Advance(situation=situation):
            return structs.replace(value, situation=text(situation))
        case WorkDone(situation=situation, outputs=outputs):
            new_outputs: dict[str, Any] = {name: text(output) if isinstance(output, str) else output for name, output in outputs.items()}
            return structs.replace(value, situation=text(situation), outputs=new_outputs)
    return value
