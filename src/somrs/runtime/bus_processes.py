"""Which process on a bus has which component: messages to all components of a process go together, to its inbox.

Each reply names the inbox of the process that sent it. This module remembers what the replies said, and what is no longer true.
"""

from __future__ import annotations


class BusProcesses:
    """The inboxes of processes, by the subjects of the components in them."""

    def __init__(self) -> None:
        self._inboxes: dict[str, str] = {}
        self._ended: set[str] = set()

    def inbox_of(self, subject: str) -> str | None:
        """The inbox of the process with this component, if a reply has named it."""
        return self._inboxes.get(subject)

    def learn(self, subject: str, inbox: str) -> None:
        """Remember where a reply came from. Messages may be under way to an inbox known before, which has to be forgotten first."""
        self._inboxes.setdefault(subject, inbox)

    def begin(self, subject: str) -> str | None:
        """Note that the component has begun to listen. Returns the inbox where it was before: its process has probably ended."""
        inbox = self._inboxes.get(subject)
        if inbox is not None:
            self._ended.add(inbox)
        return inbox

    def has_ended(self, inbox: str) -> bool:
        """Whether one of the components in this process has begun elsewhere."""
        return inbox in self._ended

    def forget(self, inbox: str) -> None:
        """Forget the components of a process: messages go to their own subjects until replies say more."""
        self._ended.discard(inbox)
        self._inboxes = {subject: known for subject, known in self._inboxes.items() if known != inbox}

    def forget_component(self, subject: str) -> None:
        """Forget where a component is: its process did not accept a message for it."""
        self._inboxes.pop(subject, None)
