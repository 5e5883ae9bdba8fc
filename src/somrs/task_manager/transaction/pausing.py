"""Pausing a task: nothing of it begins any more, and the devices that work for it stand still, until somebody lets it go on.

That a device stands still for a task is on the map (`PausedFor`), as a stop is, so that all who follow the map act on it; and it is another
attribute than that of an operator's stop, so that neither ends the other.
"""

from __future__ import annotations

from somrs.kernel.component import Effects
from somrs.ontology.objects import Change, ValueSet
from somrs.ontology.types import PAUSED_FOR
from somrs.protocol.messages import events
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.task_views import Pause
from somrs.task_manager.requests import ForPause
from somrs.task_manager.transaction.scope import TaskScope


class Pausing:
    """Pauses one task, and lets it go on. It has no state of its own."""

    def __init__(self, scope: TaskScope) -> None:
        self._scope, self._state = scope, scope.state

    def begin(self, author: str, now: float) -> Effects:
        """Pause the task, and stop the devices that work for it."""
        if self._state.pause is not None or self._state.ending is not None or self._state.outcome is not None:
            return
        self._state.pause = Pause(by=author, since=now)
        self._scope.log_event(events.Paused(author=author), now)
        yield from self.hold_devices(now)

    def hold_devices(self, now: float) -> Effects:
        """Stop the devices that work for the task and do not stand still for it yet."""
        state = self._state
        if state.pause is None:
            return
        working = sorted({member.offer.provider for member in state.members.working} - {*state.held_devices})
        state.held_devices += working
        yield from self._set(working, state.id, now)

    def end(self, author: str, now: float) -> Effects:
        """Let the task and its devices go on. `author`: who does; empty if the task ends."""
        state = self._state
        if state.pause is None:
            return
        if author:
            self._scope.log_event(events.Resumed(author=author), now)
        released, state.held_devices = state.held_devices, []
        held_by, state.pause = state.pause, None
        yield from self._set(released, None, now, author or held_by.by)

    def _set(self, devices: list[str], task: str | None, now: float, author: str = "") -> Effects:
        objects = self._scope.context.replica.map.objects
        changes: tuple[Change, ...] = tuple(ValueSet(device, PAUSED_FOR, task) for device in devices if device in objects)
        if changes:
            author = author or (self._state.pause.by if self._state.pause is not None else "")
            yield from self._scope.context.requests.update(UpdateMap(changes=changes, author=author), ForPause(self._state.id), now)
