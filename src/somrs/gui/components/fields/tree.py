"""A searchable tree of names with keyboard navigation and drag and drop, which Quasar's tree lacks."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import NotRequired, TypedDict

from nicegui.element import Element
from nicegui.events import GenericEventArguments


class Node(TypedDict):
    """`problem`: an error message in one line. `count`: number of instances. `draft`: has unsaved changes."""

    id: str
    label: str
    parent: str | None
    count: NotRequired[int]
    problem: NotRequired[str]
    draft: NotRequired[bool]


class Tree(Element, component="tree.js"):
    """`pick` is called with the id of the chosen node; `move`, if given, with a dragged node and its new parent."""

    def __init__(
        self,
        name: str,
        placeholder: str,
        pick: Callable[[str], Awaitable[None] | None],
        move: Callable[[str, str], Awaitable[None] | None] | None = None,
        nodes: Sequence[Node] = (),
    ) -> None:
        super().__init__()
        self._props.update({"nodes": list(nodes), "selected": None, "name": name, "placeholder": placeholder, "movable": move is not None})

        def picked(event: GenericEventArguments) -> Awaitable[None] | None:
            return pick(str(event.args))

        def moved(event: GenericEventArguments) -> Awaitable[None] | None:
            assert move is not None
            return move(str(event.args["id"]), str(event.args["to"]))

        self.on("pick", picked)
        if move is not None:
            self.on("move", moved)

    def show_nodes(self, nodes: Sequence[Node]) -> None:
        """Replace the nodes; the expanded nodes and the search text stay."""
        if self._props["nodes"] != nodes:
            self._props["nodes"] = list(nodes)

    def select(self, id: str | None) -> None:
        if self._props["selected"] != id:
            self._props["selected"] = id
