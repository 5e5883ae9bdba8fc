"""The file of `--oidc`: the OpenID Connect provider at which people sign in, and which role they have for what it says of them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgspec
from msgspec import Struct

from somrs.access.rights import PersonRole
from somrs.errors import UsageError
from somrs.ontology.files.nodes import Source

ADVICE = (
    "`issuer` is the provider's address, and `client` the id of this system there; `label`, `secret_file`, `scopes`, `claim`, `roles`, "
    "`everyone` and `hours` may follow"
)

LOCAL_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
"""Hosts of providers that need no encryption: what is sent to them does not leave this computer."""


class OidcSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A provider, and who may do what.

    `client`: the id of this system at the provider. `secret_file`: the file with its secret there, relative to that of the settings; empty
    if it has none. `label`: the provider's name for people; empty: its host. `claim`: what the provider says of a person that `roles` are
    for, such as its groups; a dot leads into an object. Of several roles, that with most rights counts. `everyone`: the role of whoever
    signs in there; None: who has none of `roles` is not let in. `hours`: how long one stays signed in.
    """

    issuer: str
    client: str
    secret_file: str = ""
    label: str = ""
    scopes: tuple[str, ...] = ("openid", "profile", "email")
    claim: str = "groups"
    roles: dict[str, PersonRole] = {}
    everyone: PersonRole | None = None
    hours: Annotated[float, msgspec.Meta(gt=0, le=720)] = 12.0
    secret: str = ""
    """The content of `secret_file`, when it has been read."""

    @property
    def name(self) -> str:
        """The provider's name for people."""
        return self.label or urlsplit(self.issuer).hostname or self.issuer

    def role(self, claims: Mapping[str, Any]) -> PersonRole | None:
        """The role of a person of whom the provider says this; None if it has none."""
        texts = values_of(claims, self.claim)
        roles = {role for text in texts if (role := self.roles.get(text)) is not None} | ({self.everyone} if self.everyone else set())
        return max(roles, key=[*PersonRole].index, default=None)


def values_of(claims: Mapping[str, Any], claim: str) -> tuple[str, ...]:
    """The texts of a claim, which is one or a list; none if there is no such claim. Names of claims may be URLs, which have dots, too."""
    value: Any = claims
    for key in (claim,) if claim in claims else claim.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    texts = value if isinstance(value, list) else [value]
    return tuple(text for text in texts if isinstance(text, str))


def read_oidc_settings(file: Path) -> OidcSettings:
    """The settings in a file. Raises UsageError for a file that cannot be read, or is not as it should be."""
    text = _text_of(file, "the provider's settings")
    source = Source(str(file), text)
    if source.problems:
        raise UsageError("\n".join(map(str, source.problems)))
    if isinstance(source.data, dict) and "secret" in source.data:
        raise UsageError(f"{file}: the secret has a file of its own; write its name: secret_file: client.secret")
    try:
        settings = msgspec.convert(source.data, OidcSettings)
    except msgspec.ValidationError as error:
        raise UsageError(f"{file}: {error}; {ADVICE}") from None
    address = urlsplit(settings.issuer)
    if address.scheme != "https" and not (address.scheme == "http" and address.hostname in LOCAL_HOSTS):
        raise UsageError(f"{file}: issuer: {settings.issuer!r} has to begin with https://, so that nobody can answer in its place")
    if "openid" not in settings.scopes:
        raise UsageError(f"{file}: scopes: `openid` is missing, without which the provider does not say who signs in")
    if not settings.roles and settings.everyone is None:
        raise UsageError(f"{file}: nobody has a role; write `roles: {{GROUP: operator}}`, or `everyone: viewer`")
    if settings.secret_file:
        secret = _text_of(file.parent / settings.secret_file, "the secret of the client").strip()
        return msgspec.structs.replace(settings, secret=secret)
    return settings


def check_oidc(file: Path, *, secure: bool) -> None:
    """Check that a system can have people sign in as this file says. `secure`: people sign in at all. Raises UsageError."""
    if not secure:
        raise UsageError("with --insecure nobody signs in: start the system without it, or without --oidc")
    if find_spec("joserfc") is None:
        raise UsageError("signing in at a provider needs an additional package: pip install 'somrs[gui]'")
    read_oidc_settings(file)


def _text_of(file: Path, purpose: str) -> str:
    try:
        return file.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text in UTF-8"
        raise UsageError(f"{file} has to have {purpose}, and cannot be read: {reason}") from None
