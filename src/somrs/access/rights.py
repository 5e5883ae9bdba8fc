"""Rights, and the roles that have them."""

from __future__ import annotations

from enum import StrEnum


class Right(StrEnum):
    """What an operation needs."""

    SEE = "see"
    """Read and follow everything but who has access."""
    STOP = "stop"
    """Stop devices. It is a right of every role: nobody may be without it in an emergency."""
    OPERATE = "operate"
    """Submit and cancel tasks, answer questions, release, send and repair devices."""
    MODEL = "model"
    """Change maps, ontologies, templates and zones; invite devices."""
    ADMINISTER = "administer"
    """Add and remove people, roles, tokens and sessions; invite programs of the site, and revoke."""


class PersonRole(StrEnum):
    """What a person may do. Each role has the rights of those before it."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ENGINEER = "engineer"
    ADMINISTRATOR = "administrator"

    @property
    def rights(self) -> frozenset[Right]:
        return _RIGHTS[self]


_VIEWER = frozenset({Right.SEE, Right.STOP})
_RIGHTS = {
    PersonRole.VIEWER: _VIEWER,
    PersonRole.OPERATOR: _VIEWER | {Right.OPERATE},
    PersonRole.ENGINEER: _VIEWER | {Right.OPERATE, Right.MODEL},
    PersonRole.ADMINISTRATOR: frozenset(Right),
}


def least_role(required_right: Right) -> PersonRole:
    """The first role that has a right."""
    return next(role for role in PersonRole if required_right in role.rights)
