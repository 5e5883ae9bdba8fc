"""The certificate authority of a site, in the folder `trust` of its data folder.

| file | content |
|---|---|
| `authority.key`, `authority.pem` | the key and the certificate of the authority |
| `register.json` | the certificates that it has issued, the invitations that are open, and what is revoked |
| `holders.json` | the certificates that are not revoked, by which the name of a sender leads to its rights |
| `revoked.txt` | the serial numbers of revoked certificates, which programs read again when it changes |
| `revoked.pem` | the same as a list that the authority has signed (RFC 5280, 5), for programs of other makes |
| `neighbours.json` | the neighbours whose certificates count here |
| `programs/NAME.key`, `.pem` | keys and certificates of the site's own programs |

All are for the user of the system alone. Changes of the register are made one after the other, under a lock.
"""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import msgspec

from somrs.errors import UsageError
from somrs.trust import certificates
from somrs.trust.certificates import CERTIFICATE_DAYS, Issued
from somrs.trust.connections import fingerprint
from somrs.trust.credentials import FOLDER
from somrs.trust.files import install, write_private
from somrs.trust.holders import HOLDERS_FILE, REVOKED_FILE, Holder, write_holders, write_revoked
from somrs.trust.identity import Identity, Role, certificate_uri
from somrs.trust.mqtt_topics import check_topics
from somrs.trust.neighbours import NEIGHBOURS_FILE, Neighbours, TrustedNeighbour, write_trusted

INVITATION_SECONDS = 3600.0
"""For how long an invitation can be used."""


class IssuedCertificate(msgspec.Struct, frozen=True, kw_only=True):
    """A certificate that was issued. `begins`, `ends`: seconds since 1970."""

    serial: str
    name: str
    roles: tuple[Role, ...]
    speaks_for: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    hosts: tuple[str, ...] = ()
    begins: float
    ends: float
    revoked_at: float | None = None

    @property
    def identity(self) -> Identity:
        return _identity(self)


class Invitation(msgspec.Struct, frozen=True, kw_only=True):
    """Who may ask once for a certificate. Of the word, only the hash is kept. `hosts`: where it is reached, if whoever invites says so."""

    word_hash: str
    name: str
    roles: tuple[Role, ...]
    speaks_for: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    hosts: tuple[str, ...] = ()
    ends: float

    @property
    def identity(self) -> Identity:
        return _identity(self)


class Register(msgspec.Struct, kw_only=True):
    """What the authority keeps. `version`: of this format."""

    version: int = 1
    site: str
    certificates: list[IssuedCertificate] = []
    invitations: list[Invitation] = []


@dataclass(frozen=True, slots=True)
class Authority:
    """The authority in a folder. Its methods raise UsageError if there is none."""

    folder: Path

    @classmethod
    def of_data(cls, data: Path) -> Authority:
        """The authority of the system with this data folder."""
        return cls(data / FOLDER)

    @property
    def exists(self) -> bool:
        return (self.folder / "register.json").exists()

    @property
    def certificate_file(self) -> Path:
        return self.folder / "authority.pem"

    @property
    def public_certificate(self) -> str:
        """The certificate of the authority, in PEM."""
        self._check_exists()
        return self.certificate_file.read_text()

    @property
    def revocation_file(self) -> Path:
        return self.folder / "revoked.pem"

    def create(self, site: str, now: datetime) -> None:
        """Make the authority of a site. Raises UsageError if there is one: its certificates would become worthless."""
        if self.exists:
            raise UsageError(f"{self.folder} has an authority already, whose certificates are in use; remove the folder to begin anew")
        (self.folder / "programs").mkdir(mode=0o700, parents=True, exist_ok=True)
        self.folder.chmod(0o700)
        issued = certificates.make_authority(site, now)
        write_private(self.folder / "authority.key", issued.key)
        write_private(self.certificate_file, issued.certificate)
        self._write_revoked(Register(site=site), now)
        self._write_holders(Register(site=site))
        write_private(self.folder / "register.json", msgspec.json.format(msgspec.json.encode(Register(site=site))))

    def trust_neighbours(self, neighbours: tuple[TrustedNeighbour, ...], own_hosts: Iterable[str]) -> None:
        """Have certificates of these neighbours count at the site, which is at these hosts, and those of no others. Raises UsageError if
        they cannot be told apart."""
        self._check_exists()
        Neighbours(neighbours, own_hosts)
        owners = {fingerprint(self.certificate_file.read_text()): "this system"}
        for neighbour in neighbours:
            certificates.check_authority(neighbour.authority.encode(), f"the `authority` of {neighbour.name}")
            if (owner := owners.setdefault(fingerprint(neighbour.authority), neighbour.name)) != neighbour.name:
                raise UsageError(f"the `authority` of {neighbour.name} is that of {owner}: get the certificate of its own authority")
        file = self.folder / NEIGHBOURS_FILE
        if neighbours or file.exists():
            write_private(file, write_trusted(neighbours))

    def read(self) -> Register:
        """What has been issued."""
        self._check_exists()
        try:
            return msgspec.json.decode((self.folder / "register.json").read_bytes(), type=Register)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise UsageError(f"{self.folder / 'register.json'} cannot be read: {error}; restore it from a backup") from None

    def list_holders(self) -> None:
        """Write anew who holds a certificate, as an earlier version did not."""
        with self._changing():
            pass

    def issue(self, identity: Identity, request: bytes, hosts: tuple[str, ...], now: datetime) -> bytes:
        """Issue a certificate for an identity that the caller has proven. Returns it in PEM."""
        with self._changing() as register:
            return self._issue(register, identity, request, hosts, now)

    def issue_program(self, identity: Identity, hosts: tuple[str, ...], now: datetime) -> tuple[Path, Path]:
        """The files of the certificate and the key of a program of this site; made if there are none, or if they are due for renewal."""
        certificate_file, key_file = (self.folder / "programs" / f"{identity.name}.{kind}" for kind in ("pem", "key"))
        if certificate_file.exists() and key_file.exists() and self._is_usable(certificate_file, key_file, identity, hosts, now):
            return certificate_file, key_file
        request = certificates.make_request()
        certificate = self.issue(identity, request.certificate, hosts, now)
        install(certificate_file, certificate, request.key, is_lasting=False)  # they can be made again
        return certificate_file, key_file

    def invite(self, identity: Identity, now: datetime, seconds: float = INVITATION_SECONDS, hosts: tuple[str, ...] = ()) -> str:
        """Let an identity, which is reached at these hosts, enrol itself once. Returns the word that proves it; it is not kept.

        Who has the word knows this authority by it.
        """
        self._check_exists()
        certificates.check_hosts(hosts)
        check_topics(identity)
        word = f"{secrets.token_hex(18)}.{fingerprint(self.certificate_file.read_text())}"
        with self._changing() as register:
            invitation = Invitation(
                word_hash=_hash(word),
                name=identity.name,
                roles=tuple(sorted(identity.roles)),
                speaks_for=tuple(sorted(identity.speaks_for)),
                topics=tuple(sorted(identity.topics)),
                hosts=hosts,
                ends=now.timestamp() + seconds,
            )
            open_invitations = [
                invited for invited in register.invitations if invited.ends > now.timestamp() and invited.name != identity.name
            ]
            register.invitations = [*open_invitations, invitation]
        return word

    def enrol(self, word: str, request: bytes, hosts: tuple[str, ...], now: datetime) -> bytes:
        """Issue the certificate that a word invites to, and use it up. Returns it in PEM. `hosts`: if the invitation names none."""
        with self._changing() as register:
            word_hash = _hash(word)
            invitation = next(
                (invitation for invitation in register.invitations if hmac.compare_digest(invitation.word_hash, word_hash)), None
            )
            if invitation is None:
                raise UsageError("this invitation is unknown or was used: get another one with `somrs trust invite NAME`")
            if invitation.ends <= now.timestamp():
                raise UsageError(
                    f"the invitation of {invitation.name} has expired: get another one with `somrs trust invite {invitation.name}`"
                )
            certificate = self._issue(register, invitation.identity, request, invitation.hosts or hosts, now)
            register.invitations.remove(invitation)
            return certificate

    def renew(self, certificate: bytes, request: bytes, now: datetime) -> bytes:
        """Issue a certificate to follow one that still holds, for the same identity and hosts. Returns it in PEM."""
        self.check(certificate, now)
        return self.renew_serial(certificates.serial(certificates.load(certificate, "the certificate")), request, now)

    def renew_serial(self, serial: str, request: bytes, now: datetime, *, is_due: bool = False) -> bytes:
        """Issue a certificate to follow the one with this serial number, which its owner has proven to have. Returns it in PEM.

        `is_due`: only if half of its time is over.
        """
        with self._changing() as register:
            entry = next((entry for entry in register.certificates if entry.serial == serial), None)
            if entry is None or entry.revoked_at is not None or entry.ends <= now.timestamp():
                raise UsageError("this certificate does not hold: enrol again, with a new invitation")
            if is_due and now.timestamp() < (entry.begins + entry.ends) / 2:
                raise UsageError(f"the certificate of {entry.name} is not due for renewal: less than half of its time is over")
            return self._issue(register, entry.identity, request, entry.hosts, now)

    def revoke(self, name: str, now: datetime) -> list[str]:
        """Revoke all certificates and invitations of a name. Returns the serial numbers."""
        with self._changing() as register:
            holding = [entry.serial for entry in register.certificates if entry.name == name and entry.revoked_at is None]
            invited = [invitation for invitation in register.invitations if invitation.name == name]
            if not holding and not invited:
                known_names = ", ".join(sorted({entry.name for entry in register.certificates if entry.revoked_at is None})) or "none"
                raise UsageError(f"{name} has no certificate that holds; there are those of: {known_names}")
            register.certificates = [
                msgspec.structs.replace(entry, revoked_at=now.timestamp()) if entry.serial in holding else entry
                for entry in register.certificates
            ]
            register.invitations = [invitation for invitation in register.invitations if invitation not in invited]
            self._write_revoked(register, now)
            return holding

    def check(self, certificate: bytes, now: datetime) -> Identity:
        """The identity of a certificate of this site that holds now. Raises UsageError that says who, what, and what to do next."""
        register = self.read()
        authority = certificates.load(self.certificate_file.read_bytes(), str(self.certificate_file))
        return certificates.check(certificates.load(certificate, "the certificate"), authority, _revoked(register), now)

    def _issue(self, register: Register, identity: Identity, request: bytes, hosts: tuple[str, ...], now: datetime) -> bytes:
        lifetime = timedelta(days=CERTIFICATE_DAYS)
        issued = certificates.issue(self._signer(), request, identity, hosts, now, lifetime)
        register.certificates.append(
            IssuedCertificate(
                serial=certificates.serial(issued),
                name=identity.name,
                roles=tuple(sorted(identity.roles)),
                speaks_for=tuple(sorted(identity.speaks_for)),
                topics=tuple(sorted(identity.topics)),
                hosts=hosts,
                begins=issued.not_valid_before_utc.timestamp(),
                ends=issued.not_valid_after_utc.timestamp(),
            )
        )
        return certificates.pem(issued)

    def _is_usable(self, file: Path, key_file: Path, identity: Identity, hosts: tuple[str, ...], now: datetime) -> bool:
        try:
            certificate = certificates.load(file.read_bytes(), str(file))
        except UsageError:
            return False
        if not certificates.is_key_of(certificate, key_file.read_bytes()):
            return False
        entry = {issued.serial: issued for issued in self.read().certificates}.get(certificates.serial(certificate))
        if entry is None or entry.revoked_at is not None or entry.identity != identity or entry.hosts != hosts:
            return False
        is_of_earlier_version = not certificates.is_named(certificate, certificate_uri(entry.serial))
        return not is_of_earlier_version and not certificates.is_renewal_due(certificate, now)

    def _signer(self) -> Issued:
        return Issued(certificate=self.certificate_file.read_bytes(), key=(self.folder / "authority.key").read_bytes())

    def _write_revoked(self, register: Register, now: datetime) -> None:
        lifetime = timedelta(days=certificates.AUTHORITY_DAYS)  # it is read from this folder, where no older one takes its place
        write_private(self.folder / REVOKED_FILE, write_revoked(_revoked(register)))
        write_private(self.revocation_file, certificates.revocation_list(self._signer(), _revoked(register), now, lifetime))

    @contextmanager
    def _changing(self) -> Iterator[Register]:
        """Yield the register, and write what has become of it. Nothing is written after an error."""
        self._check_exists()
        with (self.folder / "lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            register = self.read()
            yield register
            write_private(self.folder / "register.json", msgspec.json.format(msgspec.json.encode(register)))
            self._write_holders(register)

    def _write_holders(self, register: Register) -> None:
        holders = (
            Holder(
                serial=entry.serial,
                name=entry.name,
                roles=entry.roles,
                speaks_for=entry.speaks_for,
                topics=entry.topics,
                begins=entry.begins,
                ends=entry.ends,
            )
            for entry in register.certificates
            if entry.revoked_at is None
        )
        write_private(self.folder / HOLDERS_FILE, write_holders(holders), is_lasting=False)  # the register has the same

    def _check_exists(self) -> None:
        if not self.exists:
            raise UsageError(f"{self.folder} has no certificate authority: make one with `somrs trust init`")


def _identity(entry: IssuedCertificate | Invitation) -> Identity:
    return Identity(name=entry.name, roles=frozenset(entry.roles), speaks_for=frozenset(entry.speaks_for), topics=frozenset(entry.topics))


def _revoked(register: Register) -> frozenset[str]:
    return frozenset(entry.serial for entry in register.certificates if entry.revoked_at is not None)


def _hash(word: str) -> str:
    return hashlib.sha256(word.strip().partition(".")[0].encode()).hexdigest()  # of 144 random bits: nothing is gained by trying words
