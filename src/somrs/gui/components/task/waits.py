"""A task that another task waits for, as texts."""

from __future__ import annotations

from typing import TypedDict


class WaitText(TypedDict):
    """The goal of the task, the address of its page, and what it has reserved."""

    goal: str
    href: str
    reserved: str
