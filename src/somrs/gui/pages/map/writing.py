"""What people wrote in the forms of objects, and did not save: kept in the browser too, so that it outlives the page and the server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from nicegui.element import Element

from somrs.gui.components.draft_storage import Keeper
from somrs.gui.pages.map.fields import Raw
from somrs.ontology.types import Value

STEP = "/"
"""Between the names of an attribute's path, where the browser keeps it: it takes points for something else."""


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """What was written for an object, by path (`form`, as the browser keeps it), and what the map said of it then (`known`)."""

    name: str
    form: dict[str, Raw] = {}
    known: dict[str, Value] = {}

    def typed(self) -> dict[str, Raw]:
        return {key.replace(STEP, "."): raw for key, raw in self.form.items()}


class Writing:
    """`found` hears which objects something had been written for when the page was loaded again."""

    def __init__(self, found: Callable[[list[str]], None]) -> None:
        self._found = found
        self._written: dict[str, Written] = {}
        self._keeper = Keeper("somrs-map", self._hear)

    def _hear(self, kept: list[Any]) -> None:
        for one in kept:
            written = msgspec.convert(one, Written)
            if written.form and not self.of(written.name).form:
                self._written[written.name] = written
            elif not written.form and written.name not in self._written:
                self._keeper.forget(written.name)
        if names := self.names():
            self._found(names)

    def names(self) -> list[str]:
        """The objects for which something is not saved."""
        return [name for name, one in self._written.items() if one.form]

    def of(self, name: str) -> Written:
        return self._written.get(name) or Written(name=name)

    def keep(self, name: str, typed: dict[str, Raw], known: dict[str, Value]) -> None:
        """This is written now."""
        form = {path.replace(".", STEP): raw for path, raw in typed.items()}
        self._written[name] = Written(name=name, form=form, known=known)
        self._keeper.keep(name, msgspec.to_builtins(self._written[name]))

    def forget(self, name: str) -> None:
        """The form is closed; what was written in it stays."""
        if not self.of(name).form:
            self._written.pop(name, None)
            self._keeper.forget(name)

    def mirror(self, name: str, element: Element, path: str) -> None:
        """Keep each letter of a field, also while the server is away."""
        self._keeper.mirror(element, "update:model-value", name, path.replace(".", STEP))
