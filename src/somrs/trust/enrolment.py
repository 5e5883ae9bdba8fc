"""The files of who is enrolled: its certificate `NAME.pem`, its key `NAME.key`, and what it has of the authority: `authority.pem`, who
holds a certificate, what is revoked, and where the service of the authority is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from somrs.errors import UsageError
from somrs.trust import certificates
from somrs.trust.authority import Authority
from somrs.trust.credentials import SERVICE_FILE
from somrs.trust.files import install, write_private
from somrs.trust.holders import HOLDERS_FILE, REVOKED_FILE
from somrs.trust.neighbours import NEIGHBOURS_FILE, REVOKED_NEIGHBOURS_FILE


def enrol(authority: Authority, word: str, hosts: tuple[str, ...], folder: Path, now: datetime, request: Path | None = None) -> list[Path]:
    """Write the files of who has a word into a folder, and return them. With a request, whoever made it keeps the key."""
    key_and_request = certificates.make_request() if request is None else None
    document = key_and_request.certificate if key_and_request is not None else request.read_bytes() if request is not None else b""
    certificate = authority.enrol(word, document, hosts, now)
    beside = {
        name: (authority.folder / name).read_bytes()
        for name in ("authority.pem", REVOKED_FILE, HOLDERS_FILE, SERVICE_FILE, NEIGHBOURS_FILE, REVOKED_NEIGHBOURS_FILE)
        if (authority.folder / name).exists()
    }
    key = key_and_request.key if key_and_request is not None else None
    return write_files(folder, authority.check(certificate, now).name, certificate, key, beside)


def write_files(folder: Path, name: str, certificate: bytes, key: bytes | None, beside: Mapping[str, bytes]) -> list[Path]:
    """Write the certificate of who has this name into a folder, with the key, and other files by their names. Returns the files."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    stem = re.sub(r"[^\w.-]", "_", name)
    stem = re.sub(r"[^\w.-]", "_", name)
    file = folder / f"{stem}.pem"
    if key is not None:
        install(file, certificate, key)
    else:
        write_private(file, certificate)
    for other_name, content in beside.items():
        write_private(folder / other_name, content)
    keys = [file.with_suffix(".key")] if key is not None else []
    return sorted([file, *keys, *(folder / other_name for other_name in beside)])


def renew(authority: Authority, certificate: Path, now: datetime) -> list[Path]:
    """Replace a certificate and the key beside it. Returns the files."""
    if certificate.suffix != ".pem":
        raise UsageError(f"{certificate} is to be a file NAME.pem, with its key beside it in NAME.key")
    key_and_request = certificates.make_request()
    renewed = authority.renew(certificate.read_bytes(), key_and_request.certificate, now)
    install(certificate, renewed, key_and_request.key)
    return [certificate, certificate.with_suffix(".key")]
