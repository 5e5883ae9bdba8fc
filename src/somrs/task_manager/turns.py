"""Whose turn it is at a device, among all tasks: it does so many things at once, and who is told to begin has its turn.

Of steps that wait for the same device, those of the task with the highest priority come first, then those that were promised first. What
is under way is not interrupted, and a device does not wait for a step that cannot begin yet, whatever its priority.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from somrs.protocol.messages.directory import AT_ONCE, Offer

Rank = tuple[float, float, float, str]
"""The lowest comes first."""


@dataclass(frozen=True, slots=True)
class _Turn:
    """A task that has a step for the device, and what to call when it may be its turn."""

    offer: Offer
    rank: Rank
    then: Callable[[float], None]


@dataclass(slots=True)
class Turns:
    """Of all devices. Who waits in vain, because its step is gone, costs nothing: it is called, and takes no turn."""

    _at_work: dict[str, list[Callable[[], bool]]] = field(default_factory=dict)
    """By device, of each that was told to begin, whether it is still at work."""
    _waiting: dict[str, dict[str, _Turn]] = field(default_factory=dict)
    """By device, and by task."""

    def begins(self, device: str, still: Callable[[], bool]) -> None:
        """Something was told to begin there; it is over when `still` says so."""
        self._at_work.setdefault(device, []).append(still)

    def takes(self, offer: Offer, task: str, rank: Rank, then: Callable[[float], None]) -> bool:
        """Whether it is the task's turn at the device. If not, `then` is called once it may be."""
        waiting = self._waiting.get(offer.provider, {})
        if self._has_room(offer) and all(rank <= turn.rank for other, turn in waiting.items() if other != task):
            return True
        before = waiting.get(task)
        if before is None or rank < before.rank:
            self._waiting.setdefault(offer.provider, {})[task] = _Turn(offer, rank, then)
        return False

    def wake(self, now: float) -> None:
        """Let those go on whose turn it is."""
        for device in [*self._waiting]:
            waiting = self._waiting[device]
            while waiting:
                task = min(waiting, key=lambda one: waiting[one].rank)
                if not self._has_room(waiting[task].offer):
                    break
                waiting.pop(task).then(now)
            if not waiting:
                del self._waiting[device]

    def _has_room(self, offer: Offer) -> bool:
        at_work = [still for still in self._at_work.get(offer.provider, ()) if still()]
        if at_work:
            self._at_work[offer.provider] = at_work
        else:
            self._at_work.pop(offer.provider, None)
        many = offer.attributes.get(AT_ONCE, 1)
        return len(at_work) < (many if isinstance(many, int | float) and not isinstance(many, bool) else 1)
