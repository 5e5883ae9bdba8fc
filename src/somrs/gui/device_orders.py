"""What an operator tells a device from its card: stop and go on, go there, charge, out of service and back."""

from __future__ import annotations

from collections.abc import Awaitable

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.author import author
from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.robot_placing import PlacingDialog
from somrs.protocol.messages.submission import Submitted


class DeviceOrders:
    def __init__(self, api: LiveApi) -> None:
        self._api = api

    async def stop(self, device: str) -> None:
        await self._carry_out(self._api.control.stop(device=device, by=author()), f"{device} is stopped")

    async def release(self, device: str) -> None:
        await self._carry_out(self._api.control.release(device=device, by=author()), f"{device} goes on")

    async def retire(self, device: str) -> None:
        await self._carry_out(self._api.control.service(device, active=False, by=author()), f"{device} gets no new work")

    async def reinstate(self, device: str) -> None:
        await self._carry_out(self._api.control.service(device, active=True, by=author()), f"{device} is back in service")

    async def charge(self, device: str) -> None:
        await self._submit(self._api.control.charge(device, by=author()))

    async def put(self, device: str) -> None:
        """Ask where a simulated robot is to be, and put it there."""
        PlacingDialog(self._api, device)

    async def go(self, device: str) -> None:
        """Ask for the place, and send the device there."""
        map, ontology = self._api.context.map, self._api.context.ontology
        places = [name for type in ontology.types if ontology.is_subtype(type, "Place") for name in map.of_type(type)]
        with ui.dialog().props(f'aria-label="Where {device} goes"') as dialog, ui.card().classes("somrs-dialog"):
            ui.label(f"Where shall {device} go?")
            Picker("Place", placeholder="Choose the place", options=[Choice(value=name) for name in sorted(places)], on_pick=dialog.submit)
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps")
        place = await dialog
        dialog.delete()
        if place is not None:
            await self._submit(self._api.control.go(device, place=str(place), by=author()))

    async def _submit(self, order: Awaitable[Submitted]) -> None:
        try:
            ui.navigate.to(f"/tasks/{(await order).task}")
        except SomrsError as error:
            ui.notify(str(error), type="negative", timeout=0, close_button="Close")

    async def _carry_out(self, order: Awaitable[object], done: str) -> None:
        try:
            await order
        except SomrsError as error:
            ui.notify(str(error), type="negative", timeout=0, close_button="Close")
        else:
            ui.notify(done, type="positive")
