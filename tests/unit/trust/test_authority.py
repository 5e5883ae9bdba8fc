"""What the authority of a site issues, whom it believes, and what it says of certificates that do not hold."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509

from somrs.errors import UsageError
from somrs.trust import certificates
from somrs.trust.authority import Authority
from somrs.trust.certificates import AUTHORITY_DAYS, CERTIFICATE_DAYS
from somrs.trust.holders import HOLDERS_FILE, holder_named, read_holders
from somrs.trust.identity import Identity, Role, identity_of_uris

NOW = datetime(2026, 11, 28, 12, 0, tzinfo=UTC)
ROBOT = Identity(name="Robot 7/ä", roles=frozenset({Role.DEVICE}), speaks_for=frozenset({"Robot7.Arm", "Camera,1"}))


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    authority = Authority.of_data(tmp_path)
    authority.create("office", NOW)
    return authority


def enrolled(authority: Authority, identity: Identity = ROBOT, now: datetime = NOW) -> bytes:
    word = authority.invite(identity, now)
    return authority.enrol(word, certificates.make_request().certificate, ("127.0.0.1", "robot.example"), now)


def test_a_certificate_says_who_one_is(authority: Authority) -> None:
    document = enrolled(authority)
    assert authority.check(document, NOW) == ROBOT
    names = x509.load_pem_x509_certificate(document).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert identity_of_uris(["spiffe://other", *names.get_values_for_type(x509.UniformResourceIdentifier)]) == ROBOT
    assert names.get_values_for_type(x509.DNSName) == ["robot.example"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1"]


def test_only_its_user_can_read_what_the_authority_keeps(authority: Authority) -> None:
    authority.issue_program(Identity(name="registry", roles=frozenset({Role.REGISTRY})), ("127.0.0.1",), NOW)
    modes = {path.name: path.stat().st_mode & 0o777 for path in authority.folder.rglob("*") if path.is_file() and path.name != "lock"}
    assert set(modes) == {
        *("authority.key", "authority.pem", "holders.json", "revoked.pem", "revoked.txt", "register.json", "registry.key", "registry.pem")
    }
    assert set(modes.values()) == {0o600}
    assert authority.folder.stat().st_mode & 0o777 == 0o700


def test_a_word_invites_once(authority: Authority) -> None:
    word = authority.invite(ROBOT, NOW)
    assert word not in (authority.folder / "register.json").read_text()
    request = certificates.make_request().certificate
    authority.enrol(word, request, (), NOW)
    with pytest.raises(UsageError, match="unknown or was used: get another one with `somrs trust invite NAME`"):
        authority.enrol(word, request, (), NOW)


def test_a_word_is_short_lived(authority: Authority) -> None:
    word = authority.invite(ROBOT, NOW)
    with pytest.raises(UsageError, match=f"the invitation of {ROBOT.name} has expired: get another one"):
        authority.enrol(word, certificates.make_request().certificate, (), NOW + timedelta(hours=1))


def test_a_later_invitation_replaces_an_earlier_one(authority: Authority) -> None:
    first_word, second_word = authority.invite(ROBOT, NOW), authority.invite(ROBOT, NOW)
    request = certificates.make_request().certificate
    with pytest.raises(UsageError, match="unknown or was used"):
        authority.enrol(first_word, request, (), NOW)
    assert authority.check(authority.enrol(second_word, request, (), NOW), NOW) == ROBOT


@pytest.mark.parametrize("request_document", [b"", b"-----BEGIN CERTIFICATE REQUEST-----\nAAAA\n-----END CERTIFICATE REQUEST-----\n"])
def test_a_broken_request_uses_no_invitation_up(authority: Authority, request_document: bytes) -> None:
    word = authority.invite(ROBOT, NOW)
    with pytest.raises(UsageError, match="no certificate request in PEM"):
        authority.enrol(word, request_document, (), NOW)
    authority.enrol(word, certificates.make_request().certificate, (), NOW)


@pytest.mark.parametrize(
    ("now", "problem"),
    [
        (NOW + timedelta(days=CERTIFICATE_DAYS), "expired at .*: enrol it again, with a new invitation"),
        (NOW - timedelta(minutes=6), "holds from 2026-11-28T11:55:00.*, and it is 2026-11-28T11:54:00: set the clock of this host"),
    ],
)
def test_a_certificate_holds_for_a_time(authority: Authority, now: datetime, problem: str) -> None:
    with pytest.raises(UsageError, match=f"the certificate of {ROBOT.name} {problem}"):
        authority.check(enrolled(authority), now)


def test_clocks_may_differ_a_little(authority: Authority) -> None:
    assert authority.check(enrolled(authority), NOW - timedelta(minutes=4)) == ROBOT


def test_a_revoked_certificate_holds_no_more(authority: Authority) -> None:
    document, other_certificate = enrolled(authority), enrolled(authority, Identity(name="Robot8", roles=frozenset({Role.DEVICE})))
    word = authority.invite(ROBOT, NOW)
    [number] = authority.revoke(ROBOT.name, NOW)
    with pytest.raises(UsageError, match=rf"the certificate of {ROBOT.name} \({number}\) is revoked: enrol it again"):
        authority.check(document, NOW)
    with pytest.raises(UsageError, match="is revoked"):
        authority.renew(document, certificates.make_request().certificate, NOW)
    with pytest.raises(UsageError, match="unknown or was used"):
        authority.enrol(word, certificates.make_request().certificate, (), NOW)
    assert authority.check(other_certificate, NOW).name == "Robot8"
    revoked = x509.load_pem_x509_crl(authority.revocation_file.read_bytes())
    assert [f"{entry.serial_number:x}" for entry in revoked] == [number]
    issuer = x509.load_pem_x509_certificate(authority.certificate_file.read_bytes())
    assert revoked.is_signature_valid(issuer.public_key())  # type: ignore[arg-type]  # its key is of a kind that signs
    with pytest.raises(UsageError, match="has no certificate that holds; there are those of: Robot8"):
        authority.revoke(ROBOT.name, NOW)


def test_a_foreign_certificate_is_none(authority: Authority, tmp_path: Path) -> None:
    foreign = Authority.of_data(tmp_path / "other")
    foreign.create("office", NOW)
    with pytest.raises(UsageError, match=r"of another authority .* `somrs trust invite NAME` there and `somrs trust enrol` here"):
        authority.check(enrolled(foreign), NOW)


def test_a_certificate_is_renewed_while_it_holds(authority: Authority) -> None:
    document = enrolled(authority)
    due_time = NOW + timedelta(days=CERTIFICATE_DAYS * 2 / 3, seconds=1)
    assert not certificates.is_renewal_due(certificates.load(document, ""), NOW)
    assert certificates.is_renewal_due(certificates.load(document, ""), due_time)
    renewed = authority.renew(document, certificates.make_request().certificate, due_time)
    assert authority.check(renewed, NOW + timedelta(days=CERTIFICATE_DAYS + 1)) == ROBOT
    assert authority.read().certificates[-1].hosts == ("127.0.0.1", "robot.example")


def test_a_program_keeps_its_certificate_until_it_is_due(authority: Authority) -> None:
    registry = Identity(name="registry", roles=frozenset({Role.REGISTRY}))

    def issued(identity: Identity = registry, host: str = "127.0.0.1", days: int = 0) -> bytes:
        return authority.issue_program(identity, (host,), NOW + timedelta(days=days))[0].read_bytes()

    first = issued()
    assert issued(days=59) == first
    assert (second := issued(days=61)) != first
    assert (third := issued(host="10.0.0.2", days=61)) != second
    assert issued(Identity(name="registry", roles=frozenset({Role.VIEWER})), "10.0.0.2", 61) != third


def test_an_authority_is_made_once_and_lasts(authority: Authority, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has an authority already"):
        authority.create("office", NOW)
    with pytest.raises(UsageError, match="has no certificate authority: make one with `somrs trust init`"):
        Authority.of_data(tmp_path / "nowhere").read()
    end = certificates.load(authority.certificate_file.read_bytes(), "").not_valid_after_utc
    assert end == NOW + timedelta(days=AUTHORITY_DAYS)


@pytest.mark.parametrize(
    "uris", [[], ["somrs:identity:A"], ["somrs:role:device"], ["somrs:identity:A", "somrs:identity:B", "somrs:role:device"]]
)
def test_a_certificate_without_one_name_and_a_role_says_nothing(uris: list[str]) -> None:
    with pytest.raises(UsageError, match="no identity of SO-MRS"):
        identity_of_uris(uris)


def test_an_unknown_role_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(UsageError, match="there is no role 'king'; the roles are device, task-manager, "):
        identity_of_uris(["somrs:identity:A", "somrs:role:king"])


def test_who_holds_a_certificate_is_listed_until_it_is_revoked(authority: Authority) -> None:
    enrolled(authority)
    enrolled(authority, Identity(name="Robot8", roles=frozenset({Role.DEVICE})))
    holders = read_holders(authority.folder / HOLDERS_FILE)
    assert holder_named(holders, ROBOT.name, NOW.timestamp()).identity == ROBOT
    authority.revoke(ROBOT.name, NOW)
    [holder] = read_holders(authority.folder / HOLDERS_FILE)
    assert holder.name == "Robot8"
    with pytest.raises(UsageError, match="Robot8 has no certificate that holds: enrol it again"):
        holder_named([holder], "Robot8", holder.ends)


@pytest.mark.parametrize("host", ["somrs:certificate:1f", "a b", "", "-robot", "robot/ä", "x" * 254])
def test_a_certificate_is_for_hosts_only(authority: Authority, host: str) -> None:
    word = authority.invite(ROBOT, NOW)
    with pytest.raises(UsageError, match="is no name of a host and no IP address"):
        authority.enrol(word, certificates.make_request().certificate, (host,), NOW)
