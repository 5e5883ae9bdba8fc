"""A field in which one of many is chosen by typing a part of its name: of a list, or of the things on the map.

Picker("Thing", source=things(), on_pick=picked)
Picker("Colour", options=[Choice(value="Red"), Choice(value="Blue")], value="Red", on_pick=picked)
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any, NotRequired, TypedDict

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class Choice(TypedDict):
    """`text` is shown instead of the value; `symbol`: a Material icon; those of a `group` stand together under its name."""

    value: str
    text: NotRequired[str]
    detail: NotRequired[str]
    symbol: NotRequired[str]
    group: NotRequired[str]


def things(*, type: str | None = None, relation: str | None = None, place: int = 0) -> dict[str, Any]:
    """All things on the map, those of a type, or those that fit a place of a relation, counted from 0."""
    if relation is not None:
        return {"relation": relation, "place": place}
    return {"type": type} if type is not None else {"place": 0}


class Picker(Element, component="picker.js"):
    """`label`: what it is called for those who do not see it; `source` as `things` has it, or `options`. What is chosen is the `value`, and
    `on_pick` hears of it."""

    def __init__(
        self,
        label: str,
        *,
        value: str = "",
        placeholder: str = "",
        options: Sequence[Choice] | None = None,
        source: dict[str, Any] | None = None,
        on_pick: Callable[[str], Awaitable[None] | None] | None = None,
    ) -> None:
        super().__init__()
        self.value = value
        self._props.update({"label": label, "value": value, "placeholder": placeholder})
        self._props.update({"options": list(options or ()), "source": source})

        def picked(event: GenericEventArguments) -> Awaitable[None] | None:
            self.value = self._props["value"] = str(event.args)
            return on_pick(self.value) if on_pick is not None else None

        self.on("pick", picked)

    def choose(self, value: str) -> None:
        """Have another one chosen; nobody is told."""
        self.value = self._props["value"] = value

    def offer(self, *, options: Sequence[Choice] | None = None, source: dict[str, Any] | None = None) -> None:
        """Have others to choose from."""
        self._props.update({"options": list(options or ()), "source": source})

    def blame(self, problem: str) -> None:
        """Show that what is chosen is not right, and why; an empty text ends that."""
        if self._props.get("problem", "") != problem:
            self._props["problem"] = problem

    def focus(self) -> None:
        self.run_method("focus")
