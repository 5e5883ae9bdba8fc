"""X.509 certificates of a site (RFC 5280): ECDSA with P-256 and SHA-256. No files, and no clock."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from ipaddress import ip_address

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from somrs.errors import UsageError
from somrs.trust.identity import Identity, certificate_uri, identity_of_uris, mqtt_uri

TOLERANCE = timedelta(minutes=5)
"""By how much clocks of hosts may differ: certificates begin that much earlier."""

_HOST_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")

AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 90


@dataclass(frozen=True, slots=True, kw_only=True)
class Issued:
    """A certificate with its key, as PEM."""

    certificate: bytes
    key: bytes


def make_authority(site: str, now: datetime) -> Issued:
    """Make the authority of a site: a key, and a certificate that it has signed itself."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"SO-MRS site {site}"[:64])])
    builder = _builder(subject, subject, key.public_key(), now, timedelta(days=AUTHORITY_DAYS), x509.random_serial_number())
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(_usage(signs_certificates=True), critical=True)
    return Issued(certificate=_pem(builder.sign(key, hashes.SHA256())), key=key_pem(key))


def make_request() -> Issued:
    """Make a key and a request for a certificate of it (PKCS #10). Who asks is proven by an invitation, and not by the request."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "SO-MRS")])
    request = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, hashes.SHA256())
    return Issued(certificate=request.public_bytes(serialization.Encoding.PEM), key=key_pem(key))


def issue(
    authority: Issued, request: bytes, identity: Identity, hosts: tuple[str, ...], now: datetime, lifetime: timedelta
) -> x509.Certificate:
    """Sign a request for an identity, which is reached at these hosts (names or IP addresses). Raises UsageError for a bad request."""
    try:
        signing_request = x509.load_pem_x509_csr(request)
    except ValueError as error:
        raise UsageError(f"this is no certificate request in PEM: {error}") from None
    public_key = signing_request.public_key()
    if (
        not signing_request.is_signature_valid
        or not isinstance(public_key, ec.EllipticCurvePublicKey)
        or public_key.curve.name != "secp256r1"
    ):
        raise UsageError(
            "a request has to be signed with the P-256 key that it is for: make it with `somrs trust enrol`, or openssl -newkey ec"
        )
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    key = _private_key(authority.key)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, identity.name[:64])])
    number = x509.random_serial_number()
    serials = [certificate_uri(f"{number:x}"), *([mqtt_uri(f"{number:x}")] if identity.topics else [])]
    names = [x509.UniformResourceIdentifier(uri) for uri in (*identity.uris, *serials)]
    builder = _builder(subject, issuer.subject, public_key, now, lifetime, number)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(_usage(signs_certificates=False), critical=True)
    builder = builder.add_extension(
        x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]), critical=False
    )
    builder = builder.add_extension(x509.SubjectAlternativeName([*names, *map(_host_name, hosts)]), critical=False)
    builder = builder.add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(key.public_key()), critical=False)
    return builder.sign(key, hashes.SHA256())


def identity_of(certificate: x509.Certificate) -> Identity:
    """The identity that a certificate names. Raises UsageError if it names none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return identity_of_uris(())
    return identity_of_uris(names.get_values_for_type(x509.UniformResourceIdentifier))


def check(certificate: x509.Certificate, authority: x509.Certificate, revoked: frozenset[str], now: datetime) -> Identity:
    """The identity of a certificate that the authority has issued and that holds now.

    Raises UsageError, which says who, what and what to do next.
    """
    name = certificate.subject.rfc4514_string()
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise UsageError(
            f"the certificate of {name} is of another authority than {authority.subject.rfc4514_string()}: enrol it at this site, with "
            "`somrs trust invite NAME` there and `somrs trust enrol` here"
        ) from None
    identity = identity_of(certificate)
    if serial(certificate) in revoked:
        raise UsageError(f"the certificate of {identity.name} ({serial(certificate)}) is revoked: enrol it again, with a new invitation")
    if now < certificate.not_valid_before_utc:
        begin = certificate.not_valid_before_utc.isoformat(timespec="seconds")
        raise UsageError(
            f"the certificate of {identity.name} holds from {begin}, and it is {now:%Y-%m-%dT%H:%M:%S}: set the clock of this host"
        )
    if now >= certificate.not_valid_after_utc:
        end = certificate.not_valid_after_utc.isoformat(timespec="seconds")
        raise UsageError(f"the certificate of {identity.name} expired at {end}: enrol it again, with a new invitation")
    return identity


def is_renewal_due(certificate: x509.Certificate, now: datetime) -> bool:
    """Whether two thirds of a certificate's time are over."""
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return now >= begin + (end - begin) * 2 / 3


def revocation_list(authority: Issued, serials: frozenset[str], now: datetime, lifetime: timedelta) -> bytes:
    """The list of revoked certificates, in PEM."""
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    builder = x509.CertificateRevocationListBuilder().issuer_name(issuer.subject).last_update(now - TOLERANCE).next_update(now + lifetime)
    for number in sorted(serials):
        entry = x509.RevokedCertificateBuilder().serial_number(int(number, 16)).revocation_date(now)
        builder = builder.add_revoked_certificate(entry.build())
    return builder.sign(_private_key(authority.key), hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def is_named(certificate: x509.Certificate, uri: str) -> bool:
    """Whether a certificate has this URI."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return False
    return uri in names.get_values_for_type(x509.UniformResourceIdentifier)


def is_key_of(certificate: x509.Certificate, key: bytes) -> bool:
    """Whether a key in PEM is that of a certificate; not if it cannot be read."""
    try:
        return _private_key(key).public_key() == certificate.public_key()
    except ValueError:
        return False


def serial(certificate: x509.Certificate) -> str:
    """The serial number, in hexadecimal digits."""
    return f"{certificate.serial_number:x}"


def pem(certificate: x509.Certificate) -> bytes:
    return _pem(certificate)


def load(document: bytes, source: str) -> x509.Certificate:
    """Read a certificate in PEM. Raises UsageError, which names the source."""
    try:
        return x509.load_pem_x509_certificate(document)
    except ValueError as error:
        raise UsageError(f"{source} is no certificate in PEM: {error}") from None


def check_authority(document: bytes, source: str) -> None:
    """Raises UsageError, which names the source, unless a document has one certificate in PEM, which may sign others."""
    certificate = load(document, source)
    try:
        may_sign = certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        may_sign = False
    if not may_sign or document.count(b"BEGIN CERTIFICATE") != 1:
        raise UsageError(f"{source} is to be the certificate of an authority, as `somrs trust authority` prints it")


def key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())


def _private_key(document: bytes) -> ec.EllipticCurvePrivateKey:
    key = serialization.load_pem_private_key(document, None)
    assert isinstance(key, ec.EllipticCurvePrivateKey), "the authority has a key of this kind"
    return key


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: datetime, lifetime: timedelta, number: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(number)
        .not_valid_before(now - TOLERANCE)
        .not_valid_after(now + lifetime)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def check_hosts(hosts: tuple[str, ...]) -> None:
    """Raises UsageError if one is no name of a host and no IP address."""
    for host in hosts:
        _host_name(host)


def _host_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        # The servers of a bus compare these names with URIs of certificates, too: none may look like one.
        if len(host) > 253 or not _HOST_NAME.fullmatch(host):
            raise UsageError(f"{host[:100]!r} is no name of a host and no IP address") from None
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)
