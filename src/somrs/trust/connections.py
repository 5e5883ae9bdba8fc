"""The certificate of the other end of a TLS connection, and which authority has signed it."""

from __future__ import annotations

import ssl
from asyncio import BaseTransport
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

from somrs.trust.identity import Identity, identity_of_uris

AUTHORITY = "authority"
"""The key in `peer_certificate` of the fingerprint of the authority; empty if it is not known."""

MOST_KNOWN = 10_000
"""Of how many certificates the authority is remembered."""

_authorities: dict[bytes, str] = {}
"""The fingerprints of authorities, by certificates that they have signed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer:
    """The other end of a connection, as its certificate says. `begins`, `ends`: seconds since 1970.

    `authority`: the fingerprint of the authority that has signed it; the site of the identity follows from it.
    """

    identity: Identity
    serial: str
    begins: float
    ends: float
    authority: str


def peer_of(certificate: Mapping[str, Any]) -> Peer:
    """The peer with a certificate, as `peer_certificate` returns it. Raises UsageError if it has no identity."""
    uris = [value for kind, value in certificate.get("subjectAltName", ()) if kind == "URI"]
    return Peer(
        identity=identity_of_uris(uris),
        serial=f"{int(certificate['serialNumber'], 16):x}",
        begins=float(ssl.cert_time_to_seconds(certificate["notBefore"])),
        ends=float(ssl.cert_time_to_seconds(certificate["notAfter"])),
        authority=certificate[AUTHORITY],
    )


def peer_certificate(transport: BaseTransport) -> Mapping[str, Any] | None:
    """The certificate of the other end, as `ssl.SSLSocket.getpeercert` returns it, and its `AUTHORITY`; None if it has shown none."""
    tls: ssl.SSLObject | None = transport.get_extra_info("ssl_object")
    certificate = tls.getpeercert() if tls is not None else None
    if tls is None or not certificate:
        return None
    return {**certificate, AUTHORITY: _authority(tls)}


def fingerprint(certificate: str) -> str:
    """The first 128 bits of the SHA-256 of a certificate in PEM, in hexadecimal digits."""
    return _fingerprint(ssl.PEM_cert_to_DER_cert(certificate))


def _fingerprint(certificate: bytes) -> str:
    return sha256(certificate).hexdigest()[:32]


def _authority(tls: ssl.SSLObject) -> str:
    """The fingerprint of the authority at the end of the chain that TLS has verified.

    The name of the issuer would not do: two authorities may have the same. A session that is resumed (RFC 8446, 2.2) has no chain; its
    certificate was verified when the session began, in this process, which alone has the key for resuming it.
    """
    certificate = tls.getpeercert(binary_form=True) or b""
    chain = _verified_chain(tls)
    if not chain:
        return _authorities.get(sha256(certificate).digest(), "")
    authority = _fingerprint(chain[-1])
    if len(_authorities) >= MOST_KNOWN:
        del _authorities[next(iter(_authorities))]
    _authorities[sha256(certificate).digest()] = authority
    return authority


def _verified_chain(tls: Any) -> list[bytes]:
    """The certificates from that of the other end to that of the authority, in DER. Before Python 3.13, `ssl` does not publish them."""
    if hasattr(tls, "get_verified_chain"):
        return list(tls.get_verified_chain())
    import _ssl

    encoding: int = getattr(_ssl, "ENCODING_DER")  # noqa: B009  # the type stubs lack it
    return [certificate.public_bytes(encoding) for certificate in tls._sslobj.get_verified_chain() or ()]
