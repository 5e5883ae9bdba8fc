"""Accounts, sessions, tokens and sign-in links as data. Of what they are proven with, only hashes are known here."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Iterator, Sequence

from msgspec import Struct, field
from msgspec.structs import replace

from somrs.access.identity import Identity
from somrs.access.rights import PersonRole, Right
from somrs.errors import UsageError

SESSION_TIME = 30 * 86400.0
"""Seconds for which one stays signed in."""

LINK_TIME = 86400.0
"""Seconds for which a sign-in link can be used, once."""

MAX_NAME = 80
"""Characters of a name."""

MAX_PASSKEYS = 20
"""Passkeys of one account."""

MAX_SESSIONS = 50
"""Sessions of one account. A new one takes the place of the oldest."""


class Subject(Struct, frozen=True, kw_only=True):
    """Who somebody is for an OpenID Connect provider: `id` is the claim `sub` of this issuer, which it gives to nobody else."""

    issuer: str
    id: str


class Account(Struct, frozen=True, kw_only=True):
    """A person. `password`: an Argon2id hash in its standard form; None if the person has none. `subject`: who it is for the provider that
    says who signs in and in which role; None: this system says so itself."""

    name: str
    role: PersonRole
    created_at: float
    password: str | None = None
    subject: Subject | None = None

    @property
    def provider(self) -> str:
        """The provider that says who signs in; empty if this system does."""
        return self.subject.issuer if self.subject is not None else ""

    def check_own(self) -> None:
        """Raises UsageError if a provider says who signs in and in which role."""
        if self.subject is not None:
            raise UsageError(f"{self.name} signs in at {self.subject.issuer}, which also says what the role is; change it there")


class Session(Struct, frozen=True, kw_only=True):
    """A browser in which a person has signed in. `address`, `browser`: from where, for people."""

    id: str
    account: str
    created_at: float
    ends_at: float
    address: str = ""
    browser: str = ""


class Token(Struct, frozen=True, kw_only=True):
    """What a program proves itself with. `author`: who made it."""

    name: str
    rights: frozenset[Right]
    created_at: float
    ends_at: float
    author: str = ""


class Passkey(Struct, frozen=True, kw_only=True):
    """A key of which a person's device has the other half (Web Authentication).

    `id`: of the credential, which the device gives, in base64url; `name`: by which the person distinguishes several. `host`: the name in
    the address at which it can be used. `public_key`: as the device states it (COSE). `sign_count`: how often it has been used, if the
    device counts. `used_at`: the last time; None: never.
    """

    id: str
    name: str
    account: str
    host: str
    public_key: bytes
    sign_count: int
    created_at: float
    used_at: float | None = None


class Link(Struct, frozen=True, kw_only=True):
    """A sign-in link. `account`: who is signed in by it; None: who uses it states a name, and becomes an administrator."""

    account: str | None
    ends_at: float


class AccessState(Struct, frozen=True, kw_only=True):
    """All that is known about who has access. Sessions, tokens and links are by the hash of their secret.

    `id`: distinguishes the cookies of systems on one computer, which browsers send to all its ports.
    """

    schema: int = 1
    id: str = field(default_factory=lambda: secrets.token_hex(4))
    accounts: dict[str, Account] = {}
    sessions: dict[str, Session] = {}
    tokens: dict[str, Token] = {}
    links: dict[str, Link] = {}
    passkeys: dict[str, Passkey] = {}

    @property
    def cookie(self) -> str:
        """The name of the cookie with the secret of a session."""
        return f"somrs_{self.id}"

    def identity(self, secret: str, now: float) -> Identity | None:
        """Who has this secret of a session or a token; None if nobody has, or not any more."""
        hashed = hash_of(secret)
        if (session := self.sessions.get(hashed)) is not None:
            account = self.accounts.get(session.account)
            if account is None or session.ends_at <= now:
                return None
            return Identity(name=account.name, rights=account.role.rights, secret=secret, session=session.id, address=session.address)
        if (token := self.tokens.get(hashed)) is not None and now < token.ends_at:
            return Identity(name=token.name, rights=token.rights, secret=secret)
        return None

    def without_ended(self, now: float) -> AccessState:
        """The state without the sessions, tokens and links whose time is over."""
        return replace(
            self,
            sessions={key: session for key, session in self.sessions.items() if now < session.ends_at},
            tokens={key: token for key, token in self.tokens.items() if now < token.ends_at},
            links={key: link for key, link in self.links.items() if now < link.ends_at},
        )

    def with_account(self, account: Account) -> AccessState:
        """The state with a new account. Raises UsageError if the name is taken, or is none."""
        if account.name.casefold() in {name.casefold() for name in self._names()}:
            raise UsageError(f"there is {account.name} already; choose another name")
        return replace(self, accounts=self.accounts | {account.name: account})

    def with_role(self, name: str, role: PersonRole) -> AccessState:
        """The state with another role of a person. Raises UsageError for the last administrator."""
        self.account(name).check_own()
        changed = replace(self, accounts=self.accounts | {name: replace(self.account(name), role=role)})
        return self._unless_last(name, changed)

    def with_subject(self, subject: Subject, names: Sequence[str], role: PersonRole, now: float) -> tuple[AccessState, Account]:
        """The state with a person in the role that a provider has stated, and the person, who keeps the name of the first time: of `names`,
        the first that nobody has. Raises UsageError if all are taken."""
        account = self.account_of(subject)
        if account is None:
            names_in_use = {name.casefold() for name in self._names()}
            name = next((name for name in names if name.casefold() not in names_in_use), None)
            if name is None:
                raise UsageError(f"there is {names[-1]} already, who signs in in another way; an administrator can remove that account")
            account = Account(name=checked_name(name), role=role, created_at=now, subject=subject)
        account = replace(account, role=role)
        return replace(self, accounts=self.accounts | {account.name: account}), account

    def account_of(self, subject: Subject) -> Account | None:
        """The account of somebody whom a provider has identified; None if there is none yet."""
        return next((account for account in self.accounts.values() if account.subject == subject), None)

    def signed_out(self, name: str, kept_session: str | None = None) -> AccessState:
        """The state without the sessions and the links of a person, but for one session."""
        return replace(
            self,
            sessions={key: session for key, session in self.sessions.items() if session.account != name or session.id == kept_session},
            links={key: link for key, link in self.links.items() if link.account != name},
        )

    def with_password(self, name: str, hashed: str | None, kept_session: str | None = None) -> AccessState:
        """The state with another password of a person, who stays signed in nowhere but in one session."""
        self.account(name).check_own()
        account = replace(self.account(name), password=hashed)
        return replace(self.signed_out(name, kept_session), accounts=self.accounts | {name: account})

    def without_account(self, name: str) -> AccessState:
        """The state without a person, the person's sessions, links and passkeys. Raises UsageError for the last administrator."""
        self.account(name)
        signed_out = replace(self.signed_out(name), passkeys={id: key for id, key in self.passkeys.items() if key.account != name})
        removed = replace(signed_out, accounts={key: account for key, account in self.accounts.items() if key != name})
        return self._unless_last(name, removed)

    def passkeys_of(self, name: str) -> list[Passkey]:
        """The passkeys of a person, oldest first."""
        return [passkey for passkey in self.passkeys.values() if passkey.account == name]

    def with_passkey(self, passkey: Passkey) -> AccessState:
        """The state with a new passkey. Raises UsageError if the person has one of this name, or too many, or needs none."""
        self.account(passkey.account).check_own()
        earlier_passkeys = self.passkeys_of(passkey.account)
        if passkey.name.casefold() in {earlier.name.casefold() for earlier in earlier_passkeys}:
            raise UsageError(f"you have a passkey {passkey.name} already; choose another name")
        if len(earlier_passkeys) >= MAX_PASSKEYS:
            raise UsageError(f"you have {MAX_PASSKEYS} passkeys, which is the most; remove one that you do not use")
        if passkey.id in self.passkeys:
            raise UsageError("this passkey is known already")
        return replace(self, passkeys=self.passkeys | {passkey.id: passkey})

    def without_passkey(self, name: str, id: str) -> AccessState:
        """The state without a passkey of a person. Raises UsageError if the person has none with this id."""
        if id not in {passkey.id for passkey in self.passkeys_of(name)}:
            raise UsageError(f"{name} has no passkey {id}; it may have been removed")
        return replace(self, passkeys={key: passkey for key, passkey in self.passkeys.items() if key != id})

    def without_passkeys(self, name: str) -> AccessState:
        """The state without all passkeys of a person, who is signed out everywhere."""
        self.account(name)
        return replace(self.signed_out(name), passkeys={id: key for id, key in self.passkeys.items() if key.account != name})

    def with_session(self, secret: str, session: Session) -> AccessState:
        oldest_first = sorted((key for key, other in self.sessions.items() if other.account == session.account), key=self._session_start)
        ended = oldest_first[: max(0, len(oldest_first) + 1 - MAX_SESSIONS)]
        sessions = {key: other for key, other in self.sessions.items() if key not in ended}
        return replace(self, sessions=sessions | {hash_of(secret): session})

    def without_session(self, id: str) -> AccessState:
        """The state without a session. Raises UsageError if there is none with this id."""
        remaining = {key: session for key, session in self.sessions.items() if session.id != id}
        if len(remaining) == len(self.sessions):
            raise UsageError(f"there is no session {id}; it may have ended")
        return replace(self, sessions=remaining)

    def with_token(self, secret: str, token: Token) -> AccessState:
        """The state with a new token. Raises UsageError if the name is taken."""
        if token.name.casefold() in {name.casefold() for name in self._names()}:
            raise UsageError(f"there is {token.name} already; choose another name")
        return replace(self, tokens=self.tokens | {hash_of(secret): token})

    def without_token(self, name: str) -> AccessState:
        """The state without a token. Raises UsageError if there is none of this name."""
        remaining = {key: token for key, token in self.tokens.items() if token.name != name}
        if len(remaining) == len(self.tokens):
            names = ", ".join(sorted(token.name for token in self.tokens.values())) or "none"
            raise UsageError(f"there is no token {name}; the tokens are: {names}")
        return replace(self, tokens=remaining)

    def with_link(self, secret: str, link: Link) -> AccessState:
        return replace(self, links=self.links | {hash_of(secret): link})

    def without_link(self, secret: str) -> AccessState:
        return replace(self, links={key: link for key, link in self.links.items() if key != hash_of(secret)})

    def account(self, name: str) -> Account:
        """The account of a person. Raises UsageError if there is none."""
        if name not in self.accounts:
            raise UsageError(f"there is no {name}; the people are: {', '.join(sorted(self.accounts)) or 'none'}")
        return self.accounts[name]

    def first_administrator(self) -> Account | None:
        administrators = [account for account in self.accounts.values() if account.role is PersonRole.ADMINISTRATOR]
        return min(administrators, key=lambda account: account.created_at, default=None)

    def _names(self) -> Iterator[str]:
        yield from self.accounts
        yield from (token.name for token in self.tokens.values())

    def _session_start(self, key: str) -> float:
        return self.sessions[key].created_at

    def _unless_last(self, name: str, changed: AccessState) -> AccessState:
        if self.first_administrator() is not None and changed.first_administrator() is None:
            raise UsageError(f"{name} is the last administrator; make somebody else one first")
        return changed


def new_secret() -> str:
    """A secret that nobody can guess: 256 random bits."""
    return secrets.token_urlsafe(32)


def hash_of(secret: str) -> str:
    """SHA-256, which suffices for secrets that were not chosen by people."""
    return hashlib.sha256(secret.encode(errors="surrogatepass")).hexdigest()


def checked_name(text: str) -> str:
    """A name as it is recorded. Raises UsageError for what is none."""
    name = " ".join(text.split())
    if not name or len(name) > MAX_NAME or not name.isprintable() or "/" in name:
        raise UsageError(f"{text[:MAX_NAME]!r} is not a name: a name has 1 to {MAX_NAME} printable characters and no slash")
    return name
