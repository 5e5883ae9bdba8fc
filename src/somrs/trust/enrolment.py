"""The files of who is enrolled: its certificate `NAME.pem`, its key `NAME.key`, and the certificate of the authority, `authority.pem`."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

from somrs.errors import UsageError
from somrs.trust import certificates
from somrs.trust.authority import Authority, write_private


def enrol(authority: Authority, word: str, hosts: tuple[str, ...], folder: Path, now: datetime, request: Path | None = None) -> list[Path]:
    """Write the files of who has a word into a folder, and return them. With a request, whoever made it keeps the key."""
    key_and_request = certificates.make_request() if request is None else None
    document = key_and_request.certificate if key_and_request is not None else request.read_bytes() if request is not None else b""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    certificate = authority.enrol(word, document, hosts, now)
    stem = re.sub(r"[^\w.-]", "_", authority.check(certificate, now).name)
    files = {folder / f"{stem}.pem": certificate, folder / "authority.pem": authority.certificate_file.read_bytes()}
    if key_and_request is not None:
        files[folder / f"{stem}.key"] = key_and_request.key
    for file, content in files.items():
        write_private(file, content)
    return sorted(files)


def renew(authority: Authority, certificate: Path, now: datetime) -> list[Path]:
    """Replace a certificate and the key beside it. Returns the files."""
    if certificate.suffix != ".pem":
        raise UsageError(f"{certificate} is to be a file NAME.pem, with its key beside it in NAME.key")
    key_and_request = certificates.make_request()
    renewed = authority.renew(certificate.read_bytes(), key_and_request.certificate, now)
    key = certificate.with_suffix(".key")
    write_private(key, key_and_request.key)
    write_private(certificate, renewed)
    return [certificate, key]
