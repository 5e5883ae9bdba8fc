"""Who has a certificate of the site, and who is invited to one. Engineers invite devices; administrators invite all, and revoke."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from typing import Annotated

import msgspec

from somrs.access.auditor import Auditor, current_actor
from somrs.access.identity import sender
from somrs.access.rights import Right, least_role
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.refusals import Forbidden
from somrs.trust.authority import Authority
from somrs.trust.credentials import SERVICE_FILE
from somrs.trust.identity import Identity, Role

Names = tuple[Annotated[str, msgspec.Meta(min_length=1, max_length=200)], ...]


class CertificateHolder(msgspec.Struct, frozen=True, kw_only=True):
    """Who has a certificate that holds. `until`: of the one that holds longest, in seconds since 1970. `hosts`: where it is reached.
    `topics`: filters of the topics that it may use at the bus by MQTT. `is_own`: it is a program of the system itself, which
    has a new one after a revocation."""

    name: str
    roles: tuple[Role, ...]
    speaks_for: tuple[str, ...]
    topics: tuple[str, ...]
    hosts: tuple[str, ...]
    until: float
    is_own: bool


class InvitedDevice(msgspec.Struct, frozen=True, kw_only=True):
    """Who may enrol itself once, until `until` (seconds since 1970)."""

    name: str
    roles: tuple[Role, ...]
    until: float


class TrustView(msgspec.Struct, frozen=True, kw_only=True):
    """Who has a certificate, and who is invited. `has_authority`: the authority of the site is in the data folder of this system; without
    it, programs do not prove who they are, or another computer has it."""

    has_authority: bool
    holders: tuple[CertificateHolder, ...] = ()
    invitations: tuple[InvitedDevice, ...] = ()


class NewInvitation(msgspec.Struct, frozen=True, kw_only=True):
    """`speaks_for`: devices in whose names it speaks besides its own. `topics`: filters of the topics that it may use at the bus by MQTT.
    `hosts`: where it is reached; by default, where it enrols from."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    roles: tuple[Role, ...] = (Role.DEVICE,)
    speaks_for: Names = ()
    topics: Names = ()
    hosts: Names = ()


class Invited(msgspec.Struct, frozen=True, kw_only=True):
    """`secret`: the word with which it enrols, shown only once. `service`: the URL at which other computers enrol; empty if the service of
    the authority does not run."""

    secret: str
    service: str


class TrustService:
    def __init__(self, context: Context) -> None:
        self._authority, self._auditor = Authority.of_data(context.data), Auditor(context.data)

    @operation("GET", "/trust", Right.MODEL)
    async def read(self) -> TrustView:
        """Who has a certificate, and who is invited to one."""
        if not self._authority.exists:
            return TrustView(has_authority=False)
        register, now = await asyncio.to_thread(self._authority.read), _now().timestamp()
        own_names = {file.stem for file in (self._authority.folder / "programs").glob("*.pem")}
        holders = {
            entry.name: CertificateHolder(
                name=entry.name,
                roles=entry.roles,
                speaks_for=entry.speaks_for,
                topics=entry.topics,
                hosts=entry.hosts,
                until=entry.ends,
                is_own=entry.name in own_names,
            )
            for entry in sorted(register.certificates, key=lambda entry: entry.ends)
            if entry.revoked_at is None and entry.ends > now
        }
        invitations = (InvitedDevice(name=i.name, roles=i.roles, until=i.ends) for i in register.invitations if i.ends > now)
        return TrustView(has_authority=True, holders=tuple(holders[name] for name in sorted(holders)), invitations=tuple(invitations))

    @operation("POST", "/trust/invitations", Right.MODEL)
    async def invite(self, body: NewInvitation) -> Invited:
        """Let a device, a thing or a program enrol itself once, within an hour. Other roles than `device` and `thing` need the right to
        administer."""
        identity = sender.get()
        if {*body.roles} - {Role.DEVICE, Role.THING} and (identity is None or Right.ADMINISTER not in identity.rights):
            raise Forbidden(f"only who is {least_role(Right.ADMINISTER)} invites others than devices and things")
        speaks_for, topics = frozenset(body.speaks_for), frozenset(body.topics)
        invited = Identity(name=body.name, roles=frozenset(body.roles), speaks_for=speaks_for, topics=topics)
        word = await asyncio.to_thread(lambda: self._authority.invite(invited, _now(), hosts=body.hosts))
        service_file = self._authority.folder / SERVICE_FILE
        return Invited(secret=word, service=service_file.read_text().strip() if service_file.exists() else "")

    @operation("DELETE", "/trust/holders/{name}", Right.ADMINISTER)
    async def revoke(self, name: str) -> None:
        """Revoke all certificates and invitations of a name, also on open connections."""
        serials = await asyncio.to_thread(self._authority.revoke, name, _now())
        self._auditor.done("trust.revoke", current_actor(), {"name": name, "serials": serials})


def _now() -> datetime:
    return datetime.now(UTC)
