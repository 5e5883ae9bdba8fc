"""The stop of all devices, in the header of every page: the button, and what is stopped."""

from __future__ import annotations

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.account_menu import only_with
from somrs.gui.author import author
from somrs.gui.news import follow_values
from somrs.ontology.types import PAUSED


class StopControl:
    """One click stops everything; to let all go on takes a click on another button, which shows what is stopped."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._release = ui.button(on_click=self._release_all).props(
            "unelevated no-caps dense icon=play_arrow color=warning text-color=black"
        )
        self._release.classes("somrs-release").tooltip("Let all stopped devices go on")
        only_with(Right.OPERATE, self._release)
        self._stop = ui.button("Stop", on_click=self._stop_all).props("unelevated no-caps dense icon=front_hand color=negative")
        self._stop.classes("somrs-stop").props('aria-label="Stop all devices"').tooltip("Stop all devices at once")
        self._show()
        follow_values(api, PAUSED, self._show)

    def _show(self) -> None:
        stopped = sorted(name for name, object in self._api.context.map.objects.items() if object.values.get(PAUSED) is True)
        self._release.visible = bool(stopped)
        self._release.text = f"Release {stopped[0] if len(stopped) == 1 else len(stopped)}"

    async def _stop_all(self) -> None:
        try:
            await self._api.control.stop(by=author())
        except SomrsError as error:
            ui.notify(f"The devices are not stopped: {error}", type="negative", timeout=0, close_button="Close")

    async def _release_all(self) -> None:
        try:
            await self._api.control.release(by=author())
        except SomrsError as error:
            ui.notify(str(error), type="negative", timeout=0, close_button="Close")
