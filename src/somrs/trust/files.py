"""The files of certificates and keys, which only their user may read."""

from __future__ import annotations

import os
from pathlib import Path


def next_key(certificate: Path) -> Path:
    """Where the key of a certificate is until the certificate has taken its place."""
    return certificate.with_suffix(".next.key")


def install(certificate: Path, document: bytes, key: bytes, *, is_lasting: bool = True) -> None:
    """Replace a certificate and the key beside it. If it ends in between, the key of the certificate is in one of two places.

    `is_lasting`: as of `write_private`.
    """
    write_private(next_key(certificate), key, is_lasting=is_lasting)
    write_private(certificate, document, is_lasting=is_lasting)
    next_key(certificate).replace(certificate.with_suffix(".key"))


def write_private(file: Path, content: bytes, *, is_lasting: bool = True) -> None:
    """Replace a file, which only its user may read, in one step. `is_lasting`: it also survives a loss of power right after this."""
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)
        stream.flush()
        if is_lasting:
            os.fsync(stream.fileno())
    draft.replace(file)
