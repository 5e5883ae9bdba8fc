"""With what a program proves who it is, and how it knows others: TLS with certificates on both sides (RFC 8446, RFC 5280).

A connection shows the identity of its other end once. Whether its certificate still holds is checked for every message, so that who is
revoked, or whose certificate expires, is refused on connections that are open, too. All files are read again when they have been replaced.
"""

from __future__ import annotations

import hashlib
import os
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from somrs.errors import UsageError
from somrs.trust.files import next_key
from somrs.trust.holders import HOLDERS_FILE, REVOKED_FILE, Holder, holder_named, read_holders
from somrs.trust.identity import Identity, certificate_uri, identity_of_uris

FOLDER = "trust"
"""The folder of the authority in the data folder."""

SERVICE_FILE = "service.txt"
"""The file beside the certificate of the authority with the URL of its service."""

VARIABLE = "SOMRS_CREDENTIALS"
"""The environment variable with the certificate of a program, as a path of a file `NAME.pem`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """The other end of a connection, as its certificate says. `begins`, `ends`: seconds since 1970."""

    identity: Identity
    serial: str
    begins: float
    ends: float


def peer_of(certificate: Mapping[str, Any]) -> Peer:
    """The peer with a certificate, as `ssl.SSLSocket.getpeercert` returns it. Raises UsageError if it has no identity."""
    uris = [value for kind, value in certificate.get("subjectAltName", ()) if kind == "URI"]
    return Peer(
        identity=identity_of_uris(uris),
        serial=f"{int(certificate['serialNumber'], 16):x}",
        begins=float(ssl.cert_time_to_seconds(certificate["notBefore"])),
        ends=float(ssl.cert_time_to_seconds(certificate["notAfter"])),
    )


class Credentials:
    """The certificate of a program, `NAME.pem`, with its key beside it in `NAME.key`.

    `authority.pem`, and `revoked.txt` and `holders.json` if they are there, are in the same folder, or in the one above. Raises UsageError
    if a file is missing or cannot be used. `generation`: how often the own certificate has been replaced.
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
        self.server = self._context(ssl.PROTOCOL_TLS_SERVER)
        self.client = self._context(ssl.PROTOCOL_TLS_CLIENT)
        self._name = ""

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
            for context in (self.server, self.client):
                context.load_cert_chain(self.certificate, self.key)
            self.generation += 1
        except (ssl.SSLError, OSError):
            self._own_file.forget()  # only one of the two files has been replaced yet

    @property
    def name(self) -> str:
        """The name of who has these."""
        if not self._name:
            self._name = identity_of_uris(_uris(ssl.PEM_cert_to_DER_cert(self.certificate.read_text()))).name
        return self._name

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
        """Raises UsageError, which says who, what and what to do next, if a certificate does not hold at this time."""
        name = peer.identity.name
        if peer.serial in self.revoked:
            raise UsageError(f"the certificate of {name} ({peer.serial}) is revoked: enrol it again, with a new invitation")
        if now >= peer.ends:
            raise UsageError(f"the certificate of {name} has expired: enrol it again, with a new invitation")

    def _context(self, protocol: int) -> ssl.SSLContext:
        context = ssl.SSLContext(protocol)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.verify_mode = ssl.CERT_REQUIRED
        try:
            context.load_verify_locations(self.authority)
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


def _beside(certificate: Path, name: str) -> Path:
    in_folder = certificate.parent / name
    return in_folder if in_folder.exists() else certificate.parent.parent / name


def fingerprint(certificate: str) -> str:
    """The first 128 bits of the SHA-256 of a certificate in PEM, in hexadecimal digits."""
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(certificate)).hexdigest()[:32]


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
