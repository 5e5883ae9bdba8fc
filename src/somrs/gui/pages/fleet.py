"""Fleet: devices and services with their current work, questions to people, and faults of simulated devices."""

from __future__ import annotations

from nicegui import ui

from somrs.api.assignments import BUSY
from somrs.api.device_state import FAULT_LABELS, LABELS, DeviceState
from somrs.api.fleet import Devices, DeviceView, Presence
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.client.refusals import ErrorReport, error_report
from somrs.devices.simulator.link.commands import Fault
from somrs.errors import SomrsError
from somrs.gui.device_card import LEAVING, DeviceCard
from somrs.gui.device_orders import DeviceOrders
from somrs.gui.icons import format_time, join_names
from somrs.gui.news import follow
from somrs.gui.people_panel import PeoplePanel
from somrs.gui.question_panel import QuestionPanel
from somrs.gui.shell import guarded, notify, page, page_at
from somrs.protocol.messages.directory import PresenceChange

MAX_LOG_ENTRIES = 30
"""Number of arrivals and departures in the list."""


def register(api: LiveApi) -> None:
    @page_at("/fleet")
    async def show_page() -> None:
        with page("Fleet", "/fleet", api):
            fleet = _Fleet(api)
            await fleet.read()
            follow(api.context.hub, "fleet", fleet.read, fleet.hear)


class _Fleet:
    """The page's content, updated in place."""

    def __init__(self, api: LiveApi) -> None:
        self._api, self._orders = api, DeviceOrders(api)
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
                self._empty_label = ui.label("There are no devices on the map, and no services on offer.").classes("somrs-soft")
            with ui.element("aside").classes("somrs-fleet-side"):
                with ui.element("section").classes("somrs-sheet").props('aria-label="Questions"'):
                    ui.label("Questions to people").classes("somrs-fleet-subtitle").props('role="heading" aria-level="2"')
                    QuestionPanel(api, empty_text="No open questions.")
                with ui.element("section").classes("somrs-sheet").props('aria-label="People"'):
                    ui.label("People").classes("somrs-fleet-subtitle").props('role="heading" aria-level="2"')
                    PeoplePanel(api)
                with ui.element("section").classes("somrs-sheet").props('aria-label="Arrivals and departures"'):
                    ui.label("Arrivals and departures").classes("somrs-fleet-subtitle").props('role="heading" aria-level="2"')
                    self._log_list = ui.element("div").classes("somrs-fleet-log").props('role="log"')

    async def read(self) -> None:
        try:
            self._show_devices(await self._api.fleet.devices())
        except SomrsError as error:
            self._show_trouble(error_report(error))

    async def hear(self, news: News) -> None:
        match news.value:
            case Devices() as devices:
                self._show_devices(devices)
            case ErrorReport() as wrong:
                self._show_trouble(wrong)
            case _:
                await self.read()

    def _show_trouble(self, wrong: ErrorReport) -> None:
        self._trouble.set_text(f"The data may be outdated: {wrong.problem}")
        self._trouble.visible = True

    def _show_devices(self, devices: Devices) -> None:
        self._trouble.visible = False
        self._summary.set_text(_summary(devices.devices))
        self._empty_label.visible = not devices.devices
        device_names = {device.name for device in devices.devices}
        for name in [name for name in self._cards if name not in device_names]:
            self._cards.pop(name).element.delete()
        for index, device in enumerate(devices.devices):
            if (card := self._cards.get(device.name)) is not None:
                if card.device != device:
                    card.show_device(device)
                continue
            with self._devices:
                card = self._cards[device.name] = DeviceCard(device, guarded(self._break), self._orders)
            if index != len(self._cards) - 1:
                card.element.move(target_index=index)
        if devices.log != self._log:
            self._log = devices.log
            self._log_list.clear()
            with self._log_list:
                for entry in devices.log[:MAX_LOG_ENTRIES]:
                    _log_row(entry)
                if not devices.log:
                    ui.label("No arrivals or departures yet.").classes("somrs-soft")

    async def _break(self, device: str, fault: Fault, repair: bool) -> None:
        await self._api.fleet.fault(device, fault, repair)
        name = FAULT_LABELS[fault]
        notify(f"{device}: repaired ({name})" if repair else f"{device}: {name}")
        await self.read()


def _summary(devices: tuple[DeviceView, ...]) -> str:
    def count_text(count: int, text: str) -> list[str]:
        return [f"{count} {text}"] if count else []

    present_devices = [device for device in devices if device.presence is not Presence.DEPARTED]
    broken = sum(device.state is DeviceState.NOT_WORKING for device in present_devices)
    return " · ".join(
        [
            f"{len(present_devices)} device{'s' if len(present_devices) != 1 else ''}",
            *count_text(sum(device.presence is Presence.OFFERS for device in present_devices), "on offer"),
            *count_text(sum(any(activity.state in BUSY for activity in device.assignments) for device in present_devices), "busy"),
            *count_text(broken, LABELS[DeviceState.NOT_WORKING].lower()),
            *count_text(len(devices) - len(present_devices), "left recently"),
        ]
    )


def _log_row(entry: PresenceChange) -> None:
    services = join_names([service.removeprefix(f"{entry.device}.") for service in entry.services])
    with ui.element("div").classes("somrs-fleet-coming"):
        ui.icon("login" if entry.joined else "logout").props('aria-hidden="true"').classes("somrs-good" if entry.joined else "somrs-plain")
        with ui.element("div"):
            origin = f" of {entry.registry}" if entry.registry else ""
            ui.label(f"{entry.device}{origin} {'joined' if entry.joined else LEAVING.get(entry.reason, entry.reason)}")
            ui.label(f"{format_time(entry.at)} · {services}").classes("somrs-soft")
