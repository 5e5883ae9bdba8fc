"""One device on the Fleet page: type, presence, current work, services with their statistics, faults."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from urllib.parse import urlencode

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.assignments import BUSY, Assignment
from somrs.api.device_state import FAULT_LABELS, LABELS, DeviceState
from somrs.api.fleet import DeviceView, Presence, ServiceView
from somrs.devices.simulator.link.commands import Fault
from somrs.gui.account_menu import only_with
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.device_orders import DeviceOrders
from somrs.gui.icons import Badge, Gauge, Sign, format_time, join_names
from somrs.protocol.messages.event_text import short_id

ICONS = {
    "Person": "person",
    "Camera": "videocam",
    "Lift": "elevator",
    "Door": "sensor_door",
    "MobileManipulator": "precision_manufacturing",
    "StationaryManipulator": "precision_manufacturing",
    "MobileRobot": "smart_toy",
}
"""Icons by type; the nearest ancestor type in this mapping decides."""

FAULTS = {
    Fault.DRIVE: ("Break the drive", "Repair the drive"),
    Fault.GRIPPER: ("Jam the gripper", "Repair the gripper"),
    Fault.SILENT: ("Stop its messages", "Resume its messages"),
    Fault.LINK: ("Cut the link", "Restore the link"),
}
"""Labels for causing a fault and for repairing it."""

SIGNS = {
    DeviceState.READY: ("check_circle", "good"),
    DeviceState.BUSY: ("play_circle", "busy"),
    DeviceState.BOOKED: ("event", "busy"),
    DeviceState.NOT_WORKING: ("error", "bad"),
    DeviceState.STOPPED: ("front_hand", "bad"),
    DeviceState.OUT_OF_SERVICE: ("do_not_disturb_on", "plain"),
    DeviceState.NOTHING_ON_OFFER: ("cloud_off", "busy"),
    DeviceState.DEPARTED: ("logout", "plain"),
}
"""Icon and tone of each state."""

LEAVING = {
    "expired": "stopped responding",
    "retracted": "withdrew its services",
    "outdated": "offers services whose types are now defined otherwise",
    "away": "belongs to a neighbour that stopped responding",
    "withheld": "offers services that are withheld here",
}
"""Labels for the Registry's reasons of departure."""

_NO_BREAK = "\N{NO-BREAK SPACE}"

Break = Callable[[str, Fault, bool], Awaitable[None]]
"""Causes a fault of a device or, if True, repairs it."""


def _icon(device: DeviceView) -> str:
    return next((ICONS[name] for name in device.lineage if name in ICONS), "memory")


def state(device: DeviceView) -> Sign:
    """The device's main state."""
    icon, tone = SIGNS[device.state]
    return Sign(icon, LABELS[device.state], tone)


def origin(device: DeviceView) -> str:
    """Whose device it is, if it belongs to a neighbour."""
    return f"from {device.registry}" if device.registry else ""


class DeviceCard:
    """The card is updated in place, so that an open menu and the focus stay."""

    def __init__(self, device: DeviceView, break_or_mend: Break, orders: DeviceOrders) -> None:
        self._break, self._orders = break_or_mend, orders
        self.device = device
        with ui.element("article").classes("somrs-device").props(f'aria-label="{device.name}"') as self.element:
            with ui.element("header").classes("somrs-device-head"):
                self._icon = ui.icon(_icon(device)).classes("somrs-device-icon").props('aria-hidden="true"')
                with ui.element("div").classes("somrs-device-name"):
                    self._name = ui.label().classes("somrs-device-title").props('role="heading" aria-level="2"')
                    self._place_label = ui.label().classes("somrs-soft")
                self._state = Badge(state(device))
                self._order_menu = RebuiltElement()
                self._menu = RebuiltElement()
            self._problem = ui.label().classes("somrs-device-note somrs-bad-text").props('role="status"')
            self._note = ui.label().classes("somrs-device-note")
            self._faults = RebuiltElement().classes("somrs-device-faults")
            self._activities = RebuiltElement().classes("somrs-device-doing")
            with ui.element("div").classes("somrs-device-gauges"):
                self._work = Gauge("Step", "Progress of the step")
                self._utilisation = Gauge("Utilisation", "Share of the last 10 minutes in which the device was at work")
                self._charge = Gauge("Battery", "Remaining charge")
            self._services = RebuiltElement().classes("somrs-device-services").props('role="list" aria-label="Services"')
        self.show_device(device)

    def show_device(self, device: DeviceView) -> None:
        self.device = device
        self._icon.name = _icon(device)
        self._name.set_text(device.name)
        self._place_label.set_text(
            " · ".join(part for part in (device.label or "", device.type, origin(device), _position_text(device)) if part)
        )
        self._state.show_sign(state(device))
        self.element.classes(**{"add" if device.presence is Presence.DEPARTED else "remove": "somrs-device-gone"})
        has_badges = device.simulated is not None and bool(device.simulated.faults)
        self._problem.set_text(problem_sentence(device) if not has_badges else "")
        self._problem.visible = bool(self._problem.text)
        self._note.set_text(_note(device))
        self._note.visible = bool(self._note.text)
        if device.presence is Presence.DEPARTED:
            self._order_menu.clear()
        else:
            order_key = (device.paused, device.in_service, tuple(service.type for service in device.services))
            self._order_menu.show(order_key, self._build_orders)
        faults, possible_faults = (device.simulated.faults, device.simulated.possible_faults) if device.simulated is not None else ((), ())
        if possible_faults:
            self._menu.show((faults, possible_faults), lambda: self._build_menu(faults, possible_faults))
        else:
            self._menu.clear()
        self._faults.visible = bool(faults)
        self._faults.show(faults, lambda: self._build_faults(faults))
        self._activities.visible = bool(device.assignments)
        notes = () if device.waiting else tuple(activity.note for activity in device.assignments)
        activities = [(activity.task, activity.step, activity.state, activity.service) for activity in device.assignments]
        self._activities.show((activities, notes), self._build_activities)
        self._services.show(device.services, self._build_services)
        fraction = next((activity.fraction for activity in device.assignments if activity.state in BUSY), None)
        self._work.element.visible = fraction is not None
        self._work.show_share(fraction or 0.0, f"{100 * (fraction or 0):.0f} %", "busy")
        self._utilisation.element.visible = device.presence is not Presence.DEPARTED
        self._utilisation.show_share(device.utilisation, f"{100 * device.utilisation:.0f} %")
        self._charge.element.visible = device.charge is not None
        charge = device.charge or 0.0
        self._charge.show_share(charge / 100, f"{charge:.0f} %", "bad" if charge < 15 else "good")

    def _build_orders(self) -> None:
        device, orders = self.device, self._orders
        offered = {service.type for service in device.services}
        with ui.button(icon="more_vert").props(f'flat round dense aria-label="Orders to {device.name}"').classes("somrs-turn"), ui.menu():
            self._order("play_arrow", "Go on", orders.release) if device.paused else self._order("front_hand", "Stop", orders.stop)
            if "MoveTo" in offered:
                self._order("place", "Go to …", orders.go)
            if "ChargeBattery" in offered:
                self._order("battery_charging_full", "Charge", orders.charge)
            if device.simulated is not None and "MobileRobot" in device.lineage:
                self._order("open_with", "Put elsewhere …", orders.put)
            if device.in_service:
                self._order("do_not_disturb_on", "Take out of service", orders.retire)
            else:
                self._order("check_circle", "Back into service", orders.reinstate)

    def _order(self, icon: str, label: str, act: Callable[[str], Awaitable[None]]) -> None:
        with ui.menu_item(on_click=lambda: act(self.device.name)):
            ui.icon(icon).classes("somrs-menu-icon").props('aria-hidden="true"')
            ui.label(label)

    def _build_menu(self, faults: tuple[Fault, ...], possible_faults: tuple[Fault, ...]) -> None:
        with ui.button(icon="bolt").props(f'flat round dense aria-label="Faults of {self.device.name}"') as button:
            button.classes("somrs-turn")
            only_with(Right.OPERATE, button)
            ui.tooltip("Cause or repair a fault of this simulated device").props('anchor="top middle" self="bottom middle"')
            with ui.menu():
                for fault in possible_faults:
                    broken, (breaks, mends) = fault in faults, FAULTS[fault]
                    with ui.menu_item(on_click=lambda fault=fault, broken=broken: self._break(self.device.name, fault, broken)):
                        ui.icon("build" if broken else "flash_on").classes("somrs-menu-icon").props('aria-hidden="true"')
                        ui.label(mends if broken else breaks)

    def _build_faults(self, faults: tuple[Fault, ...]) -> None:
        for fault in faults:
            Badge(Sign("warning", FAULT_LABELS[fault].capitalize(), "bad"))

    def _build_activities(self) -> None:
        for activity in self.device.assignments:
            with ui.element("div"):
                ui.label("now" if activity.state in BUSY else "next").classes("somrs-soft somrs-device-when")
                with ui.link(target=f"/tasks/{activity.task}").classes("somrs-device-task"):
                    ui.label(activity_text(activity))
                    ui.label(f"for {activity.effect}").classes("somrs-formula somrs-soft")
                    if activity.note and not self.device.waiting:
                        ui.label(activity.note).classes("somrs-soft")

    def _build_services(self) -> None:
        for service in self.device.services:
            _service(service)
        if not self.device.services:
            ui.label("No services.").classes("somrs-soft").props('role="listitem"')


def _service(service: ServiceView) -> None:
    price = f"{service.price:g} EUR" if service.price is not None else ""
    with ui.element("div").props('role="listitem"').classes("somrs-device-service"):
        ui.label(service.type).classes("somrs-device-service-name").tooltip(f"effect: {service.effect}")
        ui.label(price if service.on_offer else "not on offer").classes("somrs-soft")
        tally = service.tally.in_words()
        if service.tally.started:
            ui.link(tally, f"/history?{urlencode({'service': service.service})}").classes("somrs-device-tally somrs-history-link")
        else:
            ui.label(tally).classes("somrs-soft somrs-device-tally")


def activity_text(activity: Assignment) -> str:
    """The service and its objects: `TransferObject: Jar002 and Table001`."""
    return f"{activity.service_type}: {join_names([*activity.inputs.values()])}" if activity.inputs else activity.service_type


def _position_text(device: DeviceView) -> str:
    if device.place is not None and "Lift" in device.lineage:
        return f"at {device.place}"
    if device.simulated is not None:
        x, y = device.simulated.x, device.simulated.y
    elif device.position is not None:
        x, y = device.position[:2]
    else:
        return ""
    return f"at {x:.1f}, {y:.1f} m".replace(" ", _NO_BREAK)


def problem_sentence(device: DeviceView) -> str:
    """Why the device does not work; empty if it does, or if nobody has said why."""
    return f"It {device.problem}{'' if device.problem.endswith(('.', '?', '!')) else '.'}" if device.problem else ""


def _note(device: DeviceView) -> str:
    """Departure, held objects and current command, in sentences; empty if there is nothing to report."""
    parts: list[str] = []
    if device.departed_at is not None:
        parts.append(f"It {LEAVING.get(device.reason, device.reason)} at {format_time(device.departed_at)}.")
    held = device.simulated.holding if device.simulated is not None else None
    holding = join_names([*dict.fromkeys([*((held,) if held else ()), *device.holding])])
    if holding:
        parts.append(f"It {'carries' if 'Lift' in device.lineage else 'holds'} {holding}.")
    if device.simulated is not None and device.simulated.command:
        parts.append(f"It is {COMMAND_LABELS.get(device.simulated.command, f'doing {device.simulated.command}')}.")
    if device.paused_for is not None:
        parts.append(f"It stands still because task {short_id(device.paused_for)} is paused.")
    if device.waiting:
        parts.append(f"It {device.waiting}.")
    return " ".join(parts)


COMMAND_LABELS = {
    "DriveTo": "driving",
    "Approach": "driving up to something",
    "Grip": "gripping",
    "Place": "putting something down",
    "PutDown": "putting something down",
    "Insert": "putting something inside",
    "Open": "opening",
    "Close": "closing",
    "MoveCabin": "taking its cabin to a storey",
    "ServePassage": "opening for robots",
    "Charge": "charging",
    "Weigh": "weighing something",
    "LookAt": "looking at something",
    "LookAround": "looking around",
    "Stop": "stopping",
}
"""Labels of the robot link's commands."""
