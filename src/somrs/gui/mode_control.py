"""Fire, emergency and out of order: the menu in the header of every page, and the banner while something is not in its normal mode."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.account_menu import only_with
from somrs.gui.author import author
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.news import follow_values
from somrs.ontology.modes import Mode, modes, reason_of
from somrs.ontology.types import MODE

_ALARMS = {Mode.FIRE: ("Fire alarm", "local_fire_department"), Mode.EMERGENCY: ("Emergency", "emergency")}
_CONSEQUENCES = {
    Mode.FIRE: "All robots stand still where they may stand, and tasks wait.",
    Mode.EMERGENCY: "All robots stand still where they may stand, and tasks wait.",
    Mode.OUT_OF_ORDER: "Robots go another way, or wait.",
}


class Modes:
    """What a page does about modes: it sets them, after the user has confirmed it."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api

    @property
    def current(self) -> dict[str, Mode]:
        """The objects that are not in their normal mode."""
        return modes(self._api.context.map)

    def of_type(self, type: str) -> list[str]:
        """The objects of a type or of its subtypes."""
        map, ontology = self._api.context.map, self._api.context.ontology
        return sorted(name for kind in ontology.types if ontology.is_subtype(kind, type) for name in map.of_type(kind))

    async def set(self, name: str, mode: Mode) -> None:
        """Set the mode of a building, a lift or a door."""
        kind = next(type for type in ("Building", "Lift", "Door") if name in self.of_type(type))
        try:
            await self._api.control.set_mode(mode, **{kind.lower(): name}, by=author())
        except SomrsError as error:
            ui.notify(f"The mode of {name} is not changed: {error}", type="negative", timeout=0, close_button="Close")


class ModeControl:
    """A menu with the modes that an operator can set."""

    def __init__(self, api: LiveApi) -> None:
        self._modes = Modes(api)
        with ui.button(icon="notification_important", on_click=self._build) as button:
            button.props('flat round dense aria-label="Fire, emergency, out of order"').classes("somrs-turn")
            ui.tooltip("Fire, emergency, out of order")
            self._menu = ui.menu().props("auto-close no-parent-event")
        only_with(Right.OPERATE, button)

    def _build(self) -> None:
        self._menu.clear()
        with self._menu:
            for name in self._modes.of_type("Building"):
                for mode, (label, icon) in _ALARMS.items():
                    self._add_item(f"{label} in {name} …", icon, partial(self._alarm, name, mode))
            if self._passages:
                self._add_item("A lift or a door is out of order …", "do_not_disturb_on", self._take_out_of_order)
            if not self._modes.of_type("Building") and not self._passages:
                ui.menu_item("There is no building, lift or door on the map").props("disable")
        self._menu.open()

    @property
    def _passages(self) -> list[str]:
        return [*self._modes.of_type("Lift"), *self._modes.of_type("Door")]

    def _add_item(self, text: str, icon: str, on_click: Callable[[], Awaitable[None]]) -> None:
        with ui.menu_item(on_click=on_click):
            ui.icon(icon).classes("somrs-menu-icon").props('aria-hidden="true"')
            ui.label(text)

    async def _alarm(self, name: str, mode: Mode) -> None:
        label, _ = _ALARMS[mode]
        if await confirm(f"{label} in {name}? {_CONSEQUENCES[mode]}", label):
            await self._modes.set(name, mode)

    async def _take_out_of_order(self) -> None:
        with ui.dialog().props('aria-label="What is out of order"') as dialog, ui.card().classes("somrs-dialog"):
            ui.label(f"Which lift or door is out of order? {_CONSEQUENCES[Mode.OUT_OF_ORDER]}")
            choices = [Choice(value=name) for name in self._passages if name not in self._modes.current]
            Picker("Lift or door", placeholder="Choose the lift or the door", options=choices, on_pick=dialog.submit)
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps")
        name = await dialog
        dialog.delete()
        if name is not None:
            await self._modes.set(str(name), Mode.OUT_OF_ORDER)


class ModeBanner:
    """What is not in its normal mode, with a button that ends that."""

    def __init__(self, api: LiveApi) -> None:
        self._modes = Modes(api)
        self._displayed_modes: dict[str, Mode] = {}
        self._element = ui.element("div").classes("somrs-modes").props('role="status"')
        self._show()
        follow_values(api, MODE, self._show)

    def _show(self) -> None:
        current = self._modes.current
        self._element.visible = bool(current)
        if current == self._displayed_modes:
            return
        self._displayed_modes = current
        self._element.clear()
        with self._element:
            for name, mode in sorted(current.items(), key=lambda entry: (entry[1] is Mode.OUT_OF_ORDER, entry[0])):
                with ui.element("div").classes(f"somrs-mode somrs-mode-{'alarm' if mode in _ALARMS else 'order'}"):
                    ui.icon(_ALARMS[mode][1] if mode in _ALARMS else "do_not_disturb_on").props('aria-hidden="true"')
                    ui.label(_banner_text(name, mode))
                    button = ui.button("Back to normal", on_click=partial(self._end, name, mode)).props("outline no-caps dense")
                    button.props(f'aria-label="{name} back to normal"')

    async def _end(self, name: str, mode: Mode) -> None:
        follows = "Robots go on." if mode in _ALARMS else "Robots use it again."
        if await confirm(f"Is {name} back to normal? {follows}", "Back to normal"):
            await self._modes.set(name, Mode.NORMAL)


def _banner_text(name: str, mode: Mode) -> str:
    """Such as `Fire alarm in Building1: all robots stand still ...`."""
    reason, consequence = reason_of(name, mode), _CONSEQUENCES[mode]
    return f"{reason[0].upper()}{reason[1:]}: {consequence[0].lower()}{consequence[1:]}"
