"""The map's history as a slider: what the map was at each of its versions, who made it so, and back to now."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.pages.map.words import at, told
from somrs.gui.shell import guarded
from somrs.protocol.messages.knowledge import Event
from somrs.protocol.messages.people import person_name

STEP = 0.9
"""Seconds between two versions, when the history is played."""


class Times:
    """`turn` shows a version of the map; None for now."""

    def __init__(self, desk: LiveApi, turn: Callable[[int | None], None]) -> None:
        self._desk, self._turn = desk, turn
        self._since = 0
        self._seen: int | None = None
        self._playing = False
        with ui.element("div").classes("somrs-map-times").props('role="group" aria-label="History of the map"'):
            self._back = self._button("skip_previous", "One version back", lambda: self._step(-1))
            self._play = self._button("play_arrow", "Play from here to now", self._toggle)
            self._on = self._button("skip_next", "One version on", lambda: self._step(1))
            self._slider = (
                ui.slider(min=0, max=1, value=1, step=1).props('aria-label="Version of the map" dense').classes("somrs-map-slider")
            )
            self._slider.on("update:model-value", lambda event: self._slid(event.args), throttle=0.15)
            self._said = ui.label().classes("somrs-map-time-said").props('role="status"')
            self._now = ui.button("Back to now", icon="update", on_click=self.now).props("unelevated dense no-caps")
        self._timer = ui.timer(STEP, guarded(self._tick), active=False)
        self._now.visible = False

    def _button(self, icon: str, label: str, action: Callable[[], object]) -> ui.button:
        button = ui.button(icon=icon, on_click=action).props(f'flat round dense aria-label="{label}"')
        with button:
            ui.tooltip(label).props('anchor="top left" self="bottom left"').classes("somrs-map-tip")
        return button

    @property
    def seen(self) -> int | None:
        """The version that is looked at; None for now."""
        return self._seen

    async def begin(self) -> None:
        """Find out how far back the map is known."""
        try:
            self._since = (await self._desk.map.events(limit=1, brief=True)).since
        except SomrsError:
            self._since = self._desk.context.version
        self.grow()

    def grow(self) -> None:
        """There is a new version."""
        latest = self._desk.context.version
        self._slider.props(f"min={self._since} max={max(latest, self._since + 1)}")
        self._slider.set_enabled(latest > self._since)
        if self._seen is None:
            self._slider.value = latest
            self._said.text = f"Now · version {latest}"
        for button, on in ((self._back, self._at > self._since), (self._on, self._seen is not None), (self._play, latest > self._since)):
            button.set_enabled(on)

    @property
    def _at(self) -> int:
        return self._seen if self._seen is not None else self._desk.context.version

    def now(self) -> None:
        self._stop()
        self._seen = None
        self._now.visible = False
        self._turn(None)
        self.grow()

    async def look(self, version: int) -> None:
        """Show the map as it was at a version."""
        if version >= self._desk.context.version:
            self.now()
            return
        self._seen = max(version, self._since)
        self._slider.value = self._seen
        self._now.visible = True
        self._turn(self._seen)
        self.grow()
        await self._tell(self._seen)

    async def _tell(self, version: int) -> None:
        event = await self._event(version)
        if self._seen != version:
            return
        if event is None:
            self._said.text = f"Version {version}: as the map was given"
            return
        what = "; ".join(told(event, self._desk.context.ontology))
        self._said.text = f"Version {version} · {at(event.at)} · {person_name(event.author)}: {what}"

    async def _event(self, version: int) -> Event | None:
        if version <= self._since:
            return None
        try:
            found = (await self._desk.map.events(after=version - 1, limit=1)).events
        except SomrsError:
            return None
        return found[0] if found and found[0].version == version else None

    async def _slid(self, value: object) -> None:
        self._stop()
        if isinstance(value, int | float) and int(value) != self._at:
            await self.look(int(value))

    async def _step(self, by: int) -> None:
        self._stop()
        await self.look(self._at + by)

    # Playing

    async def _toggle(self) -> None:
        if self._playing:
            self._stop()
            return
        self._playing = True
        self._play.props('icon=pause aria-label="Stop playing"')
        if self._seen is None:
            await self.look(self._since)
        self._timer.activate()

    async def _tick(self) -> None:
        if self._seen is None:
            self._stop()
        elif self._playing:
            await self.look(self._seen + 1)

    def _stop(self) -> None:
        self._playing = False
        self._timer.deactivate()
        self._play.props('icon=play_arrow aria-label="Play from here to now"')
