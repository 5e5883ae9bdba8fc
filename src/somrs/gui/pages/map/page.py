"""The Map page: its panels and the actions on the map."""

from __future__ import annotations

import asyncio
from typing import Any
from urllib.parse import parse_qs, quote, urlencode

from nicegui import ui
from nicegui.events import KeyEventArguments, ValueChangeEventArguments

from somrs.api.map_news import MapNews
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.entish.parse import nearest
from somrs.errors import SomrsError
from somrs.gui.address import AddressBanner
from somrs.gui.author import author
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.news import follow
from somrs.gui.pages.map.add_panel import AddPanel
from somrs.gui.pages.map.changes import ChangeList
from somrs.gui.pages.map.map_view import ALL_STOREYS, PLAN, SCENE, VIEWS, MapView
from somrs.gui.pages.map.object_drafts import ObjectDrafts
from somrs.gui.pages.map.past_sheet import PastSheet
from somrs.gui.pages.map.plan_moves import PlanMoves
from somrs.gui.pages.map.refusals import refusal_text
from somrs.gui.pages.map.removal import remove
from somrs.gui.pages.map.search_panel import SearchPanel
from somrs.gui.pages.map.sheet import Sheet, SheetActions
from somrs.gui.pages.map.version_slider import VersionSlider
from somrs.gui.pages.map.zone_dialog import ZoneTool
from somrs.gui.shell import guarded, notify, page, page_at
from somrs.ontology.objects import Change
from somrs.protocol.messages.knowledge import UpdateMap

PATH = "/map"
PARAMETERS = ("object", "storey", "view", "version")
SNAP = 0.05
"""Grid size for dragged objects, m."""
LINKED = ("isOn", "isIn", "isHeldBy", "isAt")
"""Relations listed first in the menu of links."""
_OBJECT, _ADD, _SEARCH, _CHANGES = "Object", "Add", "Find", "Changes"


def register(api: LiveApi) -> None:
    @page_at(PATH)
    async def show_page() -> None:
        with page("Map", PATH, api, PARAMETERS) as address:
            MapPage(api, address).begin(ui.context.client.request.url.query)


class MapPage:
    """The page in one browser."""

    def __init__(self, api: LiveApi, address: AddressBanner) -> None:
        self._api, self._address = api, address
        self._selected: str | None = None
        self._drafts = ObjectDrafts(self._on_drafts_restored)
        self._mine: list[int] = []
        """Versions made on this page, newest last, for undo."""
        self._version_in_address: str | None = None
        """The version to show first; None for the current one, and once it has been shown."""
        self._changing = asyncio.Lock()
        """Held during a move and an undo: only then is it known what the next one is based on."""
        self._sheet: Sheet | None = None
        with ui.element("div").classes("somrs-map"):
            self._bar()
            with ui.element("div").classes("somrs-map-left"):
                with ui.element("div").classes("somrs-map-stage") as holder:
                    self._plan = FloorPlan(mode="edit", snap=SNAP)
                self._map_view = MapView(api, self._plan, holder, self._chosen, self._update_address)
                self._version_slider = VersionSlider(api, self._turn_to)
            with ui.element("aside").classes("somrs-sheet somrs-map-side").props('aria-label="Details"'):
                self._side()
        self._listen()
        follow(api.context.hub, "map", self._read, self._on_map_news)
        follow(api.context.hub, "ontology", self._learned, self._learned_news)

    def _bar(self) -> None:
        with ui.element("div").classes("somrs-map-bar"):
            ui.label("Map").classes("somrs-title").props('role="heading" aria-level="1"')
            self._views = shown_at_once(
                ui.toggle([PLAN, SCENE], value=PLAN, on_change=lambda event: self._map_view.switch(str(event.value)))
            )
            self._views.props('dense no-caps unelevated toggle-color=primary aria-label="View"').classes("somrs-map-views")
            self._count = ui.label().classes("somrs-soft")
            ui.space()
            self._links()
            self._zone_tool = ZoneTool(self._api, self._record_version)
            snap = shown_at_once(ui.switch("Snap", value=True, on_change=lambda event: self._plan.set_snap(SNAP if event.value else 0.0)))
            snap.props("dense").tooltip("Dragged objects snap to 5 cm and 15°; hold Alt to disable")
            self._undo_button = ui.button("Undo", icon="undo", on_click=guarded(self._undo)).props("flat dense no-caps")
            self._undo_button.tooltip("Undo my last change (Ctrl+Z)")
            with ui.link(target="/api/map/export.yaml").classes("somrs-map-export").props('aria-label="Save as a file"'):
                ui.icon("download")
                ui.tooltip("The whole site as a file")

    def _links(self) -> None:
        """Add a menu of the relations that can be drawn as links."""
        relations = sorted(
            self._api.context.ontology.relations, key=lambda name: (LINKED.index(name) if name in LINKED else len(LINKED), name)
        )
        drawn: dict[str, ui.checkbox] = {}

        def draw() -> None:
            chosen = [name for name, box in drawn.items() if box.value]
            self._plan.link(chosen)
            button.text = f"Links: {len(chosen)}" if chosen else "Links"

        with ui.button("Links", icon="polyline").props("flat dense no-caps") as button:
            ui.tooltip("Relations to draw on the plan")
            with ui.menu().props('role="group" aria-label="Relations to draw"'), ui.element("div").classes("somrs-map-links"):
                for name in relations:
                    drawn[name] = shown_at_once(ui.checkbox(name, on_change=draw)).props("dense")

    def _side(self) -> None:
        with ui.tabs().props("dense no-caps inline-label").classes("somrs-map-tabs") as self._tabs:
            for name, icon in ((_OBJECT, "category"), (_ADD, "add"), (_SEARCH, "search"), (_CHANGES, "history")):
                ui.tab(name, icon=icon)
        with ui.tab_panels(self._tabs, value=_SEARCH, animated=False, on_change=self._turned).classes("somrs-map-panels"):
            with ui.tab_panel(_OBJECT):
                self._object = ui.element("div").classes("somrs-map-object")
                self._show_object()
            with ui.tab_panel(_ADD):
                self._add_panel = AddPanel(self._api, self._plan, self.change, self._open_created)
            with ui.tab_panel(_SEARCH):
                self._search_panel = SearchPanel(self._api, self._map_view, self.open_object)
            with ui.tab_panel(_CHANGES):
                self._changes = ChangeList(self._api, self._version_slider.show_version, self._undo_version)

    def _listen(self) -> None:
        plan = self._plan
        plan.on_select(lambda event: self._chosen(event["name"]))
        plan.on_open(lambda event: self._chosen(event["name"]))
        self._moves = PlanMoves(self._api, plan, self._record_version)
        plan.on_moved(self._moved)
        plan.on_shaped(self._shaped)
        plan.on_placed(self._add_panel.place_object)
        plan.sketch_zone_on_click(self._zone_tool.button)
        plan.on_outlined(self._zone_tool.ask)
        plan.on_stopped(lambda event: self._add_panel.stop())
        plan.on_remove(lambda event: self._remove_guarded(event["name"]))
        plan.on_undo(lambda event: self._undo_guarded())
        # In fields, the same keys undo typing; the plan handles them itself while it has the focus.
        ui.keyboard(on_key=self._pressed, ignore=["input", "select", "textarea"], repeating=False)
        plan.on_unanswered(lambda event: notify(_lost(event["names"]), bad=True))

    def begin(self, query: str) -> None:
        """Open what the page's address specifies, and report what does not exist."""
        parameters = {key: values[0] for key, values in parse_qs(query).items()}
        map, storeys = self._api.context.map, self._map_view.storeys()
        storey, named, self._version_in_address = (parameters.get(name) for name in ("storey", "object", "version"))
        if named is not None and named not in map.objects and self._version_in_address is None:
            hint = nearest(named, map.similar_names(named)) or "select an object on the plan, or find one by its name."
            self._address.report(f"There is no object {named} on the map; {hint}")
            named = None
        if storey is not None and storey not in (ALL_STOREYS, *storeys):
            self._address.report(f"There is no storey {storey}; the storeys are {', '.join(storeys)}.")
            storey = None
        if named is not None:
            self._selected = named
            self._map_view.choose(named)
            if storey is None:
                self._plan.show_object(named)
            self._show_object()
            self._tabs.value = _OBJECT
        self._map_view.begin(storey)
        if parameters.get("view") == VIEWS[SCENE]:
            self._views.value = SCENE
        elif (view := parameters.get("view")) not in (None, VIEWS[PLAN]):
            self._address.report(f"There is no view {view}; the views are {' and '.join(VIEWS.values())}.")

    def _update_address(self) -> None:
        """Put the current view into the page's address, so that a reload restores it."""
        version = self._version_slider.shown_version
        parameters = self._map_view.address_parameters()
        parameters |= {"version": str(version)} if version is not None else {}
        parameters |= {"object": self._selected} if self._selected is not None else {}
        ui.navigate.history.replace(f"{PATH}?{urlencode(parameters, quote_via=quote)}" if parameters else PATH)

    # Selection

    def _chosen(self, name: str | None) -> None:
        """Handle a selection on the plan."""
        self._select(name)
        if name is not None:
            self._tabs.value = _OBJECT

    def open_object(self, name: str | None) -> None:
        """Open an object and scroll it into view."""
        self._chosen(name)
        if name is not None and name in self._api.context.map.objects:
            self._plan.show_object(name)

    def _select(self, name: str | None) -> None:
        if name == self._selected and name is not None:
            return
        if self._selected is not None:
            self._drafts.forget(self._selected)
        self._selected = name
        self._map_view.choose(name)
        self._update_address()
        self._show_object()

    def _show_object(self) -> None:
        self._object.clear()
        self._sheet = None
        with self._object:
            if self._selected is None:
                with ui.element("div").classes("somrs-map-empty"):
                    ui.icon("touch_app").props('aria-hidden="true"')
                    ui.label("Select an object on the plan, or find one by its name. Page down on the plan selects the next one.")
                self._unsaved()
                return
            if self._version_slider.shown_version is not None:
                PastSheet(self._api, self._selected, self._version_slider.shown_version, self.open_object)
                return
            actions = SheetActions(
                open_object=self.open_object, change=self.change, remove=self._remove, show_on_plan=self._plan.show_object,
                show_version=self._version_slider.show_version, undo=self._undo_version, record_version=self._record_version,
            )  # fmt: skip
            self._sheet = Sheet(self._api, self._selected, actions, self._drafts)

    def _turn_to(self, version: int | None) -> None:
        """Show a version of the map; None: the current one."""
        self._map_view.show_version(version)
        self._update_address()
        self._show_object()

    def _on_drafts_restored(self, names: list[str]) -> None:
        """Report edits that were restored after a reload."""
        notify(f"Unsaved edits restored: {', '.join(names)}")
        self._show_object()

    def _unsaved(self) -> None:
        """Show links to objects with unsaved edits."""
        for name in self._drafts.names():
            ui.button(f"{name}: not saved yet", icon="edit", on_click=lambda name=name: self.open_object(name)).props("flat dense no-caps")

    def _turned(self, event: ValueChangeEventArguments[Any]) -> None:
        if event.value == _CHANGES:
            ui.timer(0, guarded(self._changes.refresh), once=True)
        if event.value != _ADD:
            self._add_panel.stop()

    # Changing the map

    async def change(self, changes: tuple[Change, ...], message: str, expected_version: int | None = None) -> int | None:
        """Change the map and notify the user of the result. Returns the new version; None if the change was refused."""
        try:
            update = UpdateMap(changes=changes, author=author(), expected_version=expected_version)
            version = (await self._api.map.change(update)).version
        except SomrsError as error:
            notify(refusal_text(error), bad=True)
            return None
        self._record_version(version)
        notify(message)
        return version

    def _record_version(self, version: int) -> None:
        self._mine.append(version)

    async def _moved(self, event: dict[str, Any]) -> None:
        async with self._changing:
            await self._moves.moved(event)

    async def _shaped(self, event: dict[str, Any]) -> None:
        async with self._changing:
            await self._moves.shaped(event)

    async def _open_created(self, name: str, version: int) -> None:
        await self._api.context.wait_for_version(version)
        self.open_object(name)

    async def _remove(self, name: str) -> None:
        if await remove(self._api, name, self.change) and self._selected == name:
            self._select(None)

    async def _remove_guarded(self, name: str) -> None:
        await guarded(self._remove)(name)

    # Undo

    async def _undo(self) -> None:
        """Undo the latest change made on this page, or else the latest change of this user."""
        async with self._changing:
            version = self._mine[-1] if self._mine else await self._last_of_mine()
            if version is None:
                notify("You have no change to undo.")
            else:
                await self._undo_version(version)

    async def _pressed(self, event: KeyEventArguments) -> None:
        if event.action.keydown and (event.modifiers.ctrl or event.modifiers.meta) and not event.modifiers.shift and event.key == "z":
            await self._undo_guarded()

    async def _undo_guarded(self) -> None:
        await guarded(self._undo)()

    async def _last_of_mine(self) -> int | None:
        events = (await self._api.map.events(limit=100)).events
        undone = {event.undoes for event in events}
        mine = (event for event in events if event.author == author() and event.undoes is None and event.version not in undone)
        return next((event.version for event in mine if event.changes), None)

    async def _undo_version(self, version: int) -> None:
        undo_version = (await self._api.map.undo(version, author())).version
        self._moves.undone(version, undo_version)
        if version in self._mine:
            self._mine.remove(version)
        notify(f"Version {version} undone")

    # News

    async def _read(self) -> None:
        await self._version_slider.begin()
        await self._show_version_in_address()
        await self._search_panel.begin()
        self._show_count()

    async def _show_version_in_address(self) -> None:
        version, self._version_in_address = self._version_in_address, None
        if version is None:
            return
        first, latest = self._version_slider.first_version, self._api.context.version
        if version.isdecimal() and first <= int(version) <= latest:
            await self._version_slider.show_version(int(version))
        else:
            self._address.report(f"The map has no version {version}; it has the versions {first} to {latest}. This is the current one.")

    async def _learned(self) -> None:
        self._add_panel.refresh()

    async def _learned_news(self, news: News) -> None:
        self._add_panel.refresh()
        if self._sheet is not None and not self._sheet.dirty:
            self._show_object()

    async def _on_map_news(self, news: News) -> None:
        value = news.value
        changes = value.changes if isinstance(value, MapNews) and not value.read else ()
        version = value.version if isinstance(value, MapNews) else self._api.context.version
        if self._sheet is not None:
            await self._sheet.apply_changes(changes, version)
        self._version_slider.refresh()
        self._show_count()
        await self._search_panel.refresh()
        if self._tabs.value == _CHANGES:
            await guarded(self._changes.refresh)()

    def _show_count(self) -> None:
        self._count.text = f"{len(self._api.context.map.objects)} objects"


def _lost(names: list[str]) -> str:
    """What the user is told when the connection was lost before moves were answered."""
    return f"The connection was lost while {', '.join(names)} was moved. The plan shows where the map has it: move it again if needed."
