"""What the Map page says about changes that the Repository refuses."""

from __future__ import annotations

from somrs.client.refusals import Refused
from somrs.errors import SomrsError

_VERSION_CONFLICT = "overtaken"
"""The rule that the Repository reports when another client changed the object first."""


def overtaken_objects(error: SomrsError) -> str:
    """The objects that another client changed first, as a text; empty if the change was refused for another reason."""
    if not isinstance(error, Refused) or all(broken_rule.rule != _VERSION_CONFLICT for broken_rule in error.broken):
        return ""
    return ", ".join(dict.fromkeys(broken_rule.subject for broken_rule in error.broken))


def refusal_text(error: SomrsError) -> str:
    """The reason of a refusal, as a text."""
    if names := overtaken_objects(error):
        return f"Another user changed {names} in the meantime; check it and try again."
    if isinstance(error, Refused) and error.broken:
        return "\n".join(f"{broken_rule.subject}: {broken_rule.message}" for broken_rule in error.broken)
    return str(error)
