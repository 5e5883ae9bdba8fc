"""The commands of certificates."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from somrs.access.identity import user_of_process
from somrs.cli.trust import trust_app
from somrs.storage.audit_log import AuditLog

RUNNER = CliRunner()


@pytest.fixture
def site(tmp_path: Path) -> Path:
    assert "made the authority of office" in call(tmp_path / "data", "init", "--site", "office").output
    return tmp_path / "data"


def call(data: Path, *arguments: str) -> Result:
    return RUNNER.invoke(trust_app, [*arguments, "--data", str(data)])


def enrolled(data: Path, folder: Path) -> Path:
    word = call(data, "invite", "Robot7", "--speaks-for", "Arm7").output.strip()
    result = call(data, "enrol", word, "--host", "127.0.0.1", "--out", str(folder))
    assert [Path(line).name for line in result.output.split()] == [
        *("Robot7.key", "Robot7.pem", "authority.pem", "holders.json", "revoked.txt")
    ]
    assert {os.stat(folder / name).st_mode & 0o777 for name in os.listdir(folder)} == {0o600}
    return folder / "Robot7.pem"


def test_a_device_is_invited_enrolled_renewed_and_revoked(site: Path, tmp_path: Path) -> None:
    certificate = enrolled(site, tmp_path / "robot")
    assert call(site, "show", str(certificate)).output == "Robot7: device\n  speaks for Arm7\n"
    first = certificate.read_bytes()
    assert call(site, "renew", str(certificate)).exit_code == 0
    assert certificate.read_bytes() != first
    assert call(site, "list").output.count("Robot7: device, until") == 2
    assert call(site, "revoke", "Robot7").output.startswith("revoked ")
    assert call(site, "list").output.startswith("nobody has a certificate")
    assert call(site, "list", "--all").output.count(", revoked at ") == 2
    result = call(site, "show", str(certificate))
    assert (result.exit_code, "is revoked: enrol it again" in result.output) == (2, True)


def test_who_changed_whose_certificates_is_in_the_audit_log(site: Path, tmp_path: Path) -> None:
    certificate = enrolled(site, tmp_path / "robot")
    call(site, "renew", str(certificate))
    call(site, "revoke", "Robot7")
    assert call(site, "revoke", "Robot8").exit_code == 2
    entries = [*AuditLog(site).entries()]
    assert [entry.act for entry in entries] == ["trust.init", "trust.invite", "trust.enrol", "trust.renew", "trust.revoke"]
    assert {entry.actor.name for entry in entries if entry.actor is not None} == {user_of_process()}
    assert entries[1].details == {"name": "Robot7", "roles": ["device"], "speaks_for": ["Arm7"], "topics": [], "hosts": []}
    assert entries[2].details == {"name": "Robot7", "hosts": ["127.0.0.1"]}
    assert entries[-1].details["name"] == "Robot7"
    assert len(entries[-1].details["serials"]) == 2


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["enrol", "guess"], "this invitation is unknown or was used"),
        (["invite", "Robot7", "--role", "king"], "there is no role 'king'; the roles are device"),
        (["invite", "Robot7", "--host", "a b"], "'a b' is no name of a host"),
        (["enrol", "guess", "--at", "https://127.0.0.1:1"], "this is not a whole word of an invitation"),
        (["enrol", "a.b", "--at", "https://127.0.0.1:1", "--host", "robot"], "`somrs trust invite --host` names hosts"),
        (["revoke", "Robot7"], "Robot7 has no certificate that holds"),
        (["init"], "has an authority already"),
        (["show", "/nowhere.pem"], "/nowhere.pem: No such file"),
    ],
)
def test_what_cannot_be_done_is_explained(site: Path, arguments: list[str], problem: str) -> None:
    result = call(site, *arguments)
    assert (result.exit_code, problem in result.output) == (2, True), result.output


def test_without_an_authority_one_is_told_how_to_make_it(tmp_path: Path) -> None:
    result = call(tmp_path, "list")
    assert (result.exit_code, "make one with `somrs trust init`" in result.output) == (2, True)
