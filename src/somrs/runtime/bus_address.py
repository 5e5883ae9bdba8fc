"""Where a site is on a bus, and the subjects of its messages there."""

from __future__ import annotations

from functools import lru_cache
from urllib.parse import quote, unquote, urlsplit

import msgspec

ROOT = "somrs"
"""The first token of the subjects of components."""

PROVEN_ROOT = "somrs-from"
"""The first token of subjects with a token of the sender after the site, which the servers of the bus let nobody else use."""

BEGINNINGS = "somrs-beginnings"
"""The first token of the subjects on which components say that they listen from now on; the second is the site."""


class BusAddress(msgspec.Struct, frozen=True, kw_only=True):
    """Where a site's bus is. `servers`: URLs of NATS servers, separated by commas. `gateway`: the URL below which all addresses of the site
    are."""

    servers: str
    site: str
    gateway: str

    def __post_init__(self) -> None:
        if not self.site or quote(self.site, safe="") != self.site or "." in self.site:
            raise ValueError(f"a site on the bus is named with letters, digits, '-' and '_', and not {self.site!r}")

    def covers(self, address: str) -> bool:
        """Whether the address is one of this site."""
        return address.startswith(f"{self.gateway}/")

    def subject(self, path: str) -> str:
        """The subject of the component at a path."""
        return ".".join((ROOT, self.site, *path_tokens(path)))

    def subject_of(self, address: str) -> str:
        """The subject of the component at an address of this site."""
        return _subject_of(self, address)

    def with_sender(self, subject: str, token: str) -> str:
        """The subject of a component's messages from one sender; with the token `*`, from all."""
        return f"{PROVEN_ROOT}.{self.site}.{token}.{self._rest(subject)}"

    def beginning(self, subject: str) -> str:
        """The subject on which it is said that a component begins to listen."""
        return f"{BEGINNINGS}.{self.site}.{self._rest(subject)}"

    def begun(self, notice: str) -> str:
        """The subject of the component that has begun, by the subject of the notice."""
        return f"{ROOT}.{self.site}.{notice.removeprefix(f'{BEGINNINGS}.{self.site}.')}"

    def tokens(self, subject: str) -> list[str]:
        """The tokens of a component's subject behind those of the site."""
        return self._rest(subject).split(".")

    def _rest(self, subject: str) -> str:
        return subject.removeprefix(f"{ROOT}.{self.site}.")


def path_tokens(path: str) -> list[str]:
    """The tokens of a subject for the component at a path."""
    return [token_of(unquote(part)) for part in path.strip("/").split("/")]


def token_of(name: str) -> str:
    """A name as a token of a subject."""
    return quote(name, safe="").replace(".", "%2E")


def sender_token(subject: str) -> str:
    """The token of who has sent a message with this subject, as the servers of the bus have checked. Raises ValueError if it has none."""
    tokens = subject.split(".")
    if tokens[0] != PROVEN_ROOT or len(tokens) < 4:
        raise ValueError(f"{subject[:200]} does not say who has sent this")
    return tokens[2]


def name_of(token: str) -> str:
    """The name that has become a token."""
    return unquote(token)


@lru_cache(maxsize=10_000)
def _subject_of(bus: BusAddress, address: str) -> str:
    return bus.subject(urlsplit(address).path)
