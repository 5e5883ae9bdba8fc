"""Whose turn it is at a device, among all tasks: it does so many things at once, and who is told to begin has its turn.

Of steps that wait for the same device, those of the task with the highest priority come first, then those that were promised first. What
is under way is not interrupted, and a device does not wait for a step that cannot begin yet, whatever its priority.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec import Struct, field

from somrs.protocol.messages.directory import CAPACITY_ATTRIBUTE, Offer

Rank = tuple[float, float, float, str]
"""The lowest comes first."""


class AtWork(Struct, frozen=True):
    """A participant that was told to begin something."""

    transaction: str
    participant: str


StillAtWork = Callable[[AtWork], bool]
"""Whether its device does that yet."""


class _Turn(Struct, frozen=True):
    """A task that has a step for the device."""

    offer: Offer
    rank: Rank


class DeviceQueues(Struct, kw_only=True):
    """Of all devices. Who waits in vain, because its step is gone, costs nothing: it is called, and takes no turn."""

    at_work: dict[str, list[AtWork]] = {}
    """By device, all that were told to begin and may be at work yet."""
    waiting: dict[str, dict[str, _Turn]] = field(default_factory=dict)
    """By device, and by task."""

    def add_work(self, device: str, work: AtWork) -> None:
        """Something was told to begin there."""
        self.at_work.setdefault(device, []).append(work)

    def request_turn(self, offer: Offer, task: str, rank: Rank, still_at_work: StillAtWork) -> bool:
        """Whether it is the task's turn at the device. If not, `admit_waiting` admits it later."""
        waiting = self.waiting.get(offer.provider, {})
        if self._has_room(offer, still_at_work) and all(rank <= turn.rank for other_task, turn in waiting.items() if other_task != task):
            return True
        old_turn = waiting.get(task)
        if old_turn is None or rank < old_turn.rank:
            self.waiting.setdefault(offer.provider, {})[task] = _Turn(offer, rank)
        return False

    def admit_waiting(self, still_at_work: StillAtWork) -> Iterator[str]:
        """The tasks whose turn it is. Between two of them, anything may change."""
        for device in [*self.waiting]:
            waiting = self.waiting[device]
            while waiting:
                task = min(waiting, key=lambda candidate: waiting[candidate].rank)
                if not self._has_room(waiting[task].offer, still_at_work):
                    break
                del waiting[task]
                yield task
            if not waiting:
                del self.waiting[device]

    def _has_room(self, offer: Offer, still_at_work: StillAtWork) -> bool:
        at_work = [work for work in self.at_work.get(offer.provider, ()) if still_at_work(work)]
        if at_work:
            self.at_work[offer.provider] = at_work
        else:
            self.at_work.pop(offer.provider, None)
        capacity = offer.attributes.get(CAPACITY_ATTRIBUTE, 1)
        return len(at_work) < (capacity if isinstance(capacity, int | float) and not isinstance(capacity, bool) else 1)
