"""With what a program proves who it is, and how it knows others: TLS with certificates on both sides (RFC 8446, RFC 5280).

A connection shows the identity of its other end once. Whether its certificate still holds is checked for every message, so that who is
revoked, or whose certificate expires, is refused on connections that are open, too. All files are read again when they have been replaced.
"""

from __future__ import annotations

import os
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from somrs.errors import UsageError
from somrs.trust.identity import Identity, identity_of_uris

FOLDER = "trust"
"""The folder of the authority in the data folder."""

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

    `authority.pem`, and `revoked.txt` if there is one, are in the same folder, or in the one above. Raises UsageError if a file is missing
    or cannot be used.
    """

    def __init__(self, certificate: Path) -> None:
        self.certificate, self._key = certificate, certificate.with_suffix(".key")
        self._authority = _beside(certificate, "authority.pem")
        self._revoked = _WatchedFile(_beside(certificate, "revoked.txt"))
        self._revoked_serials: frozenset[str] = frozenset()
        self._own = _WatchedFile(certificate)
        self._own.has_changed()
        self.server = self._context(ssl.PROTOCOL_TLS_SERVER)
        self.client = self._context(ssl.PROTOCOL_TLS_CLIENT)

    @classmethod
    def of_environment(cls) -> Credentials | None:
        """Those of this process; None if it has none."""
        path = os.environ.get(VARIABLE)
        return cls(Path(path)) if path else None

    @property
    def data(self) -> Path | None:
        """The data folder of the system; None on a computer to which only certificates were brought."""
        folder = self._authority.parent
        return folder.parent if folder.name == FOLDER else None

    def renew(self) -> None:
        """Use a certificate that has taken the place of the own one, on new connections."""
        if not self._own.has_changed():
            return
        try:
            for context in (self.server, self.client):
                context.load_cert_chain(self.certificate, self._key)
        except (ssl.SSLError, OSError):
            self._own.forget()  # only one of the two files has been replaced yet

    def own_problem(self, now: datetime) -> str:
        """Why others do not accept the own certificate, as far as it shows: who refuses one may hang up before it is read why."""
        from somrs.trust import certificates

        try:
            authority = certificates.load(self._authority.read_bytes(), str(self._authority))
            own_certificate = certificates.load(self.certificate.read_bytes(), str(self.certificate))
            certificates.check(own_certificate, authority, frozenset(), now)
        except (UsageError, OSError) as error:
            return str(error)
        return ""

    def check(self, peer: Peer, now: float) -> None:
        """Raises UsageError, which says who, what and what to do next, if a certificate does not hold at this time."""
        name = peer.identity.name
        if self._revoked.has_changed():
            self._revoked_serials = frozenset(self._revoked.path.read_text().split())
        if peer.serial in self._revoked_serials:
            raise UsageError(f"the certificate of {name} ({peer.serial}) is revoked: enrol it again, with a new invitation")
        if now >= peer.ends:
            raise UsageError(f"the certificate of {name} has expired: enrol it again, with a new invitation")

    def _context(self, protocol: int) -> ssl.SSLContext:
        context = ssl.SSLContext(protocol)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.verify_mode = ssl.CERT_REQUIRED
        try:
            context.load_verify_locations(self._authority)
            context.load_cert_chain(self.certificate, self._key)
        except (ssl.SSLError, OSError) as error:
            raise UsageError(
                f"{self.certificate} cannot be used with {self._key} and {self._authority}: {error}; `somrs trust enrol` makes all three"
            ) from None
        return context


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
        is_other, self._stamp = stamp != self._stamp, stamp
        return is_other

    def forget(self) -> None:
        self._stamp = None


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
