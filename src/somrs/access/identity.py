"""Who sends a request, as it has proven, and whether that suffices."""

from __future__ import annotations

import getpass
import os
import socket
from contextvars import ContextVar

from msgspec import Struct

from somrs.access.rights import Right, least_role


class Identity(Struct, frozen=True, kw_only=True):
    """Who sends a request.

    `name`: a person, or the program that a token was made for; empty if nobody is asked who they are. `secret`: what it has proven itself
    with, for requests on its behalf. `speaks_for_others`: the author that a request states counts. `session`: the id of the session.
    `address`: the address from which it signed in, or from which the request comes.
    """

    name: str
    rights: frozenset[Right]
    secret: str = ""
    speaks_for_others: bool = False
    session: str | None = None
    address: str = ""

    def lacks(self, required_right: Right) -> str | None:
        """Why it may not do what needs this right; None if it may."""
        if required_right in self.rights:
            return None
        if not self.name:
            return "nobody signs in at this system, so nobody can be given access; start it without `--insecure`"
        role = least_role(required_right)
        article = "an" if role[0] in "aeio" else "a"
        needed = f"the right to {required_right}, which {article} {role} has"
        return f"{self.name} does not have {needed}; an administrator can give it on the page People and access"


ANYBODY = Identity(name="", rights=frozenset(Right) - {Right.ADMINISTER}, speaks_for_others=True)
"""Who sends requests to a server that asks nobody who they are."""

sender: ContextVar[Identity | None] = ContextVar("sender", default=None)
"""Who sent the request that is worked on. Tasks that work on it begin with the same."""


def user_of_process() -> str:
    """The user who runs this process: `user@host`."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError):  # a container may run as a user that has no name
        user = str(os.getuid())
    return f"{user}@{socket.gethostname()}"
