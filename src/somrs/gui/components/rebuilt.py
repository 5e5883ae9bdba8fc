"""Content that news of the system change while somebody uses it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

from nicegui.element import Element


class RebuiltElement(Element):
    """An element that is rebuilt only when what it shows has changed: a click on content that news replaces meanwhile would be lost."""

    def __init__(self) -> None:
        super().__init__("div")
        self._shown: object = None

    def show(self, content: object, build: Callable[[], None]) -> None:
        """Show the content, which `build` adds to the current element. Equal contents look the same."""
        if content != self._shown:
            self.rebuild(build)
            self._shown = content

    def rebuild(self, build: Callable[[], None]) -> None:
        """Replace what is shown in any case."""
        self.clear()
        with self:
            build()

    def clear(self) -> Self:
        """Show nothing."""
        self._shown = None
        return super().clear()
