"""A field for choosing an item by typing part of its name: from a list, or from the objects on the map.

Picker("Thing", source=things(), on_pick=picked)
Picker("Colour", options=[Choice(value="Red"), Choice(value="Blue")], value="Red", on_pick=picked)
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any, NotRequired, TypedDict

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class Choice(TypedDict):
    """`text` is shown instead of the value. `symbol`: name of a Material icon. Choices of the same `group` are listed together."""

    value: str
    text: NotRequired[str]
    detail: NotRequired[str]
    symbol: NotRequired[str]
    group: NotRequired[str]


def things(*, type: str | None = None, relation: str | None = None, place: int = 0) -> dict[str, Any]:
    """Source of all objects on the map, of those of a type, or of those that fit an argument of a relation (`place`, counted from 0)."""
    if relation is not None:
        return {"relation": relation, "place": place}
    return {"type": type} if type is not None else {"place": 0}


class Picker(Element, component="picker.js"):
    """`label`: the accessible name. Choices come from `source` (see `things`) or `options`. `value` is the chosen one; `on_pick` is called
    when the user chooses."""

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
        """Set the chosen value without calling `on_pick`."""
        self.value = self._props["value"] = value

    def offer(self, *, options: Sequence[Choice] | None = None, source: dict[str, Any] | None = None) -> None:
        """Replace the choices."""
        self._props.update({"options": list(options or ()), "source": source})

    def blame(self, problem: str) -> None:
        """Show an error at the field; an empty text clears it."""
        if self._props.get("problem", "") != problem:
            self._props["problem"] = problem

    def focus(self) -> None:
        self.run_method("focus")
