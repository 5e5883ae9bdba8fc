"""Who has access: people with their roles, sessions and tokens. Administrators change them; all others see and change what is their own."""

from __future__ import annotations

import asyncio
from typing import Annotated

import msgspec

from somrs.access.identity import Identity, sender
from somrs.access.passwords import MAX_LENGTH, hashed_password, is_right
from somrs.access.rights import PersonRole, Right
from somrs.access.state import Session
from somrs.access.store import AccessStore
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.refusals import Forbidden
from somrs.errors import UsageError
from somrs.storage.audit_log import AuditEntry, AuditLog

DAY = 86400.0


class PersonAccess(msgspec.Struct, frozen=True, kw_only=True):
    """A person who may sign in. `created_at`: seconds since 1970. `provider`: who says so, and in which role; empty: this system.
    `passkeys`: how many the person has."""

    name: str
    role: PersonRole
    has_password: bool
    created_at: float
    provider: str = ""
    passkeys: int = 0


class PasskeyAccess(msgspec.Struct, frozen=True, kw_only=True):
    """A passkey. `host`: the name in the address at which it can be used; times in seconds since 1970; `used_at`: None: never."""

    id: str
    name: str
    host: str
    created_at: float
    used_at: float | None


class TokenAccess(msgspec.Struct, frozen=True, kw_only=True):
    """A token of a program, without what it is proven with. `author`: who made it; times in seconds since 1970."""

    name: str
    rights: frozenset[Right]
    created_at: float
    ends_at: float
    author: str


class AccessView(msgspec.Struct, frozen=True, kw_only=True):
    """Who has access."""

    people: tuple[PersonAccess, ...]
    sessions: tuple[Session, ...]
    tokens: tuple[TokenAccess, ...]


class OwnAccess(msgspec.Struct, frozen=True, kw_only=True):
    """Who sends the request, and may do what. `role`: of a person; None for a program. `session`: the id of the one that is used.
    `provider`: who says who the person is, and in which role; empty: this system."""

    name: str
    role: PersonRole | None
    rights: frozenset[Right]
    has_password: bool
    session: str | None
    sessions: tuple[Session, ...]
    provider: str = ""
    passkeys: tuple[PasskeyAccess, ...] = ()


class NewPerson(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    role: PersonRole = PersonRole.OPERATOR


class NewToken(msgspec.Struct, frozen=True, kw_only=True):
    """A token that is valid for some days."""

    name: str
    rights: frozenset[Right]
    days: Annotated[float, msgspec.Meta(gt=0, le=3650)] = 90.0


class NewPassword(msgspec.Struct, frozen=True, kw_only=True):
    """`current`: the password so far, if there is one."""

    password: Annotated[str, msgspec.Meta(max_length=MAX_LENGTH)]
    current: Annotated[str, msgspec.Meta(max_length=MAX_LENGTH)] = ""


class Secret(msgspec.Struct, frozen=True, kw_only=True):
    """A secret that is shown only once: of a token, or of a link `/sign-in?link=SECRET` of the windows."""

    secret: str


class AuditPage(msgspec.Struct, frozen=True, kw_only=True):
    """Entries of the audit log, newest first. `more`: there are earlier ones."""

    entries: tuple[AuditEntry, ...]
    more: bool


class AccessService:
    def __init__(self, context: Context) -> None:
        self._store, self._audit_log = AccessStore(context.data), AuditLog(context.data)

    @operation("GET", "/access/me", Right.SEE)
    async def me(self) -> OwnAccess:
        """Who sends this request, what it may do, and where the person is signed in."""
        identity, state = _sender(), self._store.read()
        account = state.accounts.get(identity.name) if identity.session is not None else None
        return OwnAccess(
            name=identity.name,
            role=account.role if account is not None else None,
            rights=identity.rights,
            has_password=account is not None and account.password is not None,
            session=identity.session,
            sessions=tuple(s for s in state.sessions.values() if account is not None and s.account == account.name),
            provider=account.provider if account is not None else "",
            passkeys=tuple(
                PasskeyAccess(id=key.id, name=key.name, host=key.host, created_at=key.created_at, used_at=key.used_at)
                for key in (state.passkeys_of(account.name) if account is not None else ())
            ),
        )

    @operation("POST", "/access/me/password", Right.SEE)
    async def set_own_password(self, body: NewPassword) -> None:
        """Set one's own password. It ends one's other sessions."""
        identity = self._person()
        current_hash = self._store.read().account(identity.name).password
        if current_hash is not None and not await asyncio.to_thread(is_right, body.current, current_hash):
            raise Forbidden("the current password is wrong; an administrator can print a sign-in link, and remove the password")
        new_hash = await asyncio.to_thread(hashed_password, body.password)
        self._store.set_password(identity.name, new_hash, kept_session=identity.session)

    @operation("DELETE", "/access/me/sessions/{id}", Right.SEE)
    async def end_own_session(self, id: str) -> None:
        """End a session of one's own."""
        identity = self._person()
        if id not in {session.id for session in self._store.read().sessions.values() if session.account == identity.name}:
            raise UsageError(f"{identity.name} has no session {id}; it may have ended")
        self._store.end_session(id)

    @operation("DELETE", "/access/me/passkeys/{id}", Right.SEE)
    async def remove_own_passkey(self, id: str) -> None:
        """Remove a passkey of one's own, with which one cannot sign in any more."""
        self._store.remove_passkey(self._person().name, id)

    @operation("GET", "/access", Right.ADMINISTER)
    async def read(self) -> AccessView:
        """All people, sessions and tokens."""
        state = self._store.read()
        return AccessView(
            people=tuple(
                PersonAccess(
                    name=account.name,
                    role=account.role,
                    has_password=account.password is not None,
                    created_at=account.created_at,
                    provider=account.provider,
                    passkeys=len(state.passkeys_of(account.name)),
                )
                for account in state.accounts.values()
            ),
            sessions=tuple(state.sessions.values()),
            tokens=tuple(
                TokenAccess(name=t.name, rights=t.rights, created_at=t.created_at, ends_at=t.ends_at, author=t.author)
                for t in state.tokens.values()
            ),
        )

    @operation("GET", "/access/audit", Right.ADMINISTER)
    async def audit(self, limit: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 100, before: int | None = None) -> AuditPage:
        """Who changed what, and what was denied to whom: the entries of the audit log with numbers below `before`, newest first."""
        entries = await asyncio.to_thread(self._audit_log.latest, limit + 1, before)
        return AuditPage(entries=tuple(entries[:limit]), more=len(entries) > limit)

    @operation("POST", "/access/people", Right.ADMINISTER)
    async def add_person(self, body: NewPerson) -> Secret:
        """Add a person, and return the secret of a link to sign in with, once."""
        account = self._store.add_account(body.name, body.role)
        return Secret(secret=self._store.add_link(account.name))

    @operation("POST", "/access/people/{name}/link", Right.ADMINISTER)
    async def make_link(self, name: str) -> Secret:
        """Return the secret of a link with which a person signs in, once, within a day."""
        return Secret(secret=self._store.add_link(name))

    @operation("POST", "/access/people/{name}/role", Right.ADMINISTER)
    async def set_role(self, name: str, role: PersonRole) -> None:
        """Give a person another role, which applies at once."""
        self._store.set_role(name, role)

    @operation("DELETE", "/access/people/{name}", Right.ADMINISTER)
    async def remove_person(self, name: str) -> None:
        """Remove a person, whose sessions end at once."""
        self._store.remove_account(name)

    @operation("DELETE", "/access/people/{name}/password", Right.ADMINISTER)
    async def remove_password(self, name: str) -> None:
        """Remove the password of a person, whose sessions end at once."""
        self._store.set_password(name, None)

    @operation("DELETE", "/access/people/{name}/passkeys", Right.ADMINISTER)
    async def remove_passkeys(self, name: str) -> None:
        """Remove all passkeys of a person, whose sessions end at once."""
        self._store.remove_passkeys(name)

    @operation("DELETE", "/access/sessions/{id}", Right.ADMINISTER)
    async def end_session(self, id: str) -> None:
        """End a session at once."""
        self._store.end_session(id)

    @operation("POST", "/access/tokens", Right.ADMINISTER)
    async def add_token(self, body: NewToken) -> Secret:
        """Make a token for a program."""
        return Secret(secret=self._store.add_token(body.name, body.rights, body.days * DAY, author=_sender().name))

    @operation("DELETE", "/access/tokens/{name}", Right.ADMINISTER)
    async def remove_token(self, name: str) -> None:
        """Revoke a token at once."""
        self._store.remove_token(name)

    def _person(self) -> Identity:
        """Who sends this request. Raises UsageError if that is a program."""
        identity = _sender()
        if identity.session is None:
            raise UsageError("programs have no password and no sessions; sign in with the windows")
        return identity


def _sender() -> Identity:
    identity = sender.get()
    assert identity is not None, "who sends a request was found before"
    return identity
