"""With what a program proves who it is, and how it knows others: TLS with certificates on both sides (RFC 8446, RFC 5280).

A connection shows the identity of its other end once. Whether its certificate still holds is checked for every message, so that who is
revoked, or whose certificate expires, is refused on connections that are open, too. All files are read again when they have been replaced.
"""

from __future__ import annotations

import os
import ssl
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from somrs.errors import UsageError
from somrs.trust.connections import Peer, fingerprint
from somrs.trust.files import next_key
from somrs.trust.holders import HOLDERS_FILE, REVOKED_FILE, Holder, holder_named, read_holders
from somrs.trust.identity import Identity, certificate_uri, identity_of_uris
from somrs.trust.neighbours import NEIGHBOURS_FILE, OWN_SITE, REVOKED_NEIGHBOURS_FILE, Neighbours, read_revoked, read_trusted

FOLDER = "trust"
"""The folder of the authority in the data folder."""

SERVICE_FILE = "service.txt"
"""The file beside the certificate of the authority with the URL of its service."""

VARIABLE = "SOMRS_CREDENTIALS"
"""The environment variable with the certificate of a program, as a path of a file `NAME.pem`."""


class Credentials:
    """The certificate of a program, `NAME.pem`, with its key beside it in `NAME.key`.

    `authority.pem`, and `revoked.txt` and `holders.json` if they are there, are in the same folder, or in the one above. Raises UsageError
    if a file is missing or cannot be used. `generation`: how often the own certificate has been replaced.

    `server` and `client` are the TLS contexts for connections with programs of the own site; `entrance` is that of a server which programs
    of neighbours may reach, too, and `client_for` gives that for an address of any site.
    """

    def __init__(self, certificate: Path) -> None:
        self.certificate, self.key = certificate, certificate.with_suffix(".key")
        self.authority = _beside(certificate, "authority.pem")
        self.generation = 0
        self.folder = self.authority.parent
        self._revoked = _WatchedFile(self.folder / REVOKED_FILE)
        self._revoked_serials: frozenset[str] = frozenset()
        self._holders_file = _WatchedFile(self.folder / HOLDERS_FILE)
        self._holders: tuple[Holder, ...] = ()
        self._own_file = _WatchedFile(certificate)
        self._own_file.has_changed()
        own_authority = _text_of(self.authority)
        self._neighbours_file = _WatchedFile(self.folder / NEIGHBOURS_FILE)
        self._neighbours = Neighbours()
        self._revoked_of_neighbours = _WatchedFile(self.folder / REVOKED_NEIGHBOURS_FILE)
        self._serials_of_neighbours: dict[str, tuple[str, ...]] = {}
        self._own_site = {_fingerprint_of(self.authority, own_authority): OWN_SITE}
        self._sites = self._own_site
        """The sites, by the fingerprints of their authorities."""
        self.server = self._context(ssl.PROTOCOL_TLS_SERVER, own_authority)
        self.client = self._context(ssl.PROTOCOL_TLS_CLIENT, own_authority)
        self.entrance = self._context(ssl.PROTOCOL_TLS_SERVER, own_authority)
        self._clients: dict[str, ssl.SSLContext] = {}
        """The contexts for the programs of neighbours."""
        self._own_identity: Identity | None = None
        _ = self.neighbours  # which `entrance` has to know before the first connection

    @classmethod
    def of_environment(cls) -> Credentials | None:
        """Those of this process; None if it has none."""
        path = os.environ.get(VARIABLE)
        return cls(Path(path)) if path else None

    @property
    def data(self) -> Path | None:
        """The data folder of the system; None on a computer to which only certificates were brought."""
        return self.folder.parent if self.folder.name == FOLDER else None

    @property
    def service(self) -> str | None:
        """The URL of the service of the authority; None if there is none, or if this is the computer of the authority."""
        file = self.folder / SERVICE_FILE
        is_elsewhere = file.exists() and not (self.folder / "register.json").exists()
        return file.read_text().strip() if is_elsewhere else None

    @property
    def revoked(self) -> frozenset[str]:
        """The serial numbers of certificates that are revoked, as far as this computer knows."""
        if self._revoked.has_changed():
            self._revoked_serials = frozenset(self._revoked.path.read_text().split())
        return self._revoked_serials

    def is_renewal_due(self, now: float) -> bool:
        """Whether two thirds of the time of the own certificate are over."""
        uris = _uris(ssl.PEM_cert_to_DER_cert(self.certificate.read_text()))
        holder = next((holder for holder in self.holders if certificate_uri(holder.serial) in uris), None)
        return holder is not None and now >= holder.begins + (holder.ends - holder.begins) * 2 / 3

    def renew(self) -> None:
        """Use a certificate that has taken the place of the own one, on new connections."""
        if not self._own_file.has_changed():
            return
        try:
            for context in (self.server, self.client, self.entrance, *self._clients.values()):
                context.load_cert_chain(self.certificate, self.key)
            self.generation += 1
        except (ssl.SSLError, OSError):
            self._own_file.forget()  # only one of the two files has been replaced yet

    @property
    def identity(self) -> Identity:
        """Who has these."""
        if self._own_identity is None:
            self._own_identity = identity_of_uris(_uris(ssl.PEM_cert_to_DER_cert(self.certificate.read_text())))
        return self._own_identity

    @property
    def name(self) -> str:
        """The name of who has these."""
        return self.identity.name

    @property
    def neighbours(self) -> Neighbours:
        """The neighbours whose certificates count here."""
        if self._neighbours_file.has_changed():
            neighbours = Neighbours(read_trusted(self._neighbours_file.path))
            clients = {entry.name: self._context(ssl.PROTOCOL_TLS_CLIENT, entry.authority) for entry in neighbours.all}
            for entry in neighbours.all:
                # A context cannot forget an authority. `prove` refuses those that are not in the file any more.
                self.entrance.load_verify_locations(cadata=entry.authority)
            self._sites = {fingerprint(entry.authority): entry.name for entry in neighbours.all} | self._own_site
            self._neighbours, self._clients = neighbours, clients
        return self._neighbours

    def client_for(self, address: str) -> ssl.SSLContext:
        """The TLS context for a connection to an address, at which only programs of the site with that address are accepted."""
        site = self.neighbours.site_of(address)
        return self.client if site == OWN_SITE else self._clients[site]

    @property
    def holders(self) -> tuple[Holder, ...]:
        """Who holds a certificate of the site, as far as this computer knows. The same object while nothing has changed."""
        if self._holders_file.has_changed():
            self._holders = read_holders(self._holders_file.path)
        return self._holders

    def identity_named(self, name: str, now: float) -> Identity:
        """The identity that has this name. Raises UsageError, which says what to do next, if it has no certificate that holds."""
        return holder_named(self.holders, name, now).identity

    def own_problem(self, now: datetime) -> str:
        """Why others do not accept the own certificate, as far as it shows: who refuses one may hang up before it is read why."""
        from somrs.trust import certificates

        try:
            authority = certificates.load(self.authority.read_bytes(), str(self.authority))
            own_certificate = certificates.load(self.certificate.read_bytes(), str(self.certificate))
            certificates.check(own_certificate, authority, frozenset(), now)
        except (UsageError, OSError) as error:
            return str(error)
        return ""

    def check(self, peer: Peer, now: float) -> None:
        """Raises UsageError, which says who, what and what to do next, if a certificate is not of this site or does not hold now."""
        if self.prove(peer, now).site != OWN_SITE:
            raise UsageError(f"{peer.identity.name} has a certificate of a neighbour, and this is for who has one of the own site")

    def prove(self, peer: Peer, now: float) -> Identity:
        """The identity of a peer of this site or of a neighbour. Raises UsageError as `check`, if its certificate does not hold."""
        name, neighbours = peer.identity.name, self.neighbours
        site = self._sites.get(peer.authority)
        if site is None:
            raise UsageError(
                f"the certificate of {name} is neither of the authority of this site nor of that of a neighbour: connect anew, with another"
            )
        advice = f"its owner has to enrol it again at {site}" if site else "enrol it again, with a new invitation"
        if peer.serial in (self.revoked if site == OWN_SITE else self.revoked_of_neighbours.get(peer.authority, ())):
            raise UsageError(f"the certificate of {name} ({peer.serial}) is revoked: {advice}")
        if now >= peer.ends:
            raise UsageError(f"the certificate of {name} has expired: {advice}")
        return replace(peer.identity, site=neighbours[site].name) if site else peer.identity

    @property
    def revoked_of_neighbours(self) -> dict[str, tuple[str, ...]]:
        """The serial numbers that the authorities of neighbours have revoked, as far as this computer knows, by their fingerprints."""
        if self._revoked_of_neighbours.has_changed():
            self._serials_of_neighbours = read_revoked(self._revoked_of_neighbours.path)
        return self._serials_of_neighbours

    def _context(self, protocol: int, authority: str) -> ssl.SSLContext:
        context = ssl.SSLContext(protocol)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.verify_mode = ssl.CERT_REQUIRED
        try:
            context.load_verify_locations(cadata=authority)
            self._load(context)
        except (ssl.SSLError, OSError) as error:
            raise UsageError(
                f"{self.certificate} cannot be used with {self.key} and {self.authority}: {error}; `somrs trust enrol` makes all three"
            ) from None
        return context

    def _load(self, context: ssl.SSLContext) -> None:
        """Load the own certificate, whose key may not be in its place: a program has ended just when it replaced both."""
        try:
            context.load_cert_chain(self.certificate, self.key)
        except (ssl.SSLError, OSError):
            later_key = next_key(self.certificate)
            if not later_key.exists():
                raise
            context.load_cert_chain(self.certificate, later_key)
            later_key.replace(self.key)


@dataclass(slots=True)
class _WatchedFile:
    """A file that others replace."""

    path: Path
    _stamp: tuple[int, int] | None = field(default=None)

    def has_changed(self) -> bool:
        """Whether the file is another one than at the last call. A file that is missing has not changed."""
        try:
            details = self.path.stat()
        except FileNotFoundError:
            return False
        stamp = (details.st_mtime_ns, details.st_ino)
        has_changed, self._stamp = stamp != self._stamp, stamp
        return has_changed

    def forget(self) -> None:
        self._stamp = None


def _uris(certificate: bytes) -> list[str]:
    """The URIs of SO-MRS in the own certificate, in DER: each is a value with the tag 6 (RFC 5280, 4.2.1.6) and its length before it.

    `ssl` shows certificates of others only, and a library that shows this one would cost each program some megabytes.
    """
    uris, place = [], 0
    while (place := certificate.find(b"somrs:", place)) >= 0:
        for length_bytes in (1, 2, 3):
            head = certificate[place - length_bytes - 1 : place]
            length = int.from_bytes(head[1 if length_bytes == 1 else 2 :], "big")
            if head[:1] == b"\x86" and (length_bytes == 1 or head[1] == 0x80 + length_bytes - 1):
                uris.append(certificate[place : place + length].decode("ascii"))
                break
        place += 1
    return uris


def _text_of(authority: Path) -> str:
    try:
        return authority.read_text()
    except OSError as error:
        raise UsageError(f"{authority} cannot be read: {error.strerror}; `somrs trust enrol` makes it") from None


def _fingerprint_of(file: Path, authority: str) -> str:
    try:
        return fingerprint(authority)
    except ValueError:
        raise UsageError(f"{file} is no certificate in PEM; `somrs trust enrol` makes it") from None


def _beside(certificate: Path, name: str) -> Path:
    in_folder = certificate.parent / name
    return in_folder if in_folder.exists() else certificate.parent.parent / name


ADVICE = {
    "CERTIFICATE_EXPIRED": "the certificate of this program has expired: renew it with `somrs trust renew`, or enrol it again",
    "UNKNOWN_CA": "the certificate of this program is of another authority than that site's: enrol it there",
    "CERTIFICATE_REQUIRED": "that program wants a certificate, and this one has none: enrol it (`somrs trust invite`, `somrs trust enrol`)",
    "BAD_CERTIFICATE": "the certificate of this program is not accepted: check it with `somrs trust show`, and the clocks of both hosts",
    "CERTIFICATE_VERIFY_FAILED": "the certificate of that program is not accepted here",
}
"""What to do about the reasons of `ssl.SSLError`."""


def advice(error: ssl.SSLError) -> str:
    """What is wrong with a connection, for people."""
    reason = error.reason or ""
    text = next((text for name, text in ADVICE.items() if name in reason), f"TLS failed: {reason or error}")
    detail = getattr(error, "verify_message", "")
    return f"{text} ({detail})" if detail else text
