"""What the processes of a site on a bus say when they are asked what they run."""

from __future__ import annotations

import msgspec


class RunningComponent(msgspec.Struct, frozen=True, kw_only=True):
    """A process that runs a component on a bus: on which host, whether it leads, and the number of the last entry that it knows.

    `problem`: why the bus does not store what it is sent; empty if it does.
    """

    component: str
    host: str
    process: int
    leads: bool
    number: int
    problem: str = ""


def status_subject(site: str) -> str:
    """The subject on which all processes of a site are asked what they run."""
    return f"somrs-status.{site}"
