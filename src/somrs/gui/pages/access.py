"""People and access: one's own account, the certificates of devices, and for administrators all people, sessions and tokens."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui

from somrs.access.rights import PersonRole, Right
from somrs.access.state import Session
from somrs.api.access import AccessView, NewPassword, NewPerson, NewToken, OwnAccess, PersonAccess, TokenAccess
from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.account_menu import ACCESS_PAGE, INSECURE_TEXT, may, who
from somrs.gui.audit_list import AuditList
from somrs.gui.certificate_list import CertificateList
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.icons import format_time
from somrs.gui.panel import panel
from somrs.gui.passkey_list import SCRIPT, PasskeyList
from somrs.gui.shell import guarded, notify, page, page_at

RIGHTS_TEXT = {
    Right.SEE: "see everything",
    Right.STOP: "stop devices",
    Right.OPERATE: "operate (tasks, answers, devices)",
    Right.MODEL: "model (maps, ontologies, templates, zones, devices)",
    Right.ADMINISTER: "administer (people, tokens)",
}
ROLES_TEXT = {
    PersonRole.VIEWER: "viewer: sees, stops in an emergency",
    PersonRole.OPERATOR: "operator: also tasks, answers, devices",
    PersonRole.ENGINEER: "engineer: also maps, ontologies, templates, zones, devices",
    PersonRole.ADMINISTRATOR: "administrator: also people, tokens",
}
USABLE_ONCE = "It works once, within a day."


def register(api: LiveApi) -> None:
    @page_at(ACCESS_PAGE)
    async def show_page() -> None:
        with page("People and access", ACCESS_PAGE, api):
            if who() is None:
                ui.label(INSECURE_TEXT).classes("somrs-sheet somrs-access-note")
                return
            ui.add_head_html(f'<script type="module" src="{SCRIPT}"></script>')
            await _AccessPage(api).build()


class _AccessPage:
    """The panels, built again after each change."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._base = str(ui.context.client.request.base_url).rstrip("/")
        self._content = ui.element("div").classes("somrs-access")

    async def build(self) -> None:
        own_access = await self._api.access.me()
        view = await self._api.access.read() if may(Right.ADMINISTER) else None
        self._content.clear()
        with self._content:
            with panel(own_access.name, "person", "access-own") as own_panel:
                own_panel.note.text = own_access.role or ""
                self._build_own(own_access)
            if may(Right.MODEL):
                with panel("Devices and programs", "verified_user", "access-trust"):
                    CertificateList(self._api, self._change, self.build, self._show_secret).build(await self._api.trust.read())
            if view is not None:
                await self._build_all(view, own_access)

    def _build_own(self, own_access: OwnAccess) -> None:
        ui.label(f"Your rights: {'; '.join(RIGHTS_TEXT[right] for right in Right if right in own_access.rights)}.")
        if own_access.session is None:
            return
        if own_access.provider:
            ui.label(f"You sign in at {own_access.provider}, which says what your role is.")
        else:
            self._build_password(own_access)
            PasskeyList(self._api, self._change, self.build).build(own_access.passkeys)
        self._build_sessions(own_access.sessions, own_access.session, self._api.access.end_own_session, with_names=False)

    def _build_password(self, own_access: OwnAccess) -> None:
        with ui.element("div").classes("somrs-access-form"):
            current = _password("Current password", "current-password") if own_access.has_password else None
            new_password = _password("New password", "new-password")

            async def save() -> None:
                current_text = current.value if current is not None else ""
                await self._api.access.set_own_password(NewPassword(password=new_password.value, current=current_text))
                notify("The password is set; your other sessions have ended")
                await self.build()

            ui.button("Change password" if own_access.has_password else "Set password", on_click=guarded(save)).props("unelevated no-caps")

    async def _build_all(self, view: AccessView, own_access: OwnAccess) -> None:
        with panel("People", "group", "access-people"):
            for person in view.people:
                self._build_person(person, sum(session.account == person.name for session in view.sessions))
            self._build_new_person()
        other_sessions = tuple(session for session in view.sessions if session.account != own_access.name)
        with panel("Sessions of others", "devices", "access-sessions"):
            self._build_sessions(other_sessions, None, self._api.access.end_session, with_names=True)
        with panel("Tokens of programs", "key", "access-tokens"):
            for token in view.tokens:
                self._build_token(token)
            if not view.tokens:
                ui.label("No program has a token.").classes("somrs-soft")
            self._build_new_token()
        with panel("Audit log", "receipt_long", "access-audit"):
            await AuditList(self._api).show_more()

    def _build_person(self, person: PersonAccess, session_count: int) -> None:
        with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="{person.name}"'):
            ui.label(person.name).classes("somrs-access-name")
            sessions = f"{session_count} session{'s' if session_count != 1 else ''}"
            ui.label(f"{sessions}, {_way_in(person)}").classes("somrs-soft")
            roles = [role.value for role in PersonRole]
            select = ui.select(roles, value=person.role.value, label="Role").props("dense outlined").classes("somrs-access-role")
            if person.provider:
                select.props("disable").tooltip(f"{person.provider} says what the role is")
            select.on_value_change(lambda: self._change(self._api.access.set_role(person.name, PersonRole(select.value))))
            if person.passkeys:
                ui.button("Remove passkeys", on_click=lambda: self._remove_passkeys(person.name)).props("flat dense no-caps").tooltip(
                    f"{person.name} has lost a device"
                )
            ui.button("Link", icon="link", on_click=lambda: self._show_link(person.name)).props("flat dense no-caps").tooltip(
                f"Make a link with which {person.name} signs in, once"
            )
            ui.button(icon="person_remove", on_click=lambda: self._remove_person(person.name)).props(
                f'flat round dense aria-label="Remove {person.name}"'
            ).tooltip("Remove")

    def _build_new_person(self) -> None:
        with ui.element("div").classes("somrs-access-form"):
            name = ui.input("Name").props("dense outlined")
            role = ui.select({role.value: text for role, text in ROLES_TEXT.items()}, value=PersonRole.OPERATOR.value, label="Role")
            role.props("dense outlined").classes("somrs-access-role")

            async def add() -> None:
                secret = (await self._api.access.add_person(NewPerson(name=name.value, role=PersonRole(role.value)))).secret
                await self._show_secret(f"Link for {name.value}", self._link(secret), USABLE_ONCE)
                await self.build()

            ui.button("Add person", icon="person_add", on_click=guarded(add)).props("unelevated no-caps")

    def _build_token(self, token: TokenAccess) -> None:
        with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="{token.name}"'):
            ui.label(token.name).classes("somrs-access-name")
            rights = ", ".join(right for right in Right if right in token.rights)
            ui.label(f"{rights}; until {format_time(token.ends_at)}; made by {token.author}").classes("somrs-soft")
            ui.button("Revoke", on_click=lambda: self._revoke(token.name)).props("flat dense no-caps")

    def _build_new_token(self) -> None:
        with ui.element("div").classes("somrs-access-form"):
            name = ui.input("Name of the program").props("dense outlined")
            rights = ui.select(
                {right.value: text for right, text in RIGHTS_TEXT.items()}, value=[Right.SEE.value], label="Rights", multiple=True
            )
            rights.props("dense outlined").classes("somrs-access-role")
            days = ui.number("Days", value=90, min=1, max=3650).props("dense outlined").classes("somrs-access-days")

            async def add() -> None:
                token = NewToken(name=name.value, rights=frozenset(map(Right, rights.value)), days=float(days.value or 0))
                secret = (await self._api.access.add_token(token)).secret
                await self._show_secret(f"Token of {name.value}", secret, "It is not shown again.")
                await self.build()

            ui.button("Make token", icon="add", on_click=guarded(add)).props("unelevated no-caps")

    def _build_sessions(
        self, sessions: tuple[Session, ...], current: str | None, end: Callable[[str], Awaitable[None]], *, with_names: bool
    ) -> None:
        for session in sessions:
            with ui.element("div").classes("somrs-access-row"):
                ui.label(session.account if with_names else "This session" if session.id == current else "Session").classes(
                    "somrs-access-name"
                )
                origin = ", ".join(filter(None, (f"since {format_time(session.created_at)}", session.address, session.browser)))
                ui.label(origin).classes("somrs-soft")
                if session.id != current:
                    ui.button("End", on_click=partial(self._end_session, session.id, end)).props("flat dense no-caps")
        if not sessions:
            ui.label("Nobody else is signed in.").classes("somrs-soft")

    async def _change(self, change: Awaitable[None]) -> None:
        """Make a change, and show what is so then."""
        try:
            await change
        except SomrsError as error:
            notify(str(error), bad=True)
        await self.build()

    async def _end_session(self, id: str, end: Callable[[str], Awaitable[None]]) -> None:
        await self._change(end(id))

    async def _show_link(self, name: str) -> None:
        try:
            secret = (await self._api.access.make_link(name)).secret
        except SomrsError as error:
            notify(str(error), bad=True)
        else:
            await self._show_secret(f"Link for {name}", self._link(secret), USABLE_ONCE)

    async def _remove_person(self, name: str) -> None:
        if await confirm(f"{name} is signed out everywhere, and cannot sign in any more. Records keep the name.", f"Remove {name}"):
            await self._change(self._api.access.remove_person(name))

    async def _remove_passkeys(self, name: str) -> None:
        if await confirm(f"{name} is signed out everywhere, and cannot sign in with a passkey any more.", "Remove passkeys"):
            await self._change(self._api.access.remove_passkeys(name))

    async def _revoke(self, name: str) -> None:
        if await confirm(f"The program {name} has no access any more.", f"Revoke {name}"):
            await self._change(self._api.access.remove_token(name))

    def _link(self, secret: str) -> str:
        return f"{self._base}/sign-in?link={secret}"

    async def _show_secret(self, title: str, text: str, note: str) -> None:
        with self._content, ui.dialog() as dialog, ui.card().props(f'aria-label="{title}"').classes("somrs-dialog"):
            ui.label(title).classes("somrs-title").props('role="heading" aria-level="2"')
            ui.label(text).classes("somrs-access-secret")
            ui.label(note).classes("somrs-soft")
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Copy", icon="content_copy", on_click=lambda: ui.clipboard.write(text)).props("flat no-caps")
                ui.button("Close", on_click=dialog.close).props("unelevated no-caps")
        await dialog
        dialog.delete()


def _way_in(person: PersonAccess) -> str:
    """How a person signs in."""
    if person.provider:
        return f"signs in at {person.provider}"
    password = f"{'with' if person.has_password else 'without'} password"
    return f"{password}, {person.passkeys} passkey{'s' if person.passkeys != 1 else ''}" if person.passkeys else password


def _password(label: str, kind: str) -> ui.input:
    return ui.input(label, password=True).props(f"dense outlined autocomplete={kind}")
