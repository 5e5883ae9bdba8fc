"""Where it is stored who has access: a file in the data folder that only its user may read. All programs of a system see each change."""

from __future__ import annotations

import fcntl
import os
import secrets
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec
from msgspec.structs import replace

from somrs.access.auditor import Auditor, current_actor
from somrs.access.identity import Identity
from somrs.access.rights import PersonRole, Right
from somrs.access.state import (
    LINK_TIME,
    SESSION_TIME,
    AccessState,
    Account,
    Link,
    Passkey,
    Session,
    Subject,
    Token,
    checked_name,
    hash_of,
    new_secret,
)
from somrs.errors import UsageError
from somrs.storage.audit_log import Actor, audit_files

FILE = "access.json"
"""The file in the data folder with accounts, sessions, tokens and links."""

LOCAL_FILE = "local.token"
"""The file in the data folder with the token of the programs on this computer, which `somrs up` makes anew at each start."""

LOCAL_NAME = "this computer"

_LOCK_FILE = "access.lock"

MOST_BROWSER = 200
"""Characters of what a browser says it is."""

PRIVATE, PRIVATE_FOLDER = 0o600, 0o700

Stamp = tuple[int, int, int]
"""What tells that a file has been replaced."""


def access_files(data: Path) -> list[Path]:
    """The files in a data folder that say who has access, and who did what: a system that begins anew keeps them."""
    return [data / FILE, *audit_files(data)]


class AccessStore:
    """Who has access to the system with this data folder. Each change is recorded in its audit log, by `auditor`."""

    def __init__(self, data: Path) -> None:
        self._data, self.auditor = data, Auditor(data)
        self._state, self._stamp = AccessState(), (-1, -1, -1)
        self._local_tokens: dict[str, frozenset[Right]] = {}
        self._local_stamp: Stamp = (-1, -1, -1)

    def read(self) -> AccessState:
        """The state as it is now. Raises UsageError if the file cannot be read."""
        file = self._data / FILE
        if (stamp := _stamp(file)) != self._stamp:
            try:
                self._state = msgspec.json.decode(file.read_bytes(), type=AccessState) if file.exists() else AccessState()
            except (msgspec.MsgspecError, OSError) as error:
                raise UsageError(f"{file} cannot be read: {error}; restore it from a backup, or remove it and sign in anew") from None
            self._stamp = stamp
        return self._state

    def identity(self, secret: str) -> Identity | None:
        """Who has this secret; None if nobody has, or not any more."""
        for token, rights in self._read_local_tokens().items():
            if secrets.compare_digest(hash_of(secret), hash_of(token)):
                return Identity(name=LOCAL_NAME, rights=rights, secret=secret, speaks_for_others=True)
        return self.read().identity(secret, time.time())

    @contextmanager
    def _changing(self, act: str, **details: object) -> Iterator[_Change]:
        """The state, to be replaced; nobody else changes it meanwhile. The act is recorded."""
        self._data.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
        descriptor = os.open(self._data / _LOCK_FILE, os.O_RDWR | os.O_CREAT, PRIVATE)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            change = _Change(self.read().without_ended(time.time()), details)
            yield change
            _write(self._data / FILE, msgspec.json.encode(change.state))
            self.auditor.done(f"access.{act}", change.actor or current_actor(), change.details)
        finally:
            os.close(descriptor)

    def add_account(self, name: str, role: PersonRole, password_hash: str | None = None) -> Account:
        """Add a person. Raises UsageError if the name is taken, or is none."""
        account = Account(name=checked_name(name), role=role, created_at=time.time(), password=password_hash)
        with self._changing("add_person", name=account.name, role=role) as change:
            change.state = change.state.with_account(account)
        return account

    def set_role(self, name: str, role: PersonRole) -> None:
        with self._changing("set_role", name=name, after=role) as change:
            change.details["before"] = change.state.account(name).role
            change.state = change.state.with_role(name, role)

    def set_password(self, name: str, password_hash: str | None, kept_session: str | None = None) -> None:
        """Set a password, and sign the person out everywhere but in one session."""
        with self._changing("set_password" if password_hash else "remove_password", name=name) as change:
            change.state = change.state.with_password(name, password_hash, kept_session)

    def remove_account(self, name: str) -> None:
        with self._changing("remove_person", name=name) as change:
            change.details["role"] = change.state.account(name).role
            change.state = change.state.without_account(name)

    def open_session(self, name: str, address: str = "", browser: str = "") -> str:
        """Sign a person in, and return the secret of the session."""
        with self._changing("sign_in", by="password", browser=browser[:MOST_BROWSER]) as change:
            change.state.account(name)
            change.actor = Actor(name=name, address=address)
            secret, change.state = _with_session(change.state, name, address, browser)
        return secret

    def add_passkey(self, passkey: Passkey) -> None:
        """Add a passkey of a person. Raises UsageError if the person has one of this name, or too many."""
        with self._changing("add_passkey", name=passkey.account, passkey=passkey.name, host=passkey.host) as change:
            change.state = change.state.with_passkey(passkey)

    def remove_passkey(self, name: str, id: str) -> None:
        with self._changing("remove_passkey", name=name) as change:
            change.details["passkey"] = next((passkey.name for passkey in change.state.passkeys_of(name) if passkey.id == id), "")
            change.state = change.state.without_passkey(name, id)

    def remove_passkeys(self, name: str) -> None:
        """Remove all passkeys of a person, and sign the person out everywhere."""
        with self._changing("remove_passkeys", name=name) as change:
            change.details["passkeys"] = [passkey.name for passkey in change.state.passkeys_of(name)]
            change.state = change.state.without_passkeys(name)

    def open_session_by(self, passkey: Passkey, sign_count: int, address: str = "", browser: str = "") -> str:
        """Sign in the person with this passkey, which has now been used so often, and return the secret of the session."""
        with self._changing("sign_in", by="a passkey", passkey=passkey.name, browser=browser[:MOST_BROWSER]) as change:
            if passkey.id not in change.state.passkeys:
                raise UsageError(f"{passkey.account} has no passkey {passkey.name} any more")
            change.actor = Actor(name=passkey.account, address=address)
            used_passkey = replace(passkey, sign_count=sign_count, used_at=time.time())
            state = replace(change.state, passkeys=change.state.passkeys | {passkey.id: used_passkey})
            secret, change.state = _with_session(state, passkey.account, address, browser)
        return secret

    def open_session_of(
        self, subject: Subject, names: Sequence[str], role: PersonRole, seconds: float, address: str = "", browser: str = ""
    ) -> str:
        """Sign in somebody whom a provider has identified, and return the secret of the session. `names`: for a new account, of which it
        gets the first that nobody has; `seconds`: how long the session lasts. Raises UsageError if all names are taken."""
        with self._changing("sign_in", by=subject.issuer, browser=browser[:MOST_BROWSER], role=role) as change:
            earlier_account = change.state.account_of(subject)
            if earlier_account is not None and earlier_account.role != role:
                change.details["before"] = earlier_account.role
            change.state, account = change.state.with_subject(subject, names, role, time.time())
            change.actor = Actor(name=account.name, address=address)
            secret, change.state = _with_session(change.state, account.name, address, browser, seconds)
        return secret

    def end_sessions_of(self, subject: Subject, reason: str) -> None:
        """Sign somebody out everywhere to whom a provider gives no role any more."""
        account = self.read().account_of(subject)
        if account is None or self.read().signed_out(account.name) == self.read():
            return
        with self._changing("end_sessions", name=account.name, why=reason) as change:
            change.state = change.state.signed_out(account.name)

    def end_session(self, id: str) -> None:
        with self._changing("end_session", session=id) as change:
            change.details["name"] = next((session.account for session in change.state.sessions.values() if session.id == id), "")
            change.state = change.state.without_session(id)

    def add_token(self, name: str, rights: frozenset[Right], seconds: float, author: str = "") -> str:
        """Make a token for a program, and return its secret, which is not stored."""
        now, secret = time.time(), new_secret()
        token = Token(name=checked_name(name), rights=rights, created_at=now, ends_at=now + seconds, author=author)
        with self._changing("add_token", name=token.name, rights=sorted(rights), seconds=seconds) as change:
            change.state = change.state.with_token(secret, token)
        return secret

    def remove_token(self, name: str) -> None:
        with self._changing("remove_token", name=name) as change:
            change.state = change.state.without_token(name)

    def add_link(self, name: str | None) -> str:
        """Make a one-time sign-in link, and return its secret. `name`: who is signed in; None: a new administrator."""
        secret = new_secret()
        with self._changing("make_link", name=name or "") as change:
            if name is not None:
                change.state.account(name)
            change.state = change.state.with_link(secret, Link(account=name, ends_at=time.time() + LINK_TIME))
        return secret

    def link(self, secret: str) -> Link | None:
        """The sign-in link with this secret, if it can still be used."""
        link = self.read().links.get(hash_of(secret))
        return link if link is not None and time.time() < link.ends_at else None

    def use_link(self, secret: str, name: str = "", address: str = "", browser: str = "") -> str:
        """Sign in by a link, and return the secret of the session. `name`: of the new administrator, if the link is for one.

        Raises UsageError if the link cannot be used any more, or if the name is taken, or is none; the link can then be used again.
        """
        with self._changing("sign_in", by="a link", browser=browser[:MOST_BROWSER]) as change:
            link = change.state.links.get(hash_of(secret))
            if link is None:
                raise UsageError("this link was used, or its time is over; `somrs user link NAME` prints another one")
            state = change.state.without_link(secret)
            person = link.account
            if person is None:
                account = Account(name=checked_name(name), role=PersonRole.ADMINISTRATOR, created_at=time.time())
                state, person = state.with_account(account), account.name
                change.details["role"] = account.role
            change.actor = Actor(name=person, address=address)
            session_secret, change.state = _with_session(state, person, address, browser)
        return session_secret

    def renew_local_token(self) -> None:
        """Make a new token for the programs on this computer; the one before is worth nothing any more."""
        _write(self._data / LOCAL_FILE, new_secret().encode())

    def ensure_local_token(self) -> None:
        """Make a token for the programs on this computer if there is none: no `somrs up` has started them."""
        if local_token(self._data) is None:
            self.renew_local_token()

    def _read_local_tokens(self) -> dict[str, frozenset[Right]]:
        """The tokens of the programs on this computer with their rights."""
        if (stamp := _stamp(self._data / LOCAL_FILE)) != self._local_stamp:
            token, watching_token = local_token(self._data), local_token(self._data, only_sees=True)
            all_rights, watching_rights = frozenset(Right), frozenset({Right.SEE})
            self._local_tokens = {token: all_rights, watching_token: watching_rights} if token and watching_token else {}
            self._local_stamp = stamp
        return self._local_tokens


def local_token(data: Path, *, only_sees: bool = False) -> str | None:
    """The token of the programs on this computer for the system with this data folder; None if it has none. `only_sees`: the one that has
    only the right to see."""
    try:
        token = (data / LOCAL_FILE).read_text(encoding="ascii")
    except OSError:
        return None
    return hash_of(f"see {token}") if only_sees else token


class _Change:
    """A change of the state that is under way, with the `details` that are recorded of it. `actor`: who makes it; None: the current one."""

    def __init__(self, state: AccessState, details: dict[str, object]) -> None:
        self.state, self.details = state, details
        self.actor: Actor | None = None


def _with_session(state: AccessState, name: str, address: str, browser: str, seconds: float = SESSION_TIME) -> tuple[str, AccessState]:
    now, secret = time.time(), new_secret()
    session = Session(
        id=secrets.token_hex(8),
        account=name,
        created_at=now,
        ends_at=now + seconds,
        address=address[:60],
        browser=browser[:MOST_BROWSER],
    )
    return secret, state.with_session(secret, session)


def _stamp(file: Path) -> Stamp:
    try:
        details = file.stat()
    except FileNotFoundError:
        return 0, 0, 0
    return details.st_ino, details.st_mtime_ns, details.st_ctime_ns


def _write(file: Path, content: bytes) -> None:
    """Replace a file at once by one that only its user may read."""
    file.parent.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    new_file = file.with_name(f"{file.name}.new")
    new_file.unlink(missing_ok=True)
    descriptor = os.open(new_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE)
    with os.fdopen(descriptor, "wb") as output:
        output.write(content)
        output.flush()
        os.fsync(output.fileno())
    new_file.replace(file)
