"""Whether the programs of a system have certificates."""

from __future__ import annotations

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


def test_neighbours_are_not_let_down_in_silence(tmp_path: Path) -> None:
    for choice in (None, True):
        with pytest.raises(UsageError, match=r"neighbours do not know the certificates of this system.*: start it with --no-certificates"):
            certificates_of_programs(tmp_path, "127.0.0.1", "site", choice, secure=True, is_shared=True)
    assert certificates_of_programs(tmp_path, "127.0.0.1", "site", False, secure=True, is_shared=True) is None


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
