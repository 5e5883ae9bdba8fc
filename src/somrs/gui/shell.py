"""The frame of all pages: navigation, colour theme, author and notifications."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from importlib import resources
from typing import Literal, ParamSpec, Protocol, TypeVar

from nicegui import app, ui

from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.account_menu import add_account_menu
from somrs.gui.address import AddressBanner
from somrs.gui.assets import publish
from somrs.gui.mode_control import ModeBanner, ModeControl
from somrs.gui.stop_control import StopControl
from somrs.gui.unavailable_banner import ApiUnavailableBanner

P = ParamSpec("P")
R = TypeVar("R")


class Focusable(Protocol):
    """An element that can take the focus."""

    @property
    def id(self) -> int: ...


@dataclass(frozen=True, slots=True)
class PageLink:
    """A page in the navigation."""

    path: str
    label: str
    icon: str
    window: str


PAGE_LINKS = (
    PageLink("/map", "Map", "map", "Repository"),
    PageLink("/ontology", "Ontology", "account_tree", "Repository"),
    PageLink("/define", "New task", "add_task", "Task Manager"),
    PageLink("/tasks", "Tasks", "checklist", "Task Manager"),
    PageLink("/fleet", "Fleet", "smart_toy", "Task Manager"),
    PageLink("/history", "History", "history", "Task Manager"),
)

BUILD_TIME = 60.0
"""Seconds for the server to build a page, for which it may have to wait for a busy system. NiceGUI drops a page that no browser has opened
after this time, and its own limit of 3 s would end in an error page."""

LOOK, CONNECTION, PORTALS, UPDATES = (
    publish(name, resources.files("somrs.gui").joinpath(name).read_text(encoding="utf-8"))
    for name in ("look.css", "connection.js", "portals.js", "updates.js")
)
"""Addresses of the files that all pages load."""

for popup in (ui.select, ui.menu, ui.dialog):
    # Lists, menus and dialogs appear without animation: during one, Quasar delays setting the focus, and may take it from the field in
    # which the user types by then.
    popup.default_props("transition-duration=0")

ui.menu_item.default_props("role=menuitem")  # Quasar's is a list item, which no menu may have


def page_at(path: str) -> ui.page:
    """The decorator of a function that builds the page at a path."""
    return ui.page(path, response_timeout=BUILD_TIME)


@contextmanager
def page(title: str, path: str, api: LiveApi, parameters: Collection[str] = (), *, navigation: bool = True) -> Iterator[AddressBanner]:
    """Add the frame of a page; the elements made inside are its content. `path`: the navigation entry to highlight; `parameters`: those
    that the page takes in its address. Without `navigation`, the header has no links to other pages. Yields the banner for problems with
    the address.

    The main landmark takes the focus when the page has loaded, so that the keyboard and screen readers begin at the content."""
    ui.page_title(f"{title} · SO-MRS")
    ui.add_head_html(f'<link rel="stylesheet" href="{LOOK}">{_script(CONNECTION)}{_script(PORTALS)}')
    ui.add_body_html(_script(UPDATES))  # after NiceGUI's own script, which it changes
    dark = ui.dark_mode(value=app.storage.user.get("dark"))
    with ui.header(elevated=False).classes("somrs-header"), ui.element("nav").classes("somrs-nav").props('aria-label="Pages"'):
        if navigation:
            _page_links(path)
        else:
            ui.label("SO-MRS").classes("somrs-home")
            ui.space()
        StopControl(api)
        ModeControl(api)
        button = ui.button().props("flat round dense").classes("somrs-turn")
        button.props(f"icon={_icon(dark.value)} aria-label='Colour theme'").tooltip("Colour theme: light, dark, or as in the system")
        button.on_click(lambda: _switch_theme(dark, button))
        add_account_menu()
    with ui.element("div").classes("somrs-main"):
        ModeBanner(api)
        yield AddressBanner(path, parameters)
    ApiUnavailableBanner(api.context.hub)
    [main] = ui.context.client.page_container.default_slot.children  # Quasar's page, a `main` element
    main.props(f'tabindex="-1" aria-label="{title}"')
    ui.run_javascript(f"if (document.activeElement === document.body) getHtmlElement({main.id}).focus({{preventScroll: true}})")
    ui.skip_link("Skip to the content", target=main)


def _script(address: str) -> str:
    return f'<script type="module" src="{address}"></script>'


def _page_links(path: str) -> None:
    ui.link("SO-MRS", "/").classes("somrs-home")
    window = ""
    for place in PAGE_LINKS:
        if place.window != window:
            ui.label(window := place.window).classes("somrs-window")
        _page_link(place, is_current=place.path == path)
    ui.space()
    with ui.link(target="/api/", new_tab=True).classes("somrs-way").props('aria-label="The API"'):
        ui.icon("api")
        ui.label("API").classes("somrs-way-label")


def _page_link(place: PageLink, *, is_current: bool) -> None:
    current = ' aria-current="page"' if is_current else ""
    with (
        ui.link(target=place.path)
        .classes("somrs-way" + (" somrs-here" if is_current else ""))
        .props(f'aria-label="{place.label}"{current}')
    ):
        ui.icon(place.icon)
        ui.label(place.label).classes("somrs-way-label")


def _icon(dark: bool | None) -> str:
    return {None: "brightness_auto", True: "dark_mode", False: "light_mode"}[dark]


def _switch_theme(dark: ui.dark_mode, button: ui.button) -> None:
    dark.value = {None: False, False: True, True: None}[dark.value]
    app.storage.user["dark"] = dark.value
    button.props(f"icon={_icon(dark.value)}")


def notify(text: str, *, bad: bool = False) -> None:
    """Show a message. An error (`bad`) stays until it is closed."""
    kind: Literal["negative", "positive"] = "negative" if bad else "positive"
    ui.notify(text, type=kind, timeout=0 if bad else 4000, close_button="Close" if bad else False, multi_line=True)


def focus(field: Focusable, *, unless_left: Focusable | None = None) -> None:
    """Focus a field at once: Quasar's own `focus` waits until lists have closed. With `unless_left`, only if the focus is still in that
    element or nowhere."""
    script = f"const field = getHtmlElement({field.id}); (field?.querySelector('input, textarea') ?? field)?.focus();"
    if unless_left is not None:
        focus_check = f"[document.body, null].includes(at) || getHtmlElement({unless_left.id})?.contains(at)"
        script = f"const at = document.activeElement; if ({focus_check}) {{ {script} }}"
    ui.run_javascript(f"(() => {{ {script} }})()")


def guarded(action: Callable[P, Awaitable[R]]) -> Callable[P, Awaitable[R | None]]:
    """Wrap an action so that its SomrsErrors are shown as notifications; the user's input stays."""

    @wraps(action)
    async def guard(*args: P.args, **kwargs: P.kwargs) -> R | None:
        try:
            return await action(*args, **kwargs)
        except SomrsError as error:
            notify(str(error), bad=True)
            return None

    return guard
