"""Whether the programs of a system have certificates."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.client.addresses import LAST_FILE, Addresses
from somrs.deployment.program_certificates import certificates_of_programs
from somrs.errors import UsageError
from somrs.trust.authority import Authority
from somrs.trust.certificates import make_request
from somrs.trust.credentials import Credentials


@pytest.mark.parametrize("has_run", [None, False, True], ids=["new", "without", "with"])
@pytest.mark.parametrize(
    ("choice", "secure", "expected"),
    [
        (None, True, {None: True, False: False, True: True}),
        (None, False, dict.fromkeys((None, False, True), False)),
        (True, False, dict.fromkeys((None, False, True), True)),
        (True, True, dict.fromkeys((None, False, True), True)),
        (False, True, dict.fromkeys((None, False, True), False)),
    ],
)
def test_they_have_unless_the_system_is_open_or_has_run_without(
    tmp_path: Path, has_run: bool | None, choice: bool | None, secure: bool, expected: dict[bool | None, bool]
) -> None:
    if has_run is not None:
        addresses = Addresses(repository="", registry="", task_manager="", trust=str(tmp_path / "trust") if has_run else None)
        addresses.write(tmp_path, LAST_FILE)
    certificates = certificates_of_programs(tmp_path, "127.0.0.1", "site", choice, secure=secure)
    assert (certificates is not None) is expected[has_run]


BARN = "Barn: {registry: '%s/registry', takes: all, gives: all, repository: '%s/repository', shows: all, changes: true%s}\n"


def neighbours_file(folder: Path, url: str = "https://barn.example", further: str = ", authority: barn.pem") -> Path:
    """The file of a system whose neighbour is the barn, and the certificate of the barn's authority."""
    barn = Authority.of_data(folder / "barn")
    if not barn.exists:
        barn.create("barn", datetime.now(UTC))
    (folder / "barn.pem").write_text(barn.public_certificate)
    file = folder / "neighbours.yaml"
    file.write_text(BARN % (url, url, further))
    return file


def prepared(data: Path, file: Path | None, host: str = "127.0.0.1") -> Credentials:
    """Those of clients of a system with these neighbours."""
    programs = certificates_of_programs(data, host, "site", None, secure=True, neighbours=file)
    assert programs is not None
    programs.prepare()
    return Credentials(programs.folder / "programs" / "client.pem")


def test_neighbours_are_known_by_their_authorities_and_hosts(tmp_path: Path) -> None:
    file = neighbours_file(tmp_path, further=", authority: barn.pem, hosts: [robots.barn.example], trust: 'https://trust.example:8610/'")
    neighbours = prepared(tmp_path / "data", file).neighbours
    [barn] = neighbours.all
    assert (barn.name, barn.service) == ("Barn", "https://trust.example:8610")
    hosts = {"barn.example": "Barn", "Robots.barn.example": "Barn", "trust.example": "Barn", "127.0.0.1": "", "barn.example.evil": ""}
    assert {host: neighbours.site_of(f"https://{host}:9/devices/Robot1") for host in hosts} == hosts
    # A system that is started without them has none.
    assert prepared(tmp_path / "data", None).neighbours.all == ()


@pytest.mark.parametrize(
    ("url", "further", "problem"),
    [
        ("https://barn.example", "", r"Barn has no `authority`.*`somrs trust authority > barn.pem`.*--no-certificates"),
        ("http://barn.example", ", authority: barn.pem", "addresses begin with https://, and this is http://barn.example/registry"),
        ("https://127.0.0.1:8600", ", authority: barn.pem", "Barn is at 127.0.0.1, and so is this system.*with --host"),
        ("https://barn.example", ", authority: nothing.pem", "nothing.pem cannot be read"),
        ("https://barn.example", ", authority: neighbours.yaml", "the `authority` of Barn is no certificate in PEM"),
        ("https://barn.example", ", authority: data/trust/authority.pem", "the `authority` of Barn is that of this system"),
        ("https://barn.example", ", authority: data/trust/programs/client.pem", "is to be the certificate of an authority"),
        ("https://barn.example", ", hosts: [a]", "Barn: .*`authority`"),
        ("https://barn.example", ", authority: barn.pem, trust: trust.example", "`trust` is a URL"),
    ],
)
def test_a_neighbour_that_could_not_be_told_is_said_at_once(tmp_path: Path, url: str, further: str, problem: str) -> None:
    prepared(tmp_path / "data", None)
    file = neighbours_file(tmp_path, url, further)
    with pytest.raises(UsageError, match=problem):
        prepared(tmp_path / "data", file)
    assert certificates_of_programs(tmp_path, "127.0.0.1", "site", False, secure=True, neighbours=file) is None


@pytest.mark.parametrize("kind", ["pem", "key"])
@pytest.mark.parametrize("content", [b"", make_request().key], ids=["empty", "another"])
def test_a_certificate_that_a_loss_of_power_has_spoilt_is_made_again(tmp_path: Path, kind: str, content: bytes) -> None:
    certificates = certificates_of_programs(tmp_path, "127.0.0.1", "site", True, secure=True)
    assert certificates is not None
    certificates.prepare()
    file = Authority.of_data(tmp_path).folder / "programs" / f"client.{kind}"
    file.write_bytes(content)
    certificates.prepare()
    assert Credentials(file.with_suffix(".pem")).name == "client"
