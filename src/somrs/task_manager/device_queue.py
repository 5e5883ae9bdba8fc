"""Which steps a device executes next, among the steps of all tasks. The capacity of a device limits how many it executes at once.

Among the steps that wait for a device, those of the task with the highest priority come first, then those with the earliest promised
start. A running step is not interrupted, and a device does not wait for a step that cannot start yet, whatever its priority.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec import Struct, field

from somrs.protocol.messages.directory import Offer

Rank = tuple[float, float, float, str]
"""The order of waiting tasks, lowest first."""


class AtWork(Struct, frozen=True):
    """A participant that received an order: Execute or Compensate."""

    transaction: str
    participant: str


StillAtWork = Callable[[AtWork], bool]
"""Whether the device of the participant still carries out the order."""


class _Turn(Struct, frozen=True):
    """A task that waits for a device with a step."""

    offer: Offer
    rank: Rank


class DeviceQueues(Struct, kw_only=True):
    """The queues of all devices. A waiting task whose step is gone does no harm: it is admitted and starts nothing."""

    at_work: dict[str, list[AtWork]] = {}
    """By device: the participants that received an order and may still carry it out."""
    waiting: dict[str, dict[str, _Turn]] = field(default_factory=dict)
    """By device, then by task."""

    def add_work(self, device: str, work: AtWork) -> None:
        """Register an order to a participant whose service occupies the device."""
        self.at_work.setdefault(device, []).append(work)

    def request_turn(self, offer: Offer, task: str, rank: Rank, still_at_work: StillAtWork) -> bool:
        """Whether the task may start a step at the device now. If not, it waits, and `admit_waiting` yields it later."""
        if not offer.occupies:
            return True
        waiting = self.waiting.get(offer.provider, {})
        if self._has_room(offer, still_at_work) and all(rank <= turn.rank for other_task, turn in waiting.items() if other_task != task):
            return True
        old_turn = waiting.get(task)
        if old_turn is None or rank < old_turn.rank:
            self.waiting.setdefault(offer.provider, {})[task] = _Turn(offer, rank)
        return False

    def admit_waiting(self, still_at_work: StillAtWork) -> Iterator[str]:
        """Remove and yield the tasks whose turn it is. The queues may change between two of them."""
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
        return len(at_work) < offer.capacity
