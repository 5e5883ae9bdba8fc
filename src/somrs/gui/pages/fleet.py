"""Fleet: devices and their services as they come, work and go; questions to people; faults of simulated robots."""

from __future__ import annotations

from nicegui import ui

from somrs.api.device_state import FAULT_LABELS, LABELS, DeviceState
from somrs.api.fleet import BUSY, Devices, DeviceView, Presence
from somrs.api.remote import LiveApi
from somrs.api.service_presence import PresenceChange
from somrs.client.hub import News
from somrs.client.refusals import ErrorReport, error_report
from somrs.devices.simulator.link.commands import Fault
from somrs.errors import SomrsError
from somrs.gui.device_card import LEAVING, DeviceCard
from somrs.gui.icons import clock, listed
from somrs.gui.news import follow
from somrs.gui.question_panel import Asked
from somrs.gui.shell import guarded, page, tell

SHOWN = 30
"""Comings and goings that are listed."""


def register(desk: LiveApi) -> None:
    @ui.page("/fleet")
    async def show() -> None:
        with page("Fleet", "/fleet", desk):
            fleet = _Fleet(desk)
            await fleet.read()
            follow(desk.context.hub, "fleet", fleet.read, fleet.hear)


class _Fleet:
    """The page's content, changed in place."""

    def __init__(self, desk: LiveApi) -> None:
        self._desk = desk
        self._cards: dict[str, DeviceCard] = {}
        self._log: tuple[PresenceChange, ...] | None = None
        with ui.element("div").classes("somrs-fleet"):
            with ui.element("div").classes("somrs-fleet-main"):
                with ui.element("div").classes("somrs-fleet-head"):
                    ui.label("Fleet").classes("somrs-title").props('role="heading" aria-level="1"')
                    self._summary = ui.label().classes("somrs-soft").props('role="status"')
                self._trouble = ui.label().classes("somrs-trouble").props('role="alert"')
                self._trouble.visible = False
                self._devices = ui.element("div").classes("somrs-fleet-devices")
                self._nobody = ui.label("There is no device on the map, and nobody offers a service.").classes("somrs-soft")
            with ui.element("aside").classes("somrs-fleet-side"):
                with ui.element("section").classes("somrs-sheet").props('aria-label="Questions"'):
                    ui.label("Questions to people").classes("somrs-fleet-subtitle").props('role="heading" aria-level="2"')
                    Asked(desk, nobody="Nobody is asked anything.")
                with ui.element("section").classes("somrs-sheet").props('aria-label="Came and went"'):
                    ui.label("Came and went").classes("somrs-fleet-subtitle").props('role="heading" aria-level="2"')
                    self._comings = ui.element("div").classes("somrs-fleet-log").props('role="log"')

    async def read(self) -> None:
        try:
            self._show(await self._desk.fleet.devices())
        except SomrsError as error:
            self._show_trouble(error_report(error))

    async def hear(self, news: News) -> None:
        match news.value:
            case Devices() as devices:
                self._show(devices)
            case ErrorReport() as wrong:
                self._show_trouble(wrong)
            case _:
                await self.read()

    def _show_trouble(self, wrong: ErrorReport) -> None:
        self._trouble.set_text(f"What is shown may be old: {wrong.problem}")
        self._trouble.visible = True

    def _show(self, found: Devices) -> None:
        self._trouble.visible = False
        self._summary.set_text(_summary(found.devices))
        self._nobody.visible = not found.devices
        known = {device.name for device in found.devices}
        for name in [name for name in self._cards if name not in known]:
            self._cards.pop(name).element.delete()
        for index, device in enumerate(found.devices):
            if (card := self._cards.get(device.name)) is not None:
                if card.device != device:
                    card.show(device)
                continue
            with self._devices:
                card = self._cards[device.name] = DeviceCard(device, guarded(self._break))
            if index != len(self._cards) - 1:
                card.element.move(target_index=index)
        if found.log != self._log:
            self._log = found.log
            self._comings.clear()
            with self._comings:
                for one in found.log[:SHOWN]:
                    _coming(one)
                if not found.log:
                    ui.label("Nobody came or went since this window's server was started.").classes("somrs-soft")

    async def _break(self, robot: str, fault: Fault, repair: bool) -> None:
        await self._desk.fleet.fault(robot, fault, repair)
        name = FAULT_LABELS[fault]
        tell(f"{robot}: mended ({name})" if repair else f"{robot}: {name}")
        await self.read()


def _summary(devices: tuple[DeviceView, ...]) -> str:
    def some(count: int, text: str) -> list[str]:
        return [f"{count} {text}"] if count else []

    here = [device for device in devices if device.presence is not Presence.DEPARTED]
    broken = sum(device.state is DeviceState.NOT_WORKING for device in here)
    return " · ".join(
        [
            f"{len(here)} device{'s' if len(here) != 1 else ''}",
            *some(sum(device.presence is Presence.OFFERS for device in here), "on offer"),
            *some(sum(any(one.state in BUSY for one in device.assignments) for device in here), "busy"),
            *some(broken, LABELS[DeviceState.NOT_WORKING].lower()),
            *some(len(devices) - len(here), "gone lately"),
        ]
    )


def _coming(one: PresenceChange) -> None:
    services = listed([service.removeprefix(f"{one.device}.") for service in one.services])
    with ui.element("div").classes("somrs-fleet-coming"):
        ui.icon("login" if one.joined else "logout").props('aria-hidden="true"').classes("somrs-good" if one.joined else "somrs-plain")
        with ui.element("div"):
            ui.label(f"{one.device} {'joined' if one.joined else LEAVING.get(one.reason, one.reason)}")
            ui.label(f"{clock(one.at)} · {services}").classes("somrs-soft")
