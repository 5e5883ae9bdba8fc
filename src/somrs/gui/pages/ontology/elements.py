"""Small elements of the page: links to definitions, tables, headings."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from nicegui import Client, ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from somrs.gui.pages.ontology.sections import Section

P = ParamSpec("P")
R = TypeVar("R")

OpenDefinition = Callable[[Section, str], None]

STAY = "(event) => { if (event.ctrlKey || event.metaKey || event.shiftKey) return; event.preventDefault(); emit(); }"
"""Handles a click on a link in the page; with a modifier key, the browser handles it."""


class TextTag(TextElement):
    """A text in an element of its own: `TextTag("td", "3 kg")`."""

    def __init__(self, tag: str, text: str = "", classes: str = "") -> None:
        super().__init__(tag=tag, text=text)
        if classes:
            self.classes(classes)


def definition_link(open_definition: OpenDefinition, section: Section, name: str, text: str | None = None) -> None:
    """Add a link to a definition."""
    link = ui.link(text or name, section.link(name)).classes("somrs-onto-way")
    link.on("click", lambda: open_definition(section, name), js_handler=STAY)


def definition_links(open_definition: OpenDefinition, section: Section, names: list[str]) -> None:
    """Add links to definitions, one after the other."""
    with ui.element("span").classes("somrs-onto-ways"):
        for name in names:
            definition_link(open_definition, section, name)


@contextmanager
def chapter(title: str, count: int | None = None) -> Iterator[Element]:
    """A section of a sheet with a heading."""
    with ui.element("section").classes("somrs-onto-chapter").props(f'aria-label="{title}"') as section:
        with TextTag("h3", title):
            if count is not None:
                TextTag("span", str(count), "somrs-onto-count")
        yield section


@contextmanager
def table(*headings: str) -> Iterator[Element]:
    """A table; the elements made inside are its rows."""
    with ui.element("div").classes("somrs-onto-scroll"), ui.element("table").classes("somrs-onto-table"):
        with ui.element("thead"), ui.element("tr"):
            for heading in headings:
                TextTag("th", heading).props("scope=col")
        with ui.element("tbody") as body:
            yield body


@contextmanager
def row(classes: str = "") -> Iterator[Element]:
    with ui.element("tr").classes(classes) as element:
        yield element


@contextmanager
def cell(classes: str = "") -> Iterator[Element]:
    with ui.element("td").classes(classes) as element:
        yield element


def note(text: str) -> None:
    ui.label(text).classes("somrs-soft")


def icon_button(icon: str, label: str, on_click: Callable[..., object]) -> ui.button:
    """Add an icon button with an accessible name and a tooltip."""
    button = ui.button(icon=icon, on_click=on_click).props(f'flat round dense aria-label="{label}"').classes("somrs-onto-icon")
    with button:
        ui.tooltip(label)
    return button


def titled_dialog(title: str) -> ui.dialog:
    """A dialog with an accessible name."""
    return ui.dialog().props(f'aria-label="{title}"')


class _OnPage(Protocol):
    """An object that belongs to a page in one browser."""

    @property
    def client(self) -> Client: ...


S = TypeVar("S", bound=_OnPage)


def in_page_context(action: Callable[Concatenate[S, P], Awaitable[R]]) -> Callable[Concatenate[S, P], Awaitable[R]]:
    """Run the action in the context of the page, since the button that started it may be removed meanwhile."""

    @wraps(action)
    async def run_in_page(self: S, /, *args: P.args, **kwargs: P.kwargs) -> R:
        with self.client:
            return await action(self, *args, **kwargs)

    return run_in_page
