"""Tests as people and programs that have access: what they send to the systems that they have started."""

from __future__ import annotations

import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore, local_token

TESTER = "Tester"
"""Who has signed in in the browsers of tests."""

_FOLDERS: dict[str, Path] = {}
"""The data folders of systems, by the addresses of their servers."""


def authorization(data: Path) -> dict[str, str]:
    """The header of a program on this computer."""
    token = local_token(data)
    return {"Authorization": f"Bearer {token}"} if token is not None else {}


def authorization_at(url: str) -> dict[str, str]:
    """The header of a program on this computer for a server of a system that was `noted`."""
    folder = _FOLDERS.get(urlsplit(url).netloc)
    return authorization(folder) if folder is not None else {}


def note(data: Path, *urls: str | None) -> None:
    """From now on, `urlopen` has access to these servers of the system with this data folder."""
    _FOLDERS.update({urlsplit(url).netloc: data for url in urls if url is not None})


def session_cookies(url: str, role: PersonRole = PersonRole.ADMINISTRATOR, name: str = TESTER) -> list[tuple[str, str, str]]:
    """The cookies of a person who has signed in at the system with this page, or, for an empty page, at all systems that were `noted`: the
    name and the content of each, and the address for which it is."""
    servers = [server for server, folder in _FOLDERS.items() if folder.exists()]
    return [_session_cookie(server, role, name) for server in servers if urlsplit(url).netloc in ("", server)]


def _session_cookie(server: str, role: PersonRole, name: str) -> tuple[str, str, str]:
    store = AccessStore(_FOLDERS[server])
    if name not in store.read().accounts:
        store.add_account(name, role)
    return store.read().cookie, store.open_session(name), f"http://{server}"


class _Access(urllib.request.BaseHandler):
    """Adds the header to requests that have none."""

    def http_request(self, request: urllib.request.Request) -> urllib.request.Request:
        if not request.has_header("Authorization"):
            for name, value in authorization_at(request.full_url).items():
                request.add_unredirected_header(name, value)
        return request


urllib.request.install_opener(urllib.request.build_opener(_Access))
