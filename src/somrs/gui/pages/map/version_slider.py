"""A slider over the versions of the map, with a description of each and a replay."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.pages.map.change_text import describe_event, format_time
from somrs.gui.shell import guarded
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.people import person_name

STEP_TIME = 0.9
"""Seconds per version during a replay."""


class VersionSlider:
    """`on_version` is called with the version to show; None for the current one."""

    def __init__(self, api: LiveApi, on_version: Callable[[int | None], None]) -> None:
        self._api, self._on_version = api, on_version
        self._first_version = 0
        self._shown_version: int | None = None
        self._playing = False
        with ui.element("div").classes("somrs-map-times").props('role="group" aria-label="History of the map"'):
            self._back_button = self._button("skip_previous", "One version back", lambda: self._step(-1))
            self._play_button = self._button("play_arrow", "Play from here to now", self._toggle)
            self._forward_button = self._button("skip_next", "One version on", lambda: self._step(1))
            self._slider = (
                ui.slider(min=0, max=1, value=1, step=1).props('aria-label="Version of the map" dense').classes("somrs-map-slider")
            )
            self._slider.on("update:model-value", lambda event: self._on_slide(event.args), throttle=0.15)
            self._status_label = ui.label().classes("somrs-map-time-said").props('role="status"')
            self._now_button = ui.button("Back to now", icon="update", on_click=self._show_present).props("unelevated dense no-caps")
        self._timer = ui.timer(STEP_TIME, guarded(self._tick), active=False)
        self._now_button.visible = False

    def _button(self, icon: str, label: str, action: Callable[[], object]) -> ui.button:
        button = ui.button(icon=icon, on_click=action).props(f'flat round dense aria-label="{label}"')
        with button:
            ui.tooltip(label).props('anchor="top left" self="bottom left"').classes("somrs-map-tip")
        return button

    @property
    def first_version(self) -> int:
        """The first version that the Repository has."""
        return self._first_version

    @property
    def shown_version(self) -> int | None:
        """The version shown; None for the current one."""
        return self._shown_version

    async def begin(self) -> None:
        """Read the first version that the Repository has."""
        try:
            self._first_version = (await self._api.map.events(limit=1, brief=True)).since
        except SomrsError:
            self._first_version = self._api.context.version
        self.refresh()

    def refresh(self) -> None:
        """Update after a new version."""
        latest = self._api.context.version
        self._slider.props(f"min={self._first_version} max={max(latest, self._first_version + 1)}")
        self._slider.set_enabled(latest > self._first_version)
        if self._shown_version is None:
            self._slider.value = latest
            self._status_label.text = f"Now · version {latest}"
        for button, is_enabled in (
            (self._back_button, self._current_version > self._first_version),
            (self._forward_button, self._shown_version is not None),
            (self._play_button, latest > self._first_version),
        ):
            button.set_enabled(is_enabled)

    @property
    def _current_version(self) -> int:
        return self._shown_version if self._shown_version is not None else self._api.context.version

    def _show_present(self) -> None:
        self._stop()
        self._shown_version = None
        self._now_button.visible = False
        self._on_version(None)
        self.refresh()

    async def show_version(self, version: int) -> None:
        """Show the map at a version."""
        if version >= self._api.context.version:
            self._show_present()
            return
        self._shown_version = max(version, self._first_version)
        self._slider.value = self._shown_version
        self._now_button.visible = True
        self._on_version(self._shown_version)
        self.refresh()
        await self._describe_version(self._shown_version)

    async def _describe_version(self, version: int) -> None:
        event = await self._read_event(version)
        if self._shown_version != version:
            return
        if event is None:
            self._status_label.text = f"Version {version}: the initial map"
            return
        description = "; ".join(describe_event(event, self._api.context.ontology))
        self._status_label.text = f"Version {version} · {format_time(event.at)} · {person_name(event.author)}: {description}"

    async def _read_event(self, version: int) -> Event | None:
        if version <= self._first_version:
            return None
        try:
            events = (await self._api.map.events(after=version - 1, limit=1)).events
        except SomrsError:
            return None
        return events[0] if events and events[0].version == version else None

    async def _on_slide(self, value: object) -> None:
        self._stop()
        if isinstance(value, int | float) and int(value) != self._current_version:
            await self.show_version(int(value))

    async def _step(self, offset: int) -> None:
        self._stop()
        await self.show_version(self._current_version + offset)

    # Replay

    async def _toggle(self) -> None:
        if self._playing:
            self._stop()
            return
        self._playing = True
        self._play_button.props('icon=pause aria-label="Stop playing"')
        if self._shown_version is None:
            await self.show_version(self._first_version)
        self._timer.activate()

    async def _tick(self) -> None:
        if self._shown_version is None:
            self._stop()
        elif self._playing:
            await self.show_version(self._shown_version + 1)

    def _stop(self) -> None:
        self._playing = False
        self._timer.deactivate()
        self._play_button.props('icon=play_arrow aria-label="Play from here to now"')
