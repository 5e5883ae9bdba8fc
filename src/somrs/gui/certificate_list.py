"""Devices and programs with a certificate of the site, and those that are invited, on the page People and access."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.remote import LiveApi
from somrs.api.trust import CertificateHolder, InvitedDevice, NewInvitation, TrustView
from somrs.gui.account_menu import may
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.icons import format_time
from somrs.gui.shell import guarded
from somrs.trust.identity import Role

WITHOUT = "The authority of the site is not in the data folder of this system: `somrs trust` works where it is."


class CertificateList:
    """The list, with a form to invite a device. `change`: makes a change, and shows the page again, as `rebuild` does without a change.
    `show_secret`: shows a title, a secret and a note."""

    def __init__(
        self,
        api: LiveApi,
        change: Callable[[Awaitable[None]], Awaitable[None]],
        rebuild: Callable[[], Awaitable[None]],
        show_secret: Callable[[str, str, str], Awaitable[None]],
    ) -> None:
        self._api, self._change, self._rebuild, self._show_secret = api, change, rebuild, show_secret

    def build(self, view: TrustView) -> None:
        if not view.has_authority:
            ui.label(WITHOUT).classes("somrs-soft")
            return
        for invited in view.invitations:
            self._build_invited(invited)
        for holder in sorted(view.holders, key=lambda holder: holder.is_own):
            self._build_holder(holder)
        self._build_form()

    def _build_holder(self, holder: CertificateHolder) -> None:
        with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="{holder.name}"'):
            ui.label(holder.name).classes("somrs-access-name")
            own = "; a program of this system" if holder.is_own else ""
            spoken = f"; speaks for {', '.join(holder.speaks_for)}" if holder.speaks_for else ""
            topics = f"; at topics {', '.join(holder.topics)}" if holder.topics else ""
            ui.label(f"{', '.join(holder.roles)}; until {format_time(holder.until)}{spoken}{topics}{own}").classes("somrs-soft")
            if may(Right.ADMINISTER) and not holder.is_own:
                ui.button("Revoke", on_click=partial(self._revoke, holder.name)).props("flat dense no-caps")

    def _build_invited(self, invited: InvitedDevice) -> None:
        with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="{invited.name}, invited"'):
            ui.label(invited.name).classes("somrs-access-name")
            ui.label(f"invited as {', '.join(invited.roles)}, until {format_time(invited.until)}").classes("somrs-soft")
            if may(Right.ADMINISTER):
                ui.button("Withdraw", on_click=partial(self._revoke, invited.name)).props("flat dense no-caps")

    def _build_form(self) -> None:
        with ui.element("div").classes("somrs-access-form"):
            name = ui.input("Name of the device").props("dense outlined")
            spoken = ui.input("Also speaks for").props("dense outlined").tooltip("Devices in whose names it speaks, separated by commas")
            topics = ui.input("Topics").props("dense outlined").tooltip("Of MQTT, such as uagv/v2/ACME/0001/#, separated by commas")
            hosts = ui.input("Reached at").props("dense outlined").tooltip("Names or IP addresses; by default, where it enrols from")
            roles = [role.value for role in (Role if may(Right.ADMINISTER) else (Role.DEVICE, Role.THING))]
            role = ui.select(roles, value=Role.DEVICE.value, label="Role").props("dense outlined").classes("somrs-access-role")

            async def invite() -> None:
                invitation = NewInvitation(
                    name=name.value.strip(),
                    roles=(Role(role.value),),
                    speaks_for=_names(spoken.value),
                    topics=_names(topics.value),
                    hosts=_names(hosts.value),
                )
                invited = await self._api.trust.invite(invitation)
                service = f" --at {invited.service}" if invited.service else ""
                await self._show_secret(
                    f"Invitation of {invitation.name}",
                    f"somrs trust enrol {invited.secret}{service}",
                    "On the computer of the device, once, within an hour. It is not shown again.",
                )
                await self._rebuild()

            ui.button("Invite", icon="add", on_click=guarded(invite)).props("unelevated no-caps")

    async def _revoke(self, name: str) -> None:
        if await confirm(f"{name} cannot take part any more, until it enrols with a new invitation.", f"Revoke {name}"):
            await self._change(self._api.trust.revoke(name))


def _names(text: str) -> tuple[str, ...]:
    return tuple(filter(None, (name.strip() for name in text.split(","))))
