"""The implementations of `somrs user` and `somrs token`. They work on the data folder, whether its system runs or not."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from pathlib import Path

from somrs.access.passwords import hashed_password
from somrs.access.rights import PersonRole, Right
from somrs.access.state import Account
from somrs.access.store import AccessStore
from somrs.client import terminal
from somrs.client.addresses import Addresses
from somrs.deployment.private_files import make_private
from somrs.errors import UsageError

DAY = 86400.0


def _store(data: Path) -> AccessStore:
    make_private(data)
    return AccessStore(data)


def add(name: str, role: PersonRole, data: Path) -> None:
    account = _store(data).add_account(name, role)
    print(f"{account.name}: {role}")
    link(account.name, data)


def link(name: str, data: Path) -> None:
    print(f"To sign in, once, within a day: {sign_in_url(windows_url(data), _store(data).add_link(name))}")


def windows_url(data: Path) -> str:
    """The address of the windows of the system that runs with this data folder; a placeholder if there are none."""
    try:
        return Addresses.read(data).gui or "http://ADDRESS"
    except UsageError:
        return "http://ADDRESS"


def sign_in_url(windows: str, secret: str) -> str:
    return f"{windows}/sign-in?link={secret}"


def change_role(name: str, role: PersonRole, data: Path) -> None:
    _store(data).set_role(name, role)
    print(f"{name}: {role}")


def set_password(name: str, password: str | None, data: Path) -> None:
    store = _store(data)
    store.read().account(name)
    store.set_password(name, hashed_password(password) if password is not None else None)
    print(f"{name}: {'has a new password' if password is not None else 'has no password'}, and is signed out everywhere")


def remove_passkeys(name: str, data: Path) -> None:
    _store(data).remove_passkeys(name)
    print(f"{name}: has no passkeys, and is signed out everywhere")


def remove(name: str, data: Path) -> None:
    _store(data).remove_account(name)
    print(f"{name}: removed")


def list_users(data: Path, *, json: bool) -> None:
    state = _store(data).read()
    sessions = {name: [session for session in state.sessions.values() if session.account == name] for name in state.accounts}
    if json:
        people = [
            {
                "name": account.name,
                "role": account.role,
                "has_password": account.password is not None,
                "provider": account.provider,
                "passkeys": [passkey.name for passkey in state.passkeys_of(account.name)],
                "sessions": sessions[account.name],
            }
            for account in state.accounts.values()
        ]
        terminal.print_json(people)
    elif state.accounts:
        rows = (
            (
                account.name,
                account.role,
                account.provider or _ways_in(account, len(state.passkeys_of(account.name))),
                len(sessions[account.name]),
                terminal.moment(account.created_at),
            )
            for account in state.accounts.values()
        )
        terminal.console().print(terminal.table("People", ("name", "role", "signs in by", "sessions", "since"), rows))
    else:
        print("nobody yet; the link that `somrs up` prints adds the first administrator, and `somrs user add NAME` others")


def _ways_in(account: Account, passkey_count: int) -> str:
    """How a person signs in at this system."""
    ways = (["password"] if account.password else []) + (["passkeys"] if passkey_count else [])
    return ", ".join(ways) or "link"


def new_token(name: str, rights: Sequence[Right], days: float, data: Path) -> None:
    print(_store(data).add_token(name, frozenset(rights), days * DAY, author=getpass.getuser()))


def list_tokens(data: Path, *, json: bool) -> None:
    tokens = [*_store(data).read().tokens.values()]
    if json:
        terminal.print_json(tokens)
    elif tokens:
        rows = (
            (token.name, ", ".join(right for right in Right if right in token.rights), terminal.moment(token.ends_at), token.author)
            for token in tokens
        )
        terminal.console().print(terminal.table("Tokens", ("name", "rights", "until", "made by"), rows))
    else:
        print("no tokens; `somrs token new NAME --right see` makes one")


def revoke(name: str, data: Path) -> None:
    _store(data).remove_token(name)
    print(f"{name}: revoked")
