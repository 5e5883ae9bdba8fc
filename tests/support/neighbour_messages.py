"""What passes between the systems of owners in virtual time, and whether neighbours with certificates could send it."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.errors import WireError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.neighbour_rights import check_neighbour_right
from somrs.trust.identity import Identity, Role

_ROLES = {"repository": Role.REPOSITORY, "registry": Role.REGISTRY, "tm": Role.TASK_MANAGER, "devices": Role.DEVICE}
"""By the second part of an address, such as `Barn/tm`."""


def denied_between(messages: Iterable[Message]) -> list[str]:
    """Why messages from one owner to the other would have been denied. Others than those between two systems are skipped."""
    problems = []
    for message in messages:
        sender, recipient = message.header.sender.split("/"), message.header.recipient.split("/")
        if min(len(sender), len(recipient)) < 2 or sender[0] == recipient[0] or not {sender[1], recipient[1]} <= {*_ROLES}:
            continue
        identity = Identity(name=sender[-1], roles=frozenset({_ROLES[sender[1]]}), site=sender[0])
        try:
            check_neighbour_right(message, identity, {_ROLES[recipient[1]]})
        except WireError as error:
            problems.append(error.text)
    return problems
