"""Identifiers as vehicles take them (3.0, 7.1.2 and 7.10)."""

from __future__ import annotations

import hashlib
import re

from somrs.adapters.vda5050.messages.factsheets import StringLengths

NOT_IN_IDS = re.compile(r"[^A-Za-z0-9_.:-]")
"""Characters that identifiers should not have."""

DIGEST = 8
"""How many characters of a digest tell two names apart that are cut off."""


def plain_id(name: str) -> str:
    """A name as an identifier."""
    return NOT_IN_IDS.sub("_", name) or "_"


def fitting_id(name: str, limits: StringLengths | None) -> str:
    """A name as an identifier of a vehicle with these limits: the same for the same name. None: there are no limits."""
    text, digest = plain_id(name), hashlib.sha256(name.encode()).digest()
    if limits is None:
        return text
    most = limits.maximum_id_length or None
    if limits.id_numerical_only:
        return str(int.from_bytes(digest))[:most] if most is not None else str(int.from_bytes(digest[:8]))
    if most is None or len(text) <= most:
        return text
    ending = digest.hex()[:DIGEST]
    return f"{text[: most - DIGEST - 1]}-{ending}" if most > 2 * DIGEST else digest.hex()[:most]
